"""How trained policies play: measures of the behavior that the paper describes in words.

python -m tools.paper.behavior RUN [RUN …]    adds to results/behavior.json and draws figures/behavior.png beside it

Plays every run for one time limit of the game, with samples as in training, and measures from what goes over the
wire: sensors by their names, buttons, metrics. Only the units of the sensors stand here. The same seed gives the
same figures.
"""

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count, islice, pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from joybridge.contract.tensors import Array
from joybridge.trainer.config import run_config
from joybridge.trainer.errors import CheckpointError, ConfigError
from joybridge.trainer.playing import open_play
from joybridge.trainer.wire.client import SimulatorError
from joybridge.trainer.wire.launch import simulator_process
from tools.paper.figures import COLOURS, save_figure

Measures = dict[str, Any]  # of one run, as they go to JSON

# Shooting Birds, units/s: the unit of the crosshair's speed sensor, its top speed.
TOP_SPEED = 50.0
# Beastly Rivals, game units (metres): the unit of the position sensors, and the slow sphere's radius.
PLACE_UNIT, SPHERE_RADIUS = 7.0, 3.0
WINDOW_SECONDS = 10.0  # of the lap radius: the character walks 40 m, about one lap or more
FEWEST_EPISODES = 3  # that must live through a window of the lap radius for it to count


@dataclass(frozen=True)
class Trace:
    """What the lanes of one behavior sensed and did, decision by decision."""

    seconds: float  # game time of a decision
    sensors: dict[str, Array]  # by name [decisions, lanes, *shape]: what the decision was based on
    pressed: dict[str, Array]  # by button, bool [decisions, lanes]
    ended: Array  # bool [decisions, lanes]: whether the episode ended with the decision
    metrics: dict[str, Array]  # by name [decisions, lanes]: of the episode that ended, else NaN
    groups: int = 1  # as many blocks of lanes, equally large, played under different options

    def episodes(self) -> list[tuple[slice, int]]:
        """Return every finished episode as its decisions and its lane."""
        ends = [[0, *(np.flatnonzero(column) + 1).tolist()] for column in self.ended.T]
        return [(slice(*pair), lane) for lane, column in enumerate(ends) for pair in pairwise(column)]


def shooting_birds(trace: Trace) -> Measures:
    """Measure how the crosshair moves (units/s) and how often and how well it shoots."""
    _, _, right, up, speed = np.moveaxis(trace.sensors["crosshair"], -1, 0)  # a unit vector and a share of top speed
    shots = trace.pressed["shoot"] & (trace.sensors["gun"][..., 0] > 0)  # an empty gun does not shoot
    pauses = [pause for episode in trace.episodes() for pause in np.diff(np.flatnonzero(shots[episode]))]
    hits = trace.metrics["hits"]
    return {
        "abs_vx": _mean(abs(right * speed) * TOP_SPEED),
        "abs_vy": _mean(abs(up * speed) * TOP_SPEED),
        "seconds_between_shots": _mean(np.multiply(pauses, trace.seconds)),
        "hits_per_level": [_mean(block) for block in np.split(hits, trace.groups, axis=1)],
        "click_accuracy": _mean(trace.metrics["click_accuracy"]),
    }


def beastly_rivals(trace: Trace) -> Measures:
    """Measure the character's laps, the clicks, and how long it lives and is in the slow sphere.

    slow_share is the share of decisions in which the character's centre is in the sphere, whether that slows it
    or not; slow_share_by_chance what it would be with the sphere of another arena, which no policy can avoid.
    """
    places = trace.sensors["character"][..., :2] * PLACE_UNIT
    spheres = places - trace.sensors["slow_sphere"][..., :2] * PLACE_UNIT
    return {
        "lap_radius": lap_radius(trace, places),
        "commands_per_decision": _mean(trace.pressed["move"] | trace.pressed["blink"]),
        "blinks_per_episode": _mean(trace.metrics["blinks"]),
        "slow_share": _mean(_near(places, spheres)),
        "slow_share_by_chance": _mean(_near(places, np.roll(spheres, 1, axis=1))),
        "survival_seconds": _mean(trace.metrics["survival"] * trace.seconds),
    }


def lap_radius(trace: Trace, places: Array) -> list[list[float]]:
    """Return [middle of a window in seconds of episode time, radius], window after window.

    The radius is that of gyration, the root mean square distance of `places` [decisions, lanes, 2] to their own
    centre within the window: on a circle the circle's radius, wherever its centre, whole laps or nearly. It is
    the mean over the episodes that lived through the window, where there are enough of them; so what comes
    late in an episode is told by those that survive.
    """
    episodes = [places[episode] for episode in trace.episodes()]
    points: list[list[float]] = []
    for window in count():
        first, last = (round(edge * WINDOW_SECONDS / trace.seconds) for edge in (window, window + 1))
        alive = [episode[first:last] for episode in episodes if len(episode) >= last]
        if len(alive) < FEWEST_EPISODES:
            return points
        points.append([(window + 0.5) * WINDOW_SECONDS, _mean([_gyration(path) for path in alive])])
    return points


