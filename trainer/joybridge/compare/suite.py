"""`joybridge compare --suite`: the same comparison on all tasks of a suite, and one page about them."""

import argparse
import json
import shlex
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from joybridge.client.command_line import say
from joybridge.compare.page import page_html
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file

MAX_BYTES = 2**26  # of the numbers of a comparison
COUNTING = ("policy.only_with=true,false",)  # for tasks whose choices have parameters of their own


class Task(NamedTuple):
    """A task of a suite."""

    config: str  # the name of an installed configuration
    overrides: tuple[str, ...] = ()
    grid: tuple[str, ...] = ()  # what else varies, KEY=VALUE,VALUE each


SUITES = {
    "hybrid": {
        **{
            name: Task(f"hybrid_suite/{name}", grid=COUNTING)
            for name in ("platform", "goal", "hard_goal", "catch_point", "moving", "sliding")
        },
        **{f"hard_move-{n}": Task("hybrid_suite/hard_move", (f"options.actuators={n}",)) for n in (4, 6, 8, 10)},
    }
}
METRICS = {"hybrid": "success"}


def compare_suite(options: argparse.Namespace, compare: Callable[[Namespace], int]) -> int:
    """Compare on every task, each in a folder of its name, and write the page; return 1 if anything is missing."""
    missing: dict[str, str] = {}
    status = 0
    for name, task in SUITES[options.suite].items():
        say(f"{options.suite}: {name}")
        given = Namespace(**vars(options))
        given.config, given.output = task.config, options.output / name
        given.overrides, given.set = [*task.overrides, *options.overrides], [*task.grid, *options.set]
        given.metric = METRICS[options.suite]
        try:
            status |= compare(given)
        except ConfigError as error:
            missing[name] = str(error)
            say(f"missing: {name}: {error}")
    if len(missing) == len(SUITES[options.suite]):
        raise ConfigError("there is nothing to compare, because every task is missing")
    for path in write_suite(options.suite, options.output, again(options), missing):
        print(path)
    return 1 if missing else status


def again(options: argparse.Namespace) -> str:
    """Return the command that makes the comparison again."""
    words = ["joybridge", "compare", "--suite", options.suite]
    words += ["--layouts", *options.layouts] if options.layouts else []
    words += ["--set", *options.set] if options.set else []
    words += ["--change", *options.change] if options.change else []
    return shlex.join([*words, "--seeds", f"{options.seeds}", "--output", options.output.name, *options.overrides])


def write_suite(suite: str, folder: Path, command: str, missing: dict[str, str]) -> list[Path]:
    """Write the page of a suite, from the numbers of the comparisons in the folder. Raises StorageError."""
    found = {name: data for name in SUITES[suite] if (data := _numbers(folder / name)) is not None}
    labels = list(dict.fromkeys(each["label"] for data in found.values() for each in data["variants"]))
    head = [f"| task | timesteps | {' | '.join(labels)} |", f"|{'---|' * (2 + len(labels))}"]
    rows = [f"| {name} | {_timesteps(data):,} | {' | '.join(_cells(data, labels))} |" for name, data in found.items()]
    notes = [f"- {name}: {reason}" for name, reason in missing.items()]
    blocks = [
        f"# The suite {suite}",
        f"The mean *{METRICS[suite]}* of the last tenth of the rows of metrics, of sampled actions while learning: the "
        "interquartile mean over seeds, with its 95 % interval, and below it the score of each seed.",
        "\n".join([*head, *rows]),
        *(["These tasks are missing:\n\n" + "\n".join(notes)] if notes else []),
        "Each task has a page of its own, with curves and tests, in the folder of its name.",
        f"## Again\n\n```\n{command}\n```",
    ]
    text = "\n\n".join(blocks) + "\n"
    files = {"page.md": text, "page.html": page_html(text, folder)}
    for name, content in files.items():
        write_atomically(folder / name, content.encode())
    return [folder / name for name in files]


def _numbers(folder: Path) -> dict[str, Any] | None:
    """Return the numbers of a comparison, None if there are none."""
    try:
        data: dict[str, Any] = json.loads(read_file(folder / "compare.json", MAX_BYTES))
        return data
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{folder}/compare.json cannot be read ({error}); delete it, and repeat the command"
        ) from error


def _timesteps(data: dict[str, Any]) -> int:
    return max(int(each["curve"]["timesteps"][-1]) for each in data["variants"])


def _cells(data: dict[str, Any], labels: list[str]) -> list[str]:
    """Return a cell for each label: the mean with its interval, and the score of each seed."""
    cells = []
    variants = {each["label"]: each for each in data["variants"]}
    for label in labels:
        if (each := variants.get(label)) is None:
            cells.append("–")
            continue
        iqm = each["iqm"]
        scores = ", ".join(f"{score:.3f}" for score in each["scores"])
        cells.append(f"**{iqm['value']:.3f}** [{iqm['low']:.3f}, {iqm['high']:.3f}]<br>{scores}")
    return cells
