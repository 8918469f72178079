"""`joybridge compare --suite`: the same comparison on all tasks of a suite, and one page about them."""

import argparse
import shlex
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import mean
from typing import Any

from pydantic import TypeAdapter

from joybridge.compare.launch import number, seed_words
from joybridge.compare.names import file_name, page_mark
from joybridge.compare.page_parts import PICTURES, escaped, page_html, picture_block, table, write_files
from joybridge.compare.page_settings import own_settings
from joybridge.compare.pictures import Line, draw_themes, draw_times
from joybridge.compare.suites import SUITES, Task
from joybridge.compare.table import read_table
from joybridge.compare.variants import read_variants
from joybridge.config.errors import ConfigError
from joybridge.config.json_files import read_json
from joybridge.config.metrics import numbers
from joybridge.progress import say

MAX_BYTES = 2**26  # of the numbers of a comparison
TIMES = "seconds"  # the picture of scores over them


def compare_suite(options: argparse.Namespace, compare: Callable[[Namespace], int]) -> int:
    """Compare on every task, each in a folder of its name, and write the page; return 1 if anything is missing."""
    suite, missing, status = SUITES[options.suite], dict[str, str](), 0
    if unknown := [name for name in options.tasks if name not in suite.tasks]:
        raise ConfigError(f"--tasks got {' '.join(unknown)}; {options.suite} has {', '.join(suite.tasks)}")
    for name, task in suite.tasks.items():
        if options.tasks and name not in options.tasks:
            continue
        say(f"{options.suite}: {name}")
        given = Namespace(**vars(options))
        given.config, given.output = task.config, options.output / name
        given.overrides = [*task.overrides, *options.overrides]
        if not (options.layouts or options.set or options.change):  # then these are what varies
            given.layouts, given.change = [*task.layouts], [*task.changes]
        given.metric, given.beside = task.scored, suite.beside
        if task.gym and not options.simulator:
            given.game = [f"gym:{task.gym}"]
        try:
            status |= compare(given)
        except ConfigError as error:
            missing[name] = str(error)
            say(f"missing: {name}: {error}")
    if len(missing) == len(options.tasks or suite.tasks):
        raise ConfigError("there is nothing to compare, because every task is missing")
    for path in write_suite(options.suite, options.output, again(options), missing, options.figures):
        print(path)
    return 1 if missing else status


def again(options: argparse.Namespace) -> str:
    """Return the command that makes the comparison again."""
    words = ["joybridge", "compare", "--suite", options.suite]
    words += ["--tasks", *options.tasks] if options.tasks else []
    words += ["--layouts", *options.layouts] if options.layouts else []
    words += ["--set", *options.set] if options.set else []
    words += ["--change", *options.change] if options.change else []
    words += ["--pairs", *options.pairs] if options.pairs else []
    words += ["--ppo", options.ppo] if options.ppo != "{}" else []
    words += ["--behavior", options.behavior] if options.behavior else []
    words += ["--score", number(options.score)] if options.score is not None else []
    words += ["--figures", options.figures] if options.figures else []
    return shlex.join([*words, *seed_words(options), "--output", options.output.name, *options.overrides])


def write_suite(name: str, folder: Path, command: str, missing: dict[str, str], figures: str = "") -> list[Path]:
    """Write the page of a suite, from the numbers of the comparisons in the folder. Raises StorageError.

    figures: see `draw_themes`.
    """
    suite = SUITES[name]
    found = {task: data for task, each in suite.tasks.items() if (data := _numbers(folder / task, each)) is not None}
    metrics = sorted({f"*{suite.tasks[task].metric}*" for task in found})
    heads = ["task", "timesteps", "settings", *([suite.aims] if suite.aims else [])]
    rows = []
    for task, data in found.items():
        scored = f", *{suite.tasks[task].metric}*" if len(metrics) > 1 else ""
        aim = [suite.tasks[task].aim] if suite.aims else []
        cells = [f"{task}{scored}", f"{_timesteps(data, folder / task):,}", _settings(folder / task), *aim]
        for variant in data["variants"]:
            rows.append([*cells, *_row(variant, data["wall_clock"][variant["label"]])])
            cells = [""] * len(cells)
    lines = {task: _lines(folder / task, data, suite.tasks[task].metric) for task, data in found.items()}
    drawn = draw_themes({TIMES: partial(draw_times, lines)}, folder / PICTURES, figures)
    notes = [f"- {task}: {reason}" for task, reason in missing.items()]
    blocks = [
        f"# The suite {name}",
        f"The mean {' or '.join(metrics)} of the episodes that each run's policy plays at the end, with the most "
        "probable actions and without learning: the interquartile mean over seeds (of three or fewer, the mean), with "
        "its 95 % interval, and the score of each seed. Settings are the keys that differ from the preset, or from our "
        "defaults without one. Seconds are the mean wall-clock time of a training, beside whatever else the machine "
        "did.",
        table([*heads, "variant", "score", "of each seed", "seconds"], rows),
        *(["These tasks are missing:\n\n" + "\n".join(notes)] if notes else []),
        "Each task has a page of its own, with curves and tests, in the folder of its name.",
        picture_block(TIMES, "Each run: the score of its episodes in training, with sampled actions, over seconds"),
        f"## Again\n\n```sh\n{command}\n```",
    ]
    text = "\n\n".join(blocks) + "\n"
    files = {"page.md": text, "page.html": page_html(text, folder)}
    return [*write_files(files, folder), *drawn]


def _numbers(folder: Path, task: Task) -> dict[str, Any] | None:
    """Return the numbers of the comparison of a task, None if there are none."""
    path = folder / f"compare{page_mark(task.scored)}.json"
    return read_json(path, TypeAdapter(dict[str, Any]), MAX_BYTES, "delete it, and repeat the command")


def _timesteps(data: dict[str, Any], folder: Path) -> int:
    """Return how long the runs of a task are; their curve has no point if no two runs ended an episode together."""
    ends = [variant.config.end for variant in read_variants(folder).values()]
    curves = [each["curve"]["timesteps"] for each in data["variants"]]
    return max((int(curve[-1]) for curve in curves if curve), default=max(ends, default=0))


def _settings(folder: Path) -> str:
    """Return how many keys of the first variant differ from its preset."""
    return f"{len(own_settings(next(iter(read_variants(folder).values())).config))}"


def _lines(folder: Path, data: dict[str, Any], metric: str) -> list[Line]:
    """Return a line over seconds for each run of a task."""
    labels = {file_name(each["label"]): each["label"] for each in data["variants"]}
    lines = []
    for name, cells in read_table(folder).items():
        points = [(row["seconds"], row[metric]) for row in numbers(cells) if metric in row and "seconds" in row]
        if name.run.experiment in labels and points:
            lines.append(Line(labels[name.run.experiment], *map(list, zip(*points, strict=True))))
    return sorted(lines, key=lambda line: [*labels.values()].index(line.label))  # as in the table


def _row(variant: dict[str, Any], times: dict[str, Any]) -> list[str]:
    """Return a variant's label, its mean with its interval, the score of each seed, and the mean seconds of a run."""
    iqm, seconds = variant["iqm"], [each for each in times["seconds"] if each is not None]
    digits = 3 if abs(iqm["value"]) < 10 else 1
    return [
        escaped(variant["label"]),
        f"**{iqm['value']:.{digits}f}** [{iqm['low']:.{digits}f}, {iqm['high']:.{digits}f}]",
        ", ".join(f"{score:.{digits}f}" for score in variant["scores"]),
        f"{mean(seconds):.0f}" if seconds else "–",
    ]