def _gyration(path: Array) -> float:
    return math.sqrt(np.square(path - path.mean(axis=0)).sum(axis=1).mean())


def _near(places: Array, spheres: Array) -> Array:
    """Return whether the places [..., 2] are in the slow spheres around those centres."""
    return np.asarray(np.linalg.norm(places - spheres, axis=-1) < SPHERE_RADIUS)


def _mean(values: Any) -> Any:
    """Return the mean of all but NaN, rounded, or None where there is nothing."""
    known = np.asarray(values, float)
    known = known[~np.isnan(known)]
    return round(float(known.mean()), 4) if len(known) else None


GAMES: dict[str, Callable[[Trace], Measures]] = {"shooting_birds": shooting_birds, "beastly_rivals": beastly_rivals}

# What is drawn: a title, then one or two measures. Lists are drawn as lines over what ABSCISSAE says.
PANELS = {
    "shooting_birds": [
        ("Hits per episode", "hits_per_level"),
        ("Crosshair: mean |vx| and, pale, |vy|, units/s", "abs_vx", "abs_vy"),
        ("Seconds between two shots", "seconds_between_shots"),
        ("Click accuracy", "click_accuracy"),
    ],
    "beastly_rivals": [
        ("Lap radius, m", "lap_radius"),
        ("Commands per decision", "commands_per_decision"),
        ("Share of time in the slow sphere; pale: by chance", "slow_share", "slow_share_by_chance"),
        ("Survival per episode, s", "survival_seconds"),
    ],
}
ABSCISSAE = {"lap_radius": "episode time, s", "hits_per_level": "level"}


def measure(run: Path, address: str, *, episodes: int, seed: int) -> tuple[str, Measures]:
    """Play at least `episodes` episodes of a run; return "GAME/FOLDER" and what was measured.

    The trainer's own folders are called GAME-EXPERIMENT-sSEED; the game is not repeated.

    Raises SimulatorError, CheckpointError or ConfigError.
    """
    config = run_config(run)
    if config.game not in GAMES:
        raise ConfigError(f"{run} plays {config.game}; behavior is measured in {' and '.join(GAMES)}")
    trace, timesteps = play(run, address, episodes=episodes, seed=seed)
    measures = GAMES[config.game](trace) | {"timesteps": timesteps, "episodes": int(trace.ended.sum())}
    return f"{config.game}/{run.resolve().name.removeprefix(f'{config.game}-')}", measures


def play(run: Path, address: str, *, episodes: int, seed: int) -> tuple[Trace, int]:
    """Play one time limit in enough arenas; return its trace and how long the policy had trained.

    Where the configuration names an option to balance, its choices are the groups of the trace. Raises as
    `measure` does.
    """
    with open_play(run, address, seed=seed, episodes=episodes, arenas_limit=episodes) as played:
        spec = played.spec
        behavior, decisions = spec.behaviors[0], spec.max_episode_decisions
        shape = (decisions, played.arenas)
        trace = Trace(
            seconds=spec.tick_seconds * spec.decision_interval,
            sensors={sensor.name: np.empty((*shape, *sensor.shape), np.float32) for sensor in behavior.sensors},
            pressed={branch.name: np.empty(shape, bool) for branch in behavior.device.branches},
            ended=np.empty(shape, bool),
            metrics={metric.name: np.full(shape, np.nan) for metric in behavior.metrics},
            groups=len(played.choices),
        )
        for t, decision in enumerate(islice(played.decisions(), decisions)):
            step = decision.after[0]
            _fill(trace.sensors.values(), t, decision.before[0].observations)
            _fill(trace.pressed.values(), t, decision.acts[0].choices.T == 1)
            trace.ended[t] = step.terminated | step.truncated
            if step.metrics is not None:
                _fill(trace.metrics.values(), (t, trace.ended[t]), step.metrics.T)
        return trace, played.timesteps


def _fill(arrays: Iterable[Array], index: Any, columns: Iterable[Array]) -> None:
    for array, column in zip(arrays, columns, strict=True):
        array[index] = column


