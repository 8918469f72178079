"""How soon a policy learns a game that is new to it, and what that costs other games: `python -m tools.seventh`.

A policy begins from nothing, from the policy of six games of `tools.several`, or from that of one of them, and learns a
seventh game alone. Or the seventh joins the six, which are played on. Runs in `runs/seventh` that are complete are not
repeated. Writes `results/seventh/README.md`, and what is behind it, `curves.json`.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from joybridge.compare.page_parts import table
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from tools.several import RESULTS, RUNS, STUDIES, filled, scores_of, share, train

SIX = STUDIES["six_numbers"]
TIMESTEPS = SIX.timesteps
LOGGED = 40  # rows of a run
METRIC, ENOUGH = "success", 0.8  # of what a policy that begins from nothing has at the end
LAST = 3  # rows whose mean counts as the end
# What a policy begins from, and `JOINS`, where the six games are played on; other names are runs of one game.
NOTHING, ALL, JOINS = "nothing", "joint-6-times", "joins"
NAMES = {NOTHING: "nothing", ALL: "six games", JOINS: "six games, played on"}
GAMES = len(SIX.shares) + 1
JOINED = 2 * TIMESTEPS  # of all seven games together


class Found(NamedTuple):
    """What the page is about."""

    curves: dict[str, dict[str, list[list[float]]]]  # game, what it begins from: success [seeds][rows]
    before: list[list[float]]  # scores of the six games [games][seeds]
    after: dict[str, list[list[float]]]  # the same once a game has joined


def main() -> None:
    """Train what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--games", default="goal,hard_move", help="default %(default)s")
    parser.add_argument(
        "--ones", default="catch_point,marble", help="of the six, which one played; default %(default)s"
    )
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    options = parser.parse_args()
    games, seeds = options.games.split(","), options.seeds.split(",")
    starts = [NOTHING, ALL, *options.ones.split(","), JOINS]
    curves = {game: {start: [learn(game, start, seed) for seed in seeds] for start in starts} for game in games}
    before = [scores_of(SIX.folder / f"{ALL}-s{seed}") for seed in seeds]
    after = {game: [scores_of(_run(game, JOINS, seed)) for seed in seeds] for game in games}
    found = Found(curves, _table(before), {game: _table(each) for game, each in after.items()})
    (RESULTS / "seventh" / "curves.json").write_text(json.dumps(found._asdict()) + "\n")
    (RESULTS / "seventh" / "README.md").write_text(page(found), encoding="utf-8")


def learn(game: str, start: str, seed: str) -> list[float]:
    """Let a policy learn a game if it has not, and return the rows of its success in training."""
    run, end = _run(game, start, seed), JOINED if start == JOINS else TIMESTEPS
    begun = ALL if start == JOINS else start
    words = [] if start == NOTHING else ["--from", str(SIX.folder / f"{begun}-s{seed}")]
    words += [] if start == JOINS else [f"games.{other}=null" for other in SIX.shares]
    own = [f"games.{game}={{}}", "policy.penalty_ramp=0", f"log_interval={end // LOGGED}", f"seed={seed}"]
    train(SIX.config, run, end, [*words, *own])
    return [row.get(f"{game}.{METRIC}", 0.0) for row in read_rows(run / "metrics-player.csv")]


def _run(game: str, start: str, seed: str) -> Path:
    return RUNS / "seventh" / f"{game}-{start if start == JOINS else f'from-{start}'}-s{seed}"


def _table(scores: Sequence[Mapping[str, float]]) -> list[list[float]]:
    """Return scores of seeds as [games][seeds]."""
    return [[each[game] for each in scores] for game in SIX.shares]


def page(found: Found) -> str:
    """Return the page about the results."""
    seeds = len(found.before[0])
    made = (
        f"Made in the checkout by `python -m tools.seventh`, after `python -m tools.several`, with the settings of "
        f"`{SIX.config}`, but penalties have their full size from the first timestep on. A policy learns a game that "
        f"none of the six is, for {TIMESTEPS:,} timesteps, and begins from nothing, from the policy of six games "
        f"(`joint, 6 times`), or from that of one of them. Or the game joins the six, for {JOINED:,} timesteps of all "
        f"seven, of which it has a seventh. Its timesteps until {ENOUGH:.0%} of the success that policies from nothing "
        f"have at the end of training (the mean of the last {LAST} of {LOGGED} rows), and, if every run has "
        "so much at some time, their share of those from nothing, with the 95 % interval of a bootstrap over the seeds "
        f"(n = {seeds}; so few make it narrower than it should be)."
    )
    heads = ["game", "begins from", "success at the end", "timesteps until enough, of each seed", "share"]
    rows = []
    for game, of_game in found.curves.items():
        curves = {start: np.array(each) for start, each in of_game.items()}  # [seeds, rows]
        enough = ENOUGH * curves[NOTHING][:, -LAST:].mean()
        times = {start: reached(each, enough, start) for start, each in curves.items()}
        for start, each in times.items():
            known = start != NOTHING and np.isfinite([*each, *times[NOTHING]]).all()
            part = share(each[None], times[NOTHING][None]) if known else ""
            shown = ", ".join(f"{time:,.0f}" if np.isfinite(time) else "never" for time in each)
            rows.append(
                [f"`{game}`", NAMES.get(start, f"`{start}`"), f"{curves[start][:, -LAST:].mean():.2f}", shown, part]
            )
    before, after = np.array(found.before), [np.array(each) for each in found.after.values()]
    joined = []
    for number, game in enumerate(SIX.shares):
        own = slice(number, number + 1)
        cells = [f"{each[number].mean():.2f}, {share(each[own], before[own])}" for each in after]
        joined.append([f"`{game}`", f"{before[number].mean():.2f}", *cells])
    joined.append(["mean of the shares", "", *(share(each, before) for each in after)])
    joins = (
        "Scores of the six as in [six games](../several/README.md), before a seventh joins them and after it, and "
        "their share of what they were:"
    )
    beside = table(["game", "before", *(f"{game} has joined" for game in found.after)], joined)
    return "\n\n".join(["# A seventh game", filled(made), table(heads, rows), filled(joins), beside]) + "\n"


def reached(curves: Array, enough: float, start: str) -> Array:
    """Return at which of its timesteps curves [seeds, rows] first have enough, [seeds]; inf if they never do."""
    have = curves >= enough
    first = np.where(have.any(axis=1), have.argmax(axis=1) + 1, np.inf)
    times: Array = first * (JOINED / GAMES if start == JOINS else TIMESTEPS) / curves.shape[1]
    return times


if __name__ == "__main__":
    main()
