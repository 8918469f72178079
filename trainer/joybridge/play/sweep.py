"""Evaluation over values of an option, a parameter or a limit of the hand: a table, a plot with 95 % intervals."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from joybridge.config.config import OF_THE_GAME, HandConfig
from joybridge.config.errors import ConfigError
from joybridge.config.overrides import split_values
from joybridge.config.wrong_keys import FORMS
from joybridge.play.text_table import aligned

if TYPE_CHECKING:  # a wrong value is refused before torch is loaded
    from matplotlib.figure import Figure

    from joybridge.play.evaluate import Evaluation

Results = Mapping[str, Mapping[str, "Evaluation"]]  # "parameters.size=0.5" -> policy -> its evaluation

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
PANELS = 6  # in a plot, at most: the reward and the first metrics
COLUMNS = 3
MAX_CHARS = 40  # of all choices of an option, which stand side by side below a panel


class Sweep(NamedTuple):
    """An option or a parameter of a game, or a limit of the hand, and the values to play."""

    key: str  # as in "parameters.size" or "hand.delay"
    values: list[str]

    @property
    def settings(self) -> list[str]:
        """Return an override of the configuration per value."""
        return [f"{self.key}={value}" for value in self.values]

    @property
    def of_game(self) -> bool:
        """Return whether it is an option or a parameter, which each of several games has for itself."""
        return self.key.partition(".")[0] in OF_THE_GAME

    @property
    def named(self) -> bool:
        """Return whether the values are names, hands or distributions, which stand side by side, and no numbers."""
        return self.key.startswith("options.") or not all(map(NUMBER.fullmatch, self.values))

    @property
    def places(self) -> list[float]:
        """Return where the values stand on an axis."""
        return [float(place if self.named else value) for place, value in enumerate(self.values)]

    def picture(self, run: Path, form: str) -> Path:
        """Return where the plot of a run belongs. form: "png", or one for a paper."""
        name = re.sub(r"[^\w.-]", "_", self.key)  # never a path of its own
        return run / f"over-{name}.{form}"


def read_sweep(text: str) -> Sweep:
    """Return what "parameters.size=0.5,1,2" or "hand={delay: 0},{delay: 2, reach: 0.5}" means. Raises ConfigError."""
    key, _, values = text.partition("=")
    sweep = Sweep(key, split_values(values))
    where, _, name = key.partition(".")
    known = name in HandConfig.model_fields or not name if where == "hand" else where in OF_THE_GAME and name
    if not known or not all(sweep.values):
        wanted = " or ".join(f"{FORMS[form]},…" for form in (*OF_THE_GAME, "hand"))
        raise ConfigError(f"--over got {text!r}, expected {wanted}, as in parameters.size=0.5,1,2")
    if len({float(value) if NUMBER.fullmatch(value) else value for value in sweep.values}) < len(sweep.values):
        raise ConfigError(f"--over got {text!r}, which names a value twice; name each value once")
    return sweep


def table(sweep: Sweep, results: Results) -> str:
    """Return a table per policy: a line per value, a column per metric."""
    lines = []
    for policy, first in results[sweep.settings[0]].items():
        rows = [[sweep.key, *first.means]]
        for value, setting in zip(sweep.values, sweep.settings, strict=True):
            result = results[setting][policy]
            rows.append([value, *(f"{mean:.3f} ± {result.half_width(name)}" for name, mean in result.means.items())])
        fewest = min(result[policy].episodes for result in results.values())
        least = "" if len({result[policy].episodes for result in results.values()}) == 1 else "at least "
        lines.append(f"{policy}: {least}{fewest} episodes per value, mean and 95 % confidence")
        lines += [f"  {line}" for line in aligned(rows)]
    return "\n".join(lines)


def plot(sweep: Sweep, results: Results) -> "Figure":
    """Return a picture: reward and metrics over the values, with 95 % confidence intervals. Needs matplotlib."""
    from matplotlib.figure import Figure

    policies = results[sweep.settings[0]]
    metrics = list(dict.fromkeys(name for first in policies.values() for name in first.means if name != "length"))
    metrics = metrics[:PANELS]
    crowded = sum(map(len, sweep.values)) > MAX_CHARS
    columns = min(COLUMNS, len(metrics))
    rows = -(-len(metrics) // columns)
    figure = Figure(figsize=(4 * columns, 3.2 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).flat
    for metric, axes in zip(metrics, panels, strict=False):
        for policy, first in policies.items():
            if metric in first.means:
                played = [results[setting][policy] for setting in sweep.settings]
                axes.errorbar(
                    sweep.places,
                    [one.means[metric] for one in played],
                    [one.half_widths[metric] for one in played],
                    fmt="o-",
                    capsize=3,
                    label=policy,
                )
        axes.set(title=metric, xlabel=sweep.key)
        if sweep.named:  # numbers have the marks of the axis, as values side by side would be written over each other
            rotation, side = (30, "right") if crowded else (0, "center")
            axes.set_xticks(sweep.places, sweep.values, rotation=rotation, ha=side)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in panels:  # that no metric needs
        axes.set_visible(False)
    if len(policies) > 1:
        figure.axes[0].legend(frameon=False)
    return figure
