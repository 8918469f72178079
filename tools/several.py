"""Compare one policy for six games with a policy for each: `python -m tools.several --seeds 0,1,2`.

All runs have the settings of one of `STUDIES`, but for their length and that of `penalty_ramp`. Runs in `runs/CONFIG`
that are complete are not repeated. Adds scores to `scores.json` beside the page, and writes the page about all of them.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from textwrap import fill
from typing import NamedTuple

import numpy as np

from joybridge.compare.estimators import interquartile_mean
from joybridge.compare.page_parts import table
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from joybridge.run.checkpoint import checkpoints
from tools.command_line import joybridge

RUNS, RESULTS = Path("runs"), Path("results")
EPISODES = 96  # of an evaluation
RESAMPLES = 10_000
WIDTH = 120  # of the lines of the page
# Metrics that count in place of the reward: from far away, catch_point pays more for wasted catches than for steering.
SCORES = {"catch_point": "success", "goal": "success", "hard_move": "success"}
# What differs when a game is played alone. Each arena of chimp is a process, so a hundred would be too many.
ALONE = {"chimp": ["arenas=16", "policy.minibatch_size=100"]}
SINGLE, LONGER, JOINT = "a policy for each", "a policy for each, 6 times", "joint, 6 times"
KINDS: dict[str, tuple[int, list[str], str]] = {  # of runs: timesteps beside those of `SINGLE`, what differs, why
    SINGLE: (1, [], ""),
    LONGER: (6, [], "has learned from as many timesteps of its one game as a joint policy has of all"),
    "joint": (1, [], ""),
    JOINT: (6, [], ""),
    "told, 6 times": (6, ["tell_game=true"], "knows which game it plays; the others have to see it"),
    "by progress, 6 times": (6, ["share_by=progress"], "learns more often from games whose rewards change"),
    "unscaled, 6 times": (6, ["policy.scale_rewards=false"], "has rewards as the games pay them"),
}
SPEED = "timesteps per second"  # of a run: begins the name of a column beside those of games
Scores = dict[str, dict[str, dict[str, float]]]  # kind, game, seed: score


class Study(NamedTuple):
    """What is compared with the settings of one configuration."""

    config: Path
    page: Path
    timesteps: int  # of a policy of one game whose share is 1
    ramp: float  # share of a run in which penalties grow to their full size
    note: str  # what the page says beside what follows from its scores

    @property
    def folder(self) -> Path:
        """Return where its runs are."""
        return RUNS / self.config.stem

    @property
    def shares(self) -> dict[str, float]:
        """Return its games, with the share of each."""
        return {game: one.share for game, one in load_config(self.config).games.items()}


STUDIES = {
    "six_numbers": Study(
        Path("configs/several/six_numbers.yaml"),
        RESULTS / "several" / "README.md",
        600_000,
        1 / 3,
        "[Seed 0 of the second joint policy plays all six](../videos/six-games.mp4) (`joybridge record "
        "runs/six_numbers/joint-6-times-s0 six-games.mp4 --seconds 8`).",
    ),
    "six_pictures": Study(
        Path("configs/several/six_pictures.yaml"),
        RESULTS / "several-pictures" / "README.md",
        300_000,
        1.0,
        "Alone, archer, orchard and marble are seen in color, and no image is surrounded by black. [Seed 0 of the "
        "second joint policy plays all six](../videos/six-games-pictures.mp4) (`joybridge record "
        "runs/six_pictures/joint-6-times-s0 six-games-pictures.mp4 --seconds 8`).",
    ),
}


def main() -> None:
    """Train what is missing, evaluate it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", choices=[*STUDIES], default="six_numbers", help="default %(default)s")
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS], default=[*KINDS], help="default: all")
    options = parser.parse_args()
    study = STUDIES[options.config]
    known = study.page.with_name("scores.json")
    scores: Scores = json.loads(known.read_text()) if known.exists() else {}
    if SINGLE not in scores and SINGLE not in options.kinds:
        parser.error(f"--kinds: others are compared with {SINGLE!r}, which was not trained yet; name it, too")
    for seed in options.seeds.split(","):
        for kind in options.kinds:
            for run, end, changes in runs_of(study, kind):
                found, speed = play(study, f"{run}-s{seed}", end, [*changes, f"seed={seed}"])
                for column, value in {**found, f"{SPEED} of {run}": speed}.items():
                    scores.setdefault(kind, {}).setdefault(column, {})[seed] = value
    known.write_text(json.dumps(scores, indent=1) + "\n")
    study.page.write_text(page(study, scores), encoding="utf-8")


def runs_of(study: Study, kind: str) -> list[tuple[str, int, list[str]]]:
    """Return the runs of a kind and a seed: names, timesteps, and what differs from the configuration."""
    shares, (times, changes, _) = study.shares, KINDS[kind]
    if not kind.startswith(SINGLE):
        end = round(times * study.timesteps * sum(shares.values()) / len(shares))
        return [(_file_name(kind), end, changes)]
    return [
        (
            _file_name(kind.replace(SINGLE, game)),
            round(times * study.timesteps * own),
            [*(f"games.{other}=null" for other in shares if other != game), *ALONE.get(game, []), *changes],
        )
        for game, own in shares.items()
    ]


def play(study: Study, name: str, end: int, changes: Sequence[str]) -> tuple[dict[str, float], float]:
    """Train a run if it is not complete. Return its score in each of its games, and its timesteps per second."""
    run, ramp = study.folder / name, round(end * study.ramp)
    train(study.config, run, end, [f"policy.penalty_ramp={ramp}", f"log_interval={end // 20}", *changes])
    last_row = read_rows(run / "metrics-player.csv")[-1]
    return scores_of(run), last_row["timesteps"] / last_row["seconds"]