def add_measures(path: Path, name: str, measures: Measures) -> dict[str, Measures]:
    """Add a run to the file, unless it holds one of that name which has trained longer; return the whole file.

    Raises ValueError where the file is not JSON.
    """
    known: dict[str, Measures] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if name not in known or known[name]["timesteps"] <= measures["timesteps"]:
        known[name] = measures
    else:
        print(f"{name}: kept as it was, after {known[name]['timesteps']:,} timesteps", file=sys.stderr)
    lines = [f"{json.dumps(key)}: {json.dumps(known[key])}" for key in sorted(known)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return known


def show(known: dict[str, Measures]) -> None:
    """Print a table for each game: a line per run, a column per measure, lists as their ends."""
    for game in GAMES:
        rows = {name: entry for name, entry in sorted(known.items()) if name.startswith(f"{game}/")}
        names = list(next(iter(rows.values()), {}))
        if rows:
            print(f"\n{game:<24}" + "".join(f"  {name:>{max(len(name), 11)}}" for name in names))
        for name, entry in rows.items():
            cells = (f"{_cell(entry[key]):>{max(len(key), 11)}}" for key in names)
            print(f"{name.removeprefix(f'{game}/'):<24}  " + "  ".join(cells))


def _cell(value: Any) -> str:
    if isinstance(value, list):
        flat = [item[-1] if isinstance(item, list) else item for item in value]
        return f"{_cell(flat[0])} … {_cell(flat[-1])}" if flat else "–"
    return "–" if value is None else f"{value:,}" if isinstance(value, int) else f"{value:.3g}"


def draw(known: dict[str, Measures], output: Path) -> None:
    """Draw the measures of each game, a colour per experiment: the mean of its longest runs."""
    games = [game for game in GAMES if any(name.startswith(f"{game}/") for name in known)]
    layouts = {game: _longest(known, game) for game in games}
    names = sorted({name for of in layouts.values() for name in of}, key=_by_size)
    colours = {name: COLOURS.get(name.partition(",")[0], f"C{i}") for i, name in enumerate(names)}
    figure, rows = plt.subplots(len(games), 4, figsize=(18, 4.4 * len(games)), layout="constrained", squeeze=False)
    for game, panels in zip(games, rows, strict=True):
        panels[0].set_ylabel(game.replace("_", " ").title(), fontsize=12)
        for panel, (title, *keys) in zip(panels, PANELS[game], strict=True):
            (_lines if keys[0] in ABSCISSAE else _bars)(panel, layouts[game], colours, *keys)
            panel.set_title(title, fontsize=10)
            panel.spines[["top", "right"]].set_visible(False)
    output.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, output)


def _longest(known: dict[str, Measures], game: str) -> dict[str, list[Measures]]:
    """Return the runs of a game that have trained longest, by experiment and length: folders are EXPERIMENT-sSEED."""
    layouts: dict[str, list[Measures]] = {}
    for name, entry in known.items():
        if name.startswith(f"{game}/"):
            layouts.setdefault(re.sub(r"-s\d+$", "", name.removeprefix(f"{game}/")), []).append(entry)
    ends = {layout: max(entry["timesteps"] for entry in entries) for layout, entries in layouts.items()}
    return {
        f"{name}, {ends[name] / 1e6:.2g} M": [entry for entry in layouts[name] if entry["timesteps"] == ends[name]]
        for name in sorted(layouts, key=_by_size)
    }


def _by_size(layout: str) -> tuple[int, str]:
    """Sort bucket-3 before bucket-11."""
    return len(layout), layout


def _lines(axes: Axes, layouts: dict[str, list[Measures]], colours: dict[str, str], key: str) -> None:
    """Draw a list per run: points as they are, and plain numbers over their index."""
    for layout, entries in layouts.items():
        lists = [[p if isinstance(p, list) else [i, p] for i, p in enumerate(entry[key])] for entry in entries]
        means = np.array([np.mean(points, axis=0) for points in zip(*lists, strict=False)])
        if len(means):
            axes.plot(*means.T, color=colours[layout], marker=".", label=layout)
    axes.set(xlabel=ABSCISSAE[key], ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _bars(axes: Axes, layouts: dict[str, list[Measures]], colours: dict[str, str], *keys: str) -> None:
    """Draw bars of one or two measures side by side, the second pale, with a dot per run."""
    width = 0.8 / len(keys)
    for place, (layout, entries) in enumerate(layouts.items()):
        for number, key in enumerate(keys):
            values = [entry[key] for entry in entries if entry[key] is not None]
            x = place + (number - (len(keys) - 1) / 2) * width
            axes.bar(x, np.mean(values or [0.0]), width, color=colours[layout], alpha=0.4 if number else 0.9)
            axes.plot([x] * len(values), values, ".", color="black", markersize=4)
    axes.set_xticks(range(len(layouts)), list(layouts), rotation=35, ha="right", fontsize=8)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how trained policies play.")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("--episodes", type=int, default=70, help="at least so many of each; default %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="of games and samples; default %(default)s")
    parser.add_argument("--output", type=Path, default=Path("results/behavior.json"), help="default %(default)s")
    options = parser.parse_args(arguments)
    try:
        with simulator_process() as address:
            for run in options.runs:
                name, measures = measure(run, address, episodes=options.episodes, seed=options.seed)
                print(f"{run}: {name}, {measures['episodes']} episodes", file=sys.stderr, flush=True)
                known = add_measures(options.output, name, measures)
    except json.JSONDecodeError as error:
        print(f"error: {options.output} is not JSON ({error}); move it away to begin a new one", file=sys.stderr)
        return 1
    except (CheckpointError, ConfigError, SimulatorError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    figure = options.output.parent / "figures" / "behavior.png"
    draw(known, figure)
    show(known)
    print(f"\n{options.output}, {figure}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
