"""Compare one policy for six games with a policy for each: `python -m tools.several --seeds 0,1,2`.

All runs have the settings of `configs/several/six_numbers.yaml`, or of `six_pictures.yaml`, but for their length and
that of `penalty_ramp`. Runs in `runs/CONFIG` that are complete are not repeated. Adds scores to `scores.json` in
`results/several` or `results/several-pictures`, and writes the page about all that are there.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from joybridge.compare.estimators import interquartile_mean
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from joybridge.run.checkpoint import checkpoints

CONFIGS, RUNS, RESULTS = Path("configs/several"), Path("runs"), Path("results")
PAGES = {"six_numbers": "several", "six_pictures": "several-pictures"}  # folders of results, by configuration
TIMESTEPS = {"six_numbers": 600_000, "six_pictures": 300_000}  # of a policy of one game whose share is 1
RAMPS = {"six_numbers": 1 / 3, "six_pictures": 1.0}  # of a run, in which penalties grow to their full size
EPISODES = 96  # of an evaluation
RESAMPLES = 10_000
WIDTH = 120  # of the lines of the page
# Metrics that count in place of the reward: from far away, catch_point pays more for wasted catches than for steering.
SCORES = {"catch_point": "success", "goal": "success", "hard_move": "success"}
# What differs when a game is played alone. Each arena of chimp is a process, so a hundred would be too many.
ALONE = {"chimp": ["arenas=16", "policy.minibatch_size=100"]}

NOTES = {  # what a page says beside what follows from its scores
    "six_numbers": " [Seed 0 of the second joint policy plays all six](../videos/six-games.mp4) (`joybridge record "
    "runs/six_numbers/joint-6-s0 six-games.mp4 --seconds 8`).",
    "six_pictures": " Alone, archer, orchard and marble are seen in color, and no image is surrounded "
    "by black. [Seed 0 of the second joint policy plays all six](../videos/six-games-pictures.mp4) (`joybridge "
    "record runs/six_pictures/joint-6-s0 six-games-pictures.mp4 --seconds 8`).",
}


class Kind(NamedTuple):
    """A kind of joint runs."""

    times: int  # of the timesteps of a policy of one game
    changes: Sequence[str] = ()
    why: str = ""
    beside: int = 1  # of the timesteps of a policy of one game: of those that it is compared with

    @property
    def run(self) -> str:
        """Return the name of its runs, but for the seed."""
        return "-".join(["joint", str(self.times), *(change.partition("=")[0] for change in self.changes)])


KINDS = {
    "joint": Kind(1),
    "joint, 6 times": Kind(6),
    "told, 6 times": Kind(6, ["tell_game=true"], "knows which game it plays; the others have to see it"),
    "by progress, 6 times": Kind(6, ["share_by=progress"], "learns more often from games whose rewards change"),
    "unscaled, 6 times": Kind(6, ["policy.scale_rewards=false"], "has rewards as the games pay them"),
    "joint, 6 times as long": Kind(6, beside=6),
}
SPEED = "timesteps per second"  # of a run: begins the name of a column beside those of games
Scores = dict[str, dict[str, dict[str, float]]]  # kind, game, seed: score


def main() -> None:
    """Train what is missing, evaluate it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", choices=[*PAGES], default="six_numbers", help="default %(default)s")
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS], default=[*KINDS], help="joint runs; default: all")
    options = parser.parse_args()
    study, folder = Study(options.config), RESULTS / PAGES[options.config]
    known = folder / "scores.json"
    scores: Scores = json.loads(known.read_text()) if known.exists() else {}
    for seed in options.seeds.split(","):
        for kind in (*single_kinds(options.kinds), *options.kinds):
            for run, end, changes in study.runs(kind):
                found, speed = study.play(f"{run}-s{seed}", end, [*changes, f"seed={seed}"])
                for column, value in {**found, f"{SPEED} of {run}": speed}.items():
                    scores.setdefault(kind, {}).setdefault(column, {})[seed] = value
    known.write_text(json.dumps(scores, indent=1) + "\n")
    (folder / "README.md").write_text(study.page(scores), encoding="utf-8")


def single_kinds(kinds: Sequence[str]) -> list[str]:
    """Return the kinds of policies of one game that joint ones are compared with."""
    return [single_kind(times) for times in sorted({KINDS[kind].beside for kind in kinds})]


def single_kind(times: int) -> str:
    """Return the kind of policies of one game that learn so many times as long as the shortest."""
    return "a policy for each" + (f", {times} times" if times > 1 else "")