def page(study: Study, scores: Scores) -> str:
    """Return the page about some scores."""
    kinds, shares = [kind for kind in KINDS if kind in scores and kind != SINGLE], study.shares
    found = {kind: np.array([[*scores[kind][game].values()] for game in shares]) for kind in (SINGLE, *kinds)}
    alike: dict[str, list[str]] = {}  # kinds by their seeds
    for kind in found:
        alike.setdefault(",".join(next(iter(scores[kind].values()))), []).append(quote(kind))
    begin = f"python -m tools.several --config {study.config.stem}"
    made_by = (f"`{begin} --seeds {seeds} --kinds {' '.join(some)}`" for seeds, some in alike.items())
    fewer = [f", of `{game}` {round(study.timesteps * own):,}" for game, own in shares.items() if own != 1]
    success = [f" (`{game}`: of the share of successes)" for game in shares if game in SCORES]
    alone = [f"Alone, `{game}` has `{' '.join(changes)}`. " for game, changes in ALONE.items() if game in shares]
    made = (
        f"Made in the checkout by {' and '.join(made_by)}: `{study.config}`. A policy of one game has learned from "
        f"{study.timesteps:,} timesteps{''.join(fewer)}; `joint` from a sixth of what all six together have, the "
        f"other joint ones from all of it. A number is the mean over n seeds of the interquartile mean of {EPISODES} "
        f"returns{''.join(success)}. Beside it is its share of that of a policy for each game, with the 95 % interval "
        f"of a bootstrap over the seeds, which so few make narrower than it should be. {''.join(alone)}{study.note}"
    )
    single, rows = found[SINGLE], []
    for number, game in enumerate(shares):
        own = slice(number, number + 1)
        cells = [f"{found[kind][number].mean():.2f}, {share(found[kind][own], single[own])}" for kind in kinds]
        rows.append([f"`{game}`", f"{single[number].mean():.2f}", *cells])
    rows.append(["mean of the shares", "", *(share(found[kind], single) for kind in kinds)])
    rows.append(["worst game", "", *(f"{_least(found[kind], single):z.0%}" for kind in kinds)])
    remarks = []
    for kind in kinds:
        _, changes, why = KINDS[kind]
        if why:
            remarks.append(filled(f"- `{kind}`{f' (`{changes[0]}`)' if changes else ''} {why}."))
    if {LONGER, JOINT} <= {*kinds}:
        long, joint = found[LONGER], found[JOINT]
        remarks.append(
            filled(
                f"- `{JOINT}` reaches {share(joint, long)} of `{LONGER}`, in the worst game {_least(joint, long):.0%}."
            )
        )
    pace = []
    for kind in found:
        speeds = [
            each for column, values in scores[kind].items() if column.startswith(SPEED) for each in values.values()
        ]
        pace.append(f"{kind}: {np.median(speeds):,.0f}")
    lines = [
        f"# One policy for six games, and one for each, from {study.config.stem.removeprefix('six_')}",
        "",
        filled(made),
        "",
        table(["game", *(f"{kind} (n = {each.shape[1]})" for kind, each in found.items())], rows),
        "",
        *([*remarks, ""] if remarks else []),
        filled(f"Timesteps/s, medians, on shared machines whose load changed from run to run: {'; '.join(pace)}."),
        "",
    ]
    return "\n".join(lines)


def filled(text: str) -> str:
    """Return a text in lines of a page."""
    return fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def train(config: Path, run: Path, end: int, words: Sequence[str]) -> None:
    """Train a run to so many timesteps if it is not complete."""
    saved = checkpoints(run)
    if not saved or int(saved[-1].name) < end:
        resume = ["--resume"] if saved else []
        joybridge("train", str(config), "--run", str(run), f"total_timesteps={end}", *words, *resume)


def scores_of(run: Path) -> dict[str, float]:
    """Return the score of a run in each of its games: the interquartile mean of the returns, or see `SCORES`."""
    known = run / "evaluation.json"
    if not known.exists():
        known.write_text(joybridge("evaluate", str(run), "--episodes", str(EPISODES), "--json").splitlines()[-1])
    played = {game: found["player"] for game, found in json.loads(known.read_text()).items()}
    return {
        game: each["means"][SCORES[game]] if game in SCORES else _iqm(np.array(each["returns"]))
        for game, each in played.items()
    }


def share(joint: Array, single: Array) -> str:
    """Return the share of joint policies' scores in single ones', both [games, seeds]: a mean over games, as text."""
    middle = (joint.mean(axis=1) / single.mean(axis=1)).mean()
    if 1 in (joint.shape[1], single.shape[1]):
        return f"{middle:z.0%}"
    rng = np.random.default_rng(0)
    drawn = [
        scores[:, rng.integers(0, scores.shape[1], (RESAMPLES, scores.shape[1]))].mean(axis=2)
        for scores in (joint, single)
    ]
    low, high = np.quantile((drawn[0] / drawn[1]).mean(axis=0), [0.025, 0.975])
    return f"{middle:.0%} [{low:z.0%}, {high:z.0%}]"


def _least(joint: Array, single: Array) -> float:
    return float((joint.mean(axis=1) / single.mean(axis=1)).min())


def _file_name(kind: str) -> str:
    return kind.replace(", ", "-").replace(" ", "-")


def _iqm(returns: Array) -> float:
    return float(interquartile_mean(returns[:, None]))


if __name__ == "__main__":
    main()
