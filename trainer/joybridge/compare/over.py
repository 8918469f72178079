"""The page of `compare --over`: the runs of each variant under several values of one setting, as one table."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.compare.analysis import Band, center
from joybridge.compare.estimators import Estimate, estimate, interquartile_mean
from joybridge.compare.page import intervals_sentences, runs_text, warnings
from joybridge.compare.page_numbers import Setting, latex, tabular
from joybridge.compare.page_parts import (
    PICTURES,
    csv_text,
    escaped,
    interval_text,
    page_html,
    picture_block,
    table,
    write_files,
)
from joybridge.compare.page_settings import made_with_block
from joybridge.compare.pictures import draw_over, draw_themes
from joybridge.compare.scores import Run
from joybridge.compare.variants import Variant
from joybridge.config.config import Config
from joybridge.play.sweep import Sweep
from joybridge.v1 import bridge_pb2 as pb


@dataclass(frozen=True)
class Over:
    """What the runs of each variant have reached under each value of a setting."""

    metric: str
    sweep: Sweep
    runs: Sequence[Mapping[str, Sequence[Run]]]  # for each value, by label: the same runs in all
    trained: tuple[float, float] | None = None  # see `trained_span`

    @cached_property
    def estimates(self) -> dict[str, list[Estimate]]:
        """Return the interquartile mean of the scores under each value, by label."""
        return {
            label: [estimate(interquartile_mean, np.array([[run.score] for run in each[label]])) for each in self.runs]
            for label in self.runs[0]
        }

    @property
    def span(self) -> tuple[float, float] | None:
        """Return what was trained with, if it has a place on the axis."""
        return None if self.sweep.named else self.trained

    @property
    def counts(self) -> list[int]:
        """Return how many runs a variant has, the fewest first."""
        return sorted({len(runs) for runs in self.runs[0].values()})

    @property
    def center(self) -> str:
        """Return what the interquartile mean is called."""
        return center(self.counts[-1])


def trained_span(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], key: str) -> tuple[float, float] | None:
    """Return between which values a parameter, or a limit of the hand, was in the training of all variants.

    specs: of their games. None: it differs between them, or is an option.
    """
    spans = {_span(variant.config, spec, key) for variant, spec in zip(variants, specs, strict=True)}
    return next(iter(spans)) if len(spans) == 1 else None


def _span(config: Config, spec: pb.GameSpec, key: str) -> tuple[float, float] | None:
    where, _, name = key.partition(".")
    if where == "hand" and name:
        limits = [getattr(hand, name) for hand in config.hands]
        return min(limits), max(limits)
    if where != "parameters":
        return None
    usual = config.parameters.get(name, *(each.default_value for each in spec.parameters if each.name == name))
    trained = [lesson.parameters.get(name, usual) for lesson in config.curriculum] or [usual]
    lists = [next(iter(value.values())) if isinstance(value, Mapping) else [value] for value in trained]
    numbers = [number for each in lists for number in each]
    return min(numbers), max(numbers)


def write_over_page(over: Over, setting: Setting, folder: Path) -> list[Path]:
    """Write the page, its picture and its numbers into a folder. Return the paths of all but the page's picture.

    Raises StorageError.
    """
    bands = {
        label: Band(over.sweep.places, *(list(each) for each in zip(*found, strict=True)))
        for label, found in over.estimates.items()
    }
    names = over.sweep.key, f"{over.metric}, {over.center}"
    draws = {f"scores{setting.mark}": lambda: draw_over(bands, over.sweep.values, names, over.span)}
    figures = draw_themes(draws, folder / PICTURES, setting.figures)
    text = page_text(over, setting)
    files = {
        "page.md": text,
        "page.html": page_html(text, folder),
        "scores.csv": scores_csv(over),
        "scores.tex": scores_tex(over),
        "compare.json": json.dumps(as_data(over, setting), indent=1, ensure_ascii=False) + "\n",
    }
    return [*write_files(files, folder, setting.mark), *figures]


def page_text(over: Over, setting: Setting) -> str:
    """Return the page as Markdown."""
    key, counts = escaped(over.sweep.key), over.counts
    episodes = next(iter(over.runs[0].values()))[0].episodes
    introduction = (
        f"{runs_text(counts)} per variant. The score of a run is the mean *{escaped(over.metric)}* of the "
        f"{episodes:,} episodes that its policy plays under each value of `{over.sweep.key}`, in a test without "
        f"learning, {escaped(setting.test)}; the games of all have the same seed. Higher is better."
        f"{intervals_sentences(counts)} No pairs are tested here: choose one value beforehand, and test it with "
        "`--test`."
    )
    blocks = [f"# {escaped(setting.game)}: {len(over.estimates)} variants over {key}", introduction]
    blocks += [*warnings(setting), f"## Scores over {key}", over_table(over)]
    trained = "; gray: as trained" if over.span else ""
    caption = f"{over.center} over runs of each variant, with its 95 % interval, over {key}{trained}"
    blocks += [picture_block(f"scores{setting.mark}", caption)]
    blocks += [setting.settings] if setting.settings else []
    blocks += [made_with] if (made_with := made_with_block(setting.made_with, setting.played)) else []
    blocks += ["## Again", f"```\n{setting.command}\n```"]
    return "\n\n".join(blocks) + "\n"


def over_table(over: Over) -> str:
    """Return the interquartile means with their intervals as a table in Markdown: a row per variant."""
    heads = [f"variant, {over.center} under {over.sweep.key}=", *over.sweep.values]
    return table([escaped(head) for head in heads], _rows(over, escaped))


def scores_csv(over: Over) -> str:
    """Return a line per run and value: the variant, the seed, the value, and the score."""
    lines = [
        (label, run.seed, value, repr(run.score))
        for label in over.runs[0]
        for value, runs in zip(over.sweep.values, over.runs, strict=True)
        for run in runs[label]
    ]
    return csv_text([("variant", "seed", over.sweep.key, over.metric), *lines])


def scores_tex(over: Over) -> str:
    """Return the interquartile means with their intervals as a table for LaTeX."""
    first = f"{over.center} [95\\,\\%], {latex(over.sweep.key)}="
    heads = [first, *map(latex, over.sweep.values)]
    return tabular(heads, [[latex(cell) for cell in row] for row in _rows(over, str)])


def as_data(over: Over, setting: Setting) -> dict[str, Any]:
    """Return all numbers as plain data."""
    return {
        "game": setting.game,
        "metric": over.metric,
        "key": over.sweep.key,
        "missing": list(setting.missing),
        "made_with": [each._asdict() for each in setting.made_with],
        "played_with": setting.played and setting.played._asdict(),
        "variants": [
            {
                "label": label,
                "policy": setting.policies[label],
                "seeds": [run.seed for run in over.runs[0][label]],
                "values": [
                    {"value": value, "scores": [run.score for run in runs[label]], "iqm": found._asdict()}
                    for value, runs, found in zip(over.sweep.values, over.runs, estimates, strict=True)
                ],
            }
            for label, estimates in over.estimates.items()
        ],
    }


def _rows(over: Over, written: Callable[[str], str]) -> list[list[str]]:
    """Return the cells of the table, a row per variant. written: how a label is."""
    return [
        [written(label), *(interval_text(one, len(over.runs[0][label]) > 1) for one in found)]
        for label, found in over.estimates.items()
    ]
