"""Compare one policy for six games with a policy for each: `python -m tools.several --seeds 0,1,2`.

All runs have the settings of `configs/several/six_numbers.yaml`. A policy of one game learns from 600,000 timesteps, a
joint one from as many of all games together, or from six times as many. In the first third of each run, penalties grow
to their full size. Runs in `runs/several` that are complete are not repeated. Writes `results/several/README.md` and
the scores behind it, `scores.json`.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote
from textwrap import fill

import numpy as np

from joybridge.compare.estimators import interquartile_mean
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from joybridge.run.checkpoint import checkpoints

CONFIG, RUNS, RESULTS = Path("configs/several/six_numbers.yaml"), Path("runs/several"), Path("results/several")
GAMES = [*load_config(CONFIG).games]
TIMESTEPS = 600_000  # of a policy of one game
EPISODES = 96  # of an evaluation: one in each arena
RESAMPLES = 10_000
WIDTH = 120  # of the lines of the page
# Metrics that count in place of the reward: from far away, catch_point pays more for wasted catches than for steering.
SCORES = {"catch_point": "success"}
SINGLE = "single"
KINDS: dict[str, tuple[int, list[str], str]] = {  # of joint runs: timesteps beside a single one's, what differs, why
    "joint": (1, [], ""),
    "joint, 6 times": (6, [], ""),
    "told, 6 times": (6, ["tell_game=true"], "knows which game it plays; the others have to see it"),
    "by progress, 6 times": (6, ["share_by=progress"], "learns more often from games whose rewards change"),
    "unscaled, 6 times": (6, ["policy.scale_rewards=false"], "has rewards as the games pay them"),
}
Results = dict[str, dict[str, dict[str, float]]]  # kind, game, seed: score


def main() -> None:
    """Train what is missing, evaluate it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS], default=[*KINDS], help="joint runs; default: all")
    options = parser.parse_args()
    results: Results = {}
    speeds: dict[str, list[float]] = {}  # timesteps per second of the runs of each kind
    for seed in options.seeds.split(","):
        for kind in (SINGLE, *options.kinds):
            for run, times, more in runs_of(kind):
                found, speed = play(f"{run}-s{seed}", [*more, f"seed={seed}"], times * TIMESTEPS)
                speeds.setdefault(kind, []).append(speed)
                for game, value in found.items():
                    results.setdefault(kind, {}).setdefault(game, {})[seed] = value
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / "scores.json").write_text(json.dumps({"results": results, "speeds": speeds}, indent=1) + "\n")
    (RESULTS / "README.md").write_text(page(results, speeds), encoding="utf-8")


def runs_of(kind: str) -> list[tuple[str, int, list[str]]]:
    """Return the runs of a kind and a seed: names, timesteps beside those of a single one, and what differs."""
    if kind != SINGLE:
        times, more, _ = KINDS[kind]
        return [(kind.replace(", ", "-").replace(" ", "-"), times, more)]
    return [(game, 1, [f"games.{other}=null" for other in GAMES if other != game]) for game in GAMES]


def play(name: str, overrides: Sequence[str], end: int) -> tuple[dict[str, float], float]:
    """Train a run if it is not complete.

    Return its score in each of its games, and its timesteps per second. A score is the interquartile mean of the
    returns, or the mean of a metric: see `SCORES`.
    """
    run = RUNS / name
    saved = checkpoints(run)
    if not saved or int(saved[-1].name) < end:
        length = [f"total_timesteps={end}", f"policy.penalty_ramp={end // 3}", f"log_interval={end // 20}"]
        joybridge("train", str(CONFIG), "--run", str(run), *length, *overrides, *(["--resume"] if saved else []))
    known = run / "evaluation.json"
    if not known.exists():
        last = joybridge("evaluate", str(run), "--episodes", str(EPISODES), "--json").splitlines()[-1]
        known.write_text(last)
    played = {game: found["player"] for game, found in json.loads(known.read_text()).items()}
    scores = {
        game: each["means"][SCORES[game]] if game in SCORES else _iqm(np.array(each["returns"]))
        for game, each in played.items()
    }
    last_row = read_rows(run / "metrics-player.csv")[-1]
    return scores, last_row["timesteps"] / last_row["seconds"]