class Study:
    """The runs of one configuration, and the page about them."""

    def __init__(self, name: str) -> None:
        """Take the name of a configuration of several games."""
        self.config, self.folder = CONFIGS / f"{name}.yaml", RUNS / name
        self.timesteps, self.ramp = TIMESTEPS[name], RAMPS[name]
        self.shares = {game: one.share for game, one in load_config(self.config).games.items()}

    def runs(self, kind: str) -> list[tuple[str, int, list[str]]]:
        """Return the runs of a kind and a seed: names, timesteps, and what differs from the configuration."""
        if kind in KINDS:
            found = KINDS[kind]
            end = round(found.times * self.timesteps * sum(self.shares.values()) / len(self.shares))
            return [(found.run, end, [*found.changes])]
        times = next(each.beside for each in KINDS.values() if single_kind(each.beside) == kind)
        return [
            (
                f"{game}-{times}",
                round(times * self.timesteps * share),
                [*(f"games.{other}=null" for other in self.shares if other != game), *ALONE.get(game, [])],
            )
            for game, share in self.shares.items()
        ]

    def play(self, name: str, end: int, changes: Sequence[str]) -> tuple[dict[str, float], float]:
        """Train a run if it is not complete.

        Return its score in each of its games, and its timesteps per second.
        """
        run = self.folder / name
        train(
            self.config,
            run,
            end,
            [f"policy.penalty_ramp={round(end * self.ramp)}", f"log_interval={end // 20}", *changes],
        )
        last_row = read_rows(run / "metrics-player.csv")[-1]
        return scores_of(run), last_row["timesteps"] / last_row["seconds"]

    def page(self, scores: Scores) -> str:
        """Return the page about some scores."""
        kinds = [kind for kind in KINDS if kind in scores]
        fewer = [f", of `{game}` {round(self.timesteps * own):,}" for game, own in self.shares.items() if own != 1]
        alone = [
            f" Alone, `{game}` has `{' '.join(changes)}`." for game, changes in ALONE.items() if game in self.shares
        ]
        success = [f" (`{game}`: of the share of successes)" for game in self.shares if game in SCORES]
        made = (
            f"Made in the checkout by `python -m tools.several --config {self.config.stem}`: `{self.config}`. A policy "
            f"of one game has learned from {self.timesteps:,} timesteps{''.join(fewer)}; `joint` from a sixth of what "
            f"all six together have, the others from all of it. A number is the mean over n seeds of the interquartile "
            f"mean of {EPISODES} returns{''.join(success)}. Beside it is its share of that of a policy for each game, "
            f"with the 95 % interval of a bootstrap over the seeds, which so few make narrower than it should be."
            f"{''.join(alone)}{NOTES.get(self.config.stem, '')}"
        )
        remarks = [
            f"- `{kind}` (`{' '.join(KINDS[kind].changes)}`) {KINDS[kind].why}." for kind in kinds if KINDS[kind].why
        ]
        tables = []
        for times in sorted({KINDS[kind].beside for kind in kinds}):
            beside = [kind for kind in kinds if KINDS[kind].beside == times]
            tables += [*self._table(scores, beside, single_kind(times)), ""]
        speeds = {
            kind: [each for column, values in of_kind.items() if column.startswith(SPEED) for each in values.values()]
            for kind, of_kind in scores.items()
        }
        pace = [f"{kind}: {np.median(values):,.0f}" for kind, values in speeds.items()]
        lines = [
            f"# One policy for six games, and one for each, from {self.config.stem.removeprefix('six_')}",
            "",
            fill(made, WIDTH, break_long_words=False, break_on_hyphens=False),
            "",
            *tables,
            *([*remarks, ""] if remarks else []),
            "Timesteps per second, medians, on shared machines whose load changed from run to run:",
            f"{'; '.join(pace)}.",
            "",
        ]
        return "\n".join(lines)

    def _table(self, scores: Scores, kinds: Sequence[str], beside: str) -> list[str]:
        """Return the rows of a table that compares kinds with policies of one game."""
        games = [*self.shares]
        found = {
            kind: np.array([[*scores[kind][game].values()] for game in games])  # [games, seeds]
            for kind in (beside, *kinds)
        }
        single, rows = found[beside], []
        for number, game in enumerate(games):
            own = slice(number, number + 1)
            cells = [f"{found[kind][number].mean():.2f}, {share(found[kind][own], single[own])}" for kind in kinds]
            rows.append(f"| {' | '.join([f'`{game}`', f'{single[number].mean():.2f}', *cells])} |")
        means = [share(found[kind], single) for kind in kinds]
        worst = [f"{(found[kind].mean(axis=1) / single.mean(axis=1)).min():z.0%}" for kind in kinds]
        heads = [f"{kind} (n = {each.shape[1]})" for kind, each in found.items()]
        return [
            f"| game | {' | '.join(heads)} |",
            f"| --- |{' --- |' * len(heads)}",
            *rows,
            f"| mean of the shares | | {' | '.join(means)} |",
            f"| worst game | | {' | '.join(worst)} |",
        ]


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


def joybridge(*words: str) -> str:
    """Run a command and return its output."""
    done = subprocess.run([sys.executable, "-m", "joybridge", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout


def share(joint: Array, single: Array) -> str:
    """Return the share of joint policies' scores in single ones', both [games, seeds]: a mean over games, as text."""
    middle = (joint.mean(axis=1) / single.mean(axis=1)).mean()
    if joint.shape[1] == 1:
        return f"{middle:z.0%}"
    rng = np.random.default_rng(0)
    drawn = [
        scores[:, rng.integers(0, scores.shape[1], (RESAMPLES, scores.shape[1]))].mean(axis=2)
        for scores in (joint, single)
    ]
    low, high = np.quantile((drawn[0] / drawn[1]).mean(axis=0), [0.025, 0.975])
    return f"{middle:.0%} [{low:z.0%}, {high:z.0%}]"


def _iqm(returns: Array) -> float:
    return float(interquartile_mean(returns[:, None]))


if __name__ == "__main__":
    main()
