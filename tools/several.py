"""Compare one policy for three games with a policy for each: `python -m tools.several --seeds 0,1,2`.

Both learn from as many timesteps together, in `configs/several/three.yaml`: the joint policy has as many arenas as the
single ones together, so each game has the same arenas, updates and timesteps. Runs in `runs/several` that are complete
are not repeated. Writes `results/several/README.md` and the returns behind it, `returns.json`.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

import numpy as np

from joybridge.compare.estimators import interquartile_mean
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from joybridge.run.checkpoint import checkpoints

CONFIG, RUNS, RESULTS = Path("configs/several/three.yaml"), Path("runs/several"), Path("results/several")
GAMES = ("archer", "marble", "orchard")
ARENAS, TIMESTEPS = 16, 60_000  # of a game
EPISODES = 105  # of an evaluation
RESAMPLES = 10_000
KINDS = {  # of joint runs: what differs
    "joint": [],
    "told": ["tell_game=true"],
    "unscaled": ["policy.scale_rewards=false"],
}


def main() -> None:
    """Train what is missing, evaluate it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0,1,2", help="of the joint policy and of the single ones")
    parser.add_argument("--other-seeds", default="0", help="of the two other joint policies: told, unscaled")
    options = parser.parse_args()
    seeds, others = ([int(seed) for seed in text.split(",") if seed] for text in (options.seeds, options.other_seeds))
    results: dict[str, dict[str, dict[str, float]]] = {}  # kind -> game -> seed -> interquartile mean of the returns
    speeds: dict[str, list[float]] = {}  # kind -> timesteps per second of each run
    for seed in seeds:
        for game in GAMES:
            single = [f"games.{other}=null" for other in GAMES if other != game]
            found = play(f"{game}-s{seed}", [*single, f"seed={seed}"], 1)
            results.setdefault("single", {}).setdefault(game, {})[str(seed)] = found[game]
            speeds.setdefault(game, []).append(speed(f"{game}-s{seed}"))
        for kind, more in KINDS.items():
            if kind == "joint" or seed in others:
                for game, value in play(f"{kind}-s{seed}", [*more, f"seed={seed}"], len(GAMES)).items():
                    results.setdefault(kind, {}).setdefault(game, {})[str(seed)] = value
                speeds.setdefault(kind, []).append(speed(f"{kind}-s{seed}"))
        RESULTS.mkdir(parents=True, exist_ok=True)
        (RESULTS / "returns.json").write_text(json.dumps({"results": results, "speeds": speeds}, indent=1) + "\n")
        (RESULTS / "README.md").write_text(page(results, speeds), encoding="utf-8")


def play(name: str, overrides: Sequence[str], games: int) -> dict[str, float]:
    """Train a run if it is not complete; return the interquartile mean of its returns in each of its games."""
    run = RUNS / name
    saved, end = checkpoints(run), games * TIMESTEPS
    if not saved or int(saved[-1].name) < end:
        size = [f"arenas={games * ARENAS}", f"total_timesteps={end}", f"log_interval={games * TIMESTEPS // 10}"]
        joybridge("train", str(CONFIG), "--run", str(run), *size, *overrides, *(["--resume"] if saved else []))
    known = run / "evaluation.json"
    if not known.exists():
        last = joybridge("evaluate", str(run), "--episodes", str(EPISODES), "--json").splitlines()[-1]
        known.write_text(last)
    evaluated = json.loads(known.read_text())
    return {game: _iqm(np.array(found["player"]["returns"])) for game, found in evaluated.items()}


def speed(name: str) -> float:
    """Return the timesteps per second of a run, over all of it."""
    last = read_rows(RUNS / name / "metrics-player.csv")[-1]
    return last["timesteps"] / last["seconds"]


def joybridge(*words: str) -> str:
    """Run a command and return its output."""
    done = subprocess.run([sys.executable, "-m", "joybridge", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout


def page(results: Mapping[str, Mapping[str, Mapping[str, float]]], speeds: Mapping[str, Sequence[float]]) -> str:
    """Return the page about the results so far."""
    seeds, kinds = [*results["single"][GAMES[0]]], [kind for kind in KINDS if results.get(kind)]
    others = sorted({seed for kind in kinds if kind != "joint" for seed in results[kind][GAMES[0]]})
    command = f"python -m tools.several --seeds {','.join(seeds)} --other-seeds {quote(','.join(others))}"
    rows = []
    for game in GAMES:
        single = results["single"][game]
        cells = [game, _mean(single)]
        for kind in kinds:
            mine = results[kind][game]
            shared = [seed for seed in mine if seed in single]
            low, middle, high = ratio([mine[seed] for seed in shared], [single[seed] for seed in shared])
            interval = f" ({low:.0%} to {high:.0%})" if len(shared) > 1 else ""
            cells.append(f"{_mean(mine)}, {middle:.0%}{interval}, n = {len(mine)}")
        rows.append(f"| {' | '.join(cells)} |")
    pace = ", ".join(f"{kind} {np.median(values):,.0f}" for kind, values in speeds.items())
    lines = [
        "# One policy for three games, and one for each",
        "",
        f"Made in the checkout by `{command}`: `{CONFIG}`,",
        f"{TIMESTEPS:,} timesteps of each game. A number is the mean over the seeds of the interquartile mean of",
        f"{EPISODES} returns; beside it is its share of that of a policy for each game, with the 95 % interval of a",
        "bootstrap over the seeds in pairs. One seed has no interval and proves nothing; few seeds make it narrower",
        "than it should be.",
        "",
        f"| game | {' | '.join(['a policy for each', *kinds])} |",
        f"| --- | --- |{' --- |' * len(kinds)}",
        *rows,
        "",
        f"Timesteps per second, medians, on a shared machine whose load changed from run to run: {pace}.",
        "",
    ]
    return "\n".join(lines)


def ratio(joint: Sequence[float], single: Sequence[float]) -> tuple[float, float, float]:
    """Return the ratio of the means of runs in pairs, between the ends of its 95 % interval: low, ratio, high."""
    if not joint:
        return np.nan, np.nan, np.nan
    pairs = np.array([joint, single])
    rng = np.random.default_rng(0)
    drawn = pairs[:, rng.integers(0, len(joint), (RESAMPLES, len(joint)))].mean(axis=2)
    low, high = np.quantile(drawn[0] / drawn[1], [0.025, 0.975])
    return float(low), float(pairs[0].mean() / pairs[1].mean()), float(high)


def _iqm(returns: Array) -> float:
    return float(interquartile_mean(returns[:, None]))


def _mean(values: Mapping[str, float]) -> str:
    return f"{np.mean([*values.values()]):.2f}" if values else ""


if __name__ == "__main__":
    main()