def joybridge(*words: str) -> str:
    """Run a command and return its output."""
    done = subprocess.run([sys.executable, "-m", "joybridge", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout


def page(results: Results, speeds: Mapping[str, Sequence[float]]) -> str:
    """Return the page about the results."""
    kinds = [kind for kind in results if kind != SINGLE]
    seeds = [*results[SINGLE][GAMES[0]]]
    scores = {
        kind: np.array([[of_game[seed] for seed in seeds] for of_game in of_kind.values()])
        for kind, of_kind in results.items()
    }
    single, rows = scores[SINGLE], []
    for number, game in enumerate(GAMES):
        own = slice(number, number + 1)
        cells = [f"{scores[kind][number].mean():.2f}, {share(scores[kind][own], single[own])}" for kind in kinds]
        rows.append(f"| {' | '.join([f'`{game}`', f'{single[number].mean():.2f}', *cells])} |")
    means = [share(scores[kind], single) for kind in kinds]
    worst = [f"{(scores[kind].mean(axis=1) / single.mean(axis=1)).min():.0%}" for kind in kinds]
    some = "" if kinds == [*KINDS] else f" --kinds {' '.join(map(quote, kinds))}"
    remarks = [f"- `{kind}` (`{' '.join(KINDS[kind][1])}`) {KINDS[kind][2]}." for kind in kinds if KINDS[kind][2]]
    pace = "; ".join(f"{kind}: {np.median(values):,.0f}" for kind, values in speeds.items())
    made = (
        f"Made in the checkout by `python -m tools.several --seeds {','.join(seeds)}{some}`: `{CONFIG}`, from numbers. "
        f"A policy of one game has learned from {TIMESTEPS:,} timesteps; `joint` from as many of all six games "
        "together, the others from six times as many. A number is the mean over the seeds of the interquartile mean of "
        f"{EPISODES} returns (`catch_point`: of the share of successes, as its rewards say little). Beside it is its "
        "share of that of a policy for each game, with the 95 % interval of a bootstrap over the seeds "
        f"(n = {len(seeds)}; so few make it narrower than it should be). [Seed 0 of the second joint policy plays all "
        "six](../videos/six-games.mp4) (`joybridge record runs/several/joint-6-times-s0 six-games.mp4 --seconds 8`)."
    )
    lines = [
        "# One policy for six games, and one for each",
        "",
        fill(made, WIDTH, break_long_words=False, break_on_hyphens=False),
        "",
        f"| game | a policy for each | {' | '.join(kinds)} |",
        f"| --- | --- |{' --- |' * len(kinds)}",
        *rows,
        f"| mean of the shares | | {' | '.join(means)} |",
        f"| worst game | | {' | '.join(worst)} |",
        "",
        *([*remarks, ""] if remarks else []),
        "Timesteps per second, medians, on a shared machine whose load changed from run to run:",
        f"{pace}.",
        "",
    ]
    return "\n".join(lines)


def share(joint: Array, single: Array) -> str:
    """Return the share of joint policies' scores in single ones', both [games, seeds]: a mean over games, as text."""
    middle = (joint.mean(axis=1) / single.mean(axis=1)).mean()
    seeds = joint.shape[1]
    if seeds == 1:
        return f"{middle:.0%}"
    rng = np.random.default_rng(0)
    drawn = [scores[:, rng.integers(0, seeds, (RESAMPLES, seeds))].mean(axis=2) for scores in (joint, single)]
    low, high = np.quantile((drawn[0] / drawn[1]).mean(axis=0), [0.025, 0.975])
    return f"{middle:.0%} [{low:z.0%}, {high:z.0%}]"


def _iqm(returns: Array) -> float:
    return float(interquartile_mean(returns[:, None]))


if __name__ == "__main__":
    main()
