"""How soon a policy learns a game that is new to it, and what that costs other games: `python -m tools.seventh`.

A policy begins from nothing, from the policy of six games of `tools.several`, or from that of one of them, and learns a
seventh game alone. Then the first of the seventh games joins the six. Runs in `runs/seventh` that are complete are not
repeated. Writes `results/several/seventh.md`, and what is behind it as JSON.
"""

import argparse
import json
from textwrap import fill
from typing import NamedTuple

import numpy as np

from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from tools.several import EPISODES, RESULTS, RUNS, WIDTH, Study, scores_of, share, train

SIX = Study("six_numbers")
TIMESTEPS = SIX.timesteps
FOLDER, LOGGED = RUNS / "seventh", 40  # rows of a run
METRIC, ENOUGH = "success", 0.8  # of what a policy that begins from nothing has at the end
LAST = 3  # rows whose mean counts as the end
NOTHING, ALL = "nothing", "joint-6"  # what a policy begins from; other names are runs of one game
JOINED = 2 * TIMESTEPS  # of all seven games together


class Found(NamedTuple):
    """What the page is about."""

    curves: dict[str, dict[str, list[list[float]]]]  # game, what it begins from: success [seeds][rows]
    before: list[list[float]]  # scores of the six games [games][seeds]
    after: list[list[float]]  # the same once the seventh has joined
    seventh: list[float]  # its success then [seeds]


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
    starts = [NOTHING, ALL, *(f"{one}-1" for one in options.ones.split(","))]
    curves: dict[str, dict[str, list[list[float]]]] = {game: {start: [] for start in starts} for game in games}
    for seed in seeds:
        for game in games:
            for start in starts:
                curves[game][start].append(learn(game, start, seed))
    before = [scores_of(SIX.folder / f"{ALL}-s{seed}") for seed in seeds]
    after = [join(games[0], seed) for seed in seeds]
    both = [[[each[game] for each in some] for game in SIX.shares] for some in (before, after)]
    found = Found(curves, both[0], both[1], [each[games[0]] for each in after])
    (RESULTS / "seventh.json").write_text(json.dumps(found._asdict()) + "\n")
    (RESULTS / "seventh.md").write_text(page(found), encoding="utf-8")


def learn(game: str, start: str, seed: str) -> list[float]:
    """Let a policy learn a game alone if it has not, and return the rows of its success in training."""
    run = FOLDER / f"{game}-from-{start}-s{seed}"
    begun = [] if start == NOTHING else ["--from", str(SIX.folder / f"{start}-s{seed}")]
    others = [f"games.{other}=null" for other in SIX.shares]
    train(SIX.config, run, TIMESTEPS, [*begun, *others, *_words(game, TIMESTEPS, seed)])
    return [row[f"{game}.{METRIC}"] for row in read_rows(run / "metrics-player.csv")]


def join(game: str, seed: str) -> dict[str, float]:
    """Let a game join the six if it has not, and return the score of each."""
    run = FOLDER / f"{game}-joins-s{seed}"
    train(SIX.config, run, JOINED, ["--from", str(SIX.folder / f"{ALL}-s{seed}"), *_words(game, JOINED, seed)])
    return scores_of(run)


def _words(game: str, end: int, seed: str) -> list[str]:
    """Return what differs from the six games: one more, penalties of full size, more rows."""
    return [f"games.{game}={{}}", "policy.penalty_ramp=0", f"log_interval={end // LOGGED}", f"seed={seed}"]


def page(found: Found) -> str:
    """Return the page about the results."""
    seeds = len(found.seventh)
    games = [*found.curves]
    made = (
        f"Made in the checkout by `python -m tools.seventh`, after `python -m tools.several`, with the settings of "
        f"`{SIX.config}`, but penalties have their full size from the first timestep on. A policy learns a game that "
        f"none of the six is, for {TIMESTEPS:,} timesteps, and begins from nothing, from the policy of six games "
        f"(`joint, 6 times`), or from that of one of them. Timesteps until {ENOUGH:.0%} of the success that policies "
        f"from nothing have at the end of training (the mean of the last {LAST} of {LOGGED} rows), and their share of "
        f"those from nothing, with the 95 % interval of a bootstrap over the seeds (n = {seeds}; so few make it "
        "narrower than it should be)."
    )
    lines = ["# A seventh game", "", *_filled(made), ""]
    lines += [
        "| game | begins from | success at the end | timesteps until enough | share |",
        "| --- | --- | --- | --- | --- |",
    ]
    for game in games:
        curves = {start: np.array(each) for start, each in found.curves[game].items()}  # [seeds, rows]
        enough = ENOUGH * curves[NOTHING][:, -LAST:].mean()
        nothing = reached(curves[NOTHING], enough)
        for start, each in curves.items():
            times = reached(each, enough)
            part = "" if start == NOTHING else share(times[None], nothing[None])
            each_time = ", ".join(f"{time:,.0f}" for time in times)
            lines.append(f"| `{game}` | {_name(start)} | {each[:, -LAST:].mean():.2f} | {each_time} | {part} |")
    before, after = np.array(found.before), np.array(found.after)
    joins = (
        f"Then `{games[0]}` joined the six: the policy of six games learned for another {JOINED:,} timesteps of all "
        f"seven. Scores as in [six games](README.md), means of {seeds} seeds; `{games[0]}` then succeeds in "
        f"{np.mean(found.seventh):.0%} of {EPISODES} episodes."
    )
    lines += ["", *_filled(joins), "", "| game | before | after | share |", "| --- | --- | --- | --- |"]
    for number, game in enumerate(SIX.shares):
        own = slice(number, number + 1)
        part = share(after[own], before[own])
        lines.append(f"| `{game}` | {before[number].mean():.2f} | {after[number].mean():.2f} | {part} |")
    return "\n".join([*lines, f"| mean of the shares | | | {share(after, before)} |", ""])


def reached(curves: Array, enough: float) -> Array:
    """Return at which timesteps curves [seeds, rows] first have enough, [seeds]; the last, if they never do."""
    rows = curves.shape[1]
    first = np.where((curves >= enough).any(axis=1), (curves >= enough).argmax(axis=1), rows - 1)
    times: Array = (first + 1) * TIMESTEPS / rows
    return times


def _name(start: str) -> str:
    return {NOTHING: "nothing", ALL: "six games"}.get(start, f"`{start.removesuffix('-1')}`")


def _filled(text: str) -> list[str]:
    return fill(text, WIDTH, break_long_words=False, break_on_hyphens=False).splitlines()


if __name__ == "__main__":
    main()
