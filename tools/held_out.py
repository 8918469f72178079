"""How soon a policy learns a game from pictures if it has played five others: `python -m tools.held_out`.

Five of the six games of `configs/several/six_pictures.yaml` are trained together, the held-out one is not. Then it is
learned alone, from nothing, from the policy of the five, or from that of one of them. Runs in `runs/six_pictures` that
are complete are not repeated. Writes `results/held-out/README.md`, and what is behind it, `curves.json`.
"""

import argparse
import json

import numpy as np

from joybridge.compare.page_parts import table
from joybridge.config.metrics import read_rows
from joybridge.contract.tensors import Array
from tools.several import RESULTS, SINGLE, STUDIES, filled, runs_of, share, train

STUDY = STUDIES["six_pictures"]
ROWS = 20  # of the metrics of a run
LAST = 3  # rows whose mean counts as the end
ENOUGH = 0.8  # of the reward that policies that begin from nothing have at the end
NOTHING, FIVE = "nothing", "five"  # what a policy begins from; other names are policies of one game
Curves = dict[str, list[list[float]]]  # what it begins from: rewards [seeds][rows]


def main() -> None:
    """Train what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--game", choices=[*STUDY.shares], default="beastly_rivals", help="default %(default)s")
    parser.add_argument(
        "--one", choices=[*STUDY.shares], default="shooting_birds", help="seen as it is; default %(default)s"
    )
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    options = parser.parse_args()
    played = sum(each for game, each in STUDY.shares.items() if game != options.game)
    _learn(f"{FIVE}-s0", round(STUDY.timesteps * played), [f"games.{options.game}=null", "seed=0"])
    alone = {run: (end, changes) for run, end, changes in runs_of(STUDY, SINGLE)}
    end, changes = alone[options.one]
    _learn(f"{options.one}-s0", end, [*changes, "seed=0"])
    curves: Curves = {}
    for seed in options.seeds.split(","):
        for start in (NOTHING, FIVE, options.one):
            begun = [] if start == NOTHING else ["--from", str(STUDY.folder / f"{start}-s0")]
            end, changes = alone[options.game]
            found = _learn(f"{options.game}-from-{start}-s{seed}", end, [*changes, f"seed={seed}", *begun])
            curves.setdefault(start, []).append([row.get("reward", np.nan) for row in found])
    folder = RESULTS / "held-out"
    folder.mkdir(exist_ok=True)
    (folder / "curves.json").write_text(json.dumps({options.game: curves}) + "\n")
    (folder / "README.md").write_text(page(options.game, end, curves), encoding="utf-8")


def _learn(name: str, end: int, words: list[str]) -> list[dict[str, float]]:
    run = STUDY.folder / name
    train(STUDY.config, run, end, [f"policy.penalty_ramp={end}", f"log_interval={end // ROWS}", *words])
    return read_rows(run / "metrics-player.csv")


def page(game: str, end: int, curves: Curves) -> str:
    """Return the page about some curves of a game that is learned for `end` timesteps."""
    rewards = {start: np.array(each) for start, each in curves.items()}  # [seeds, rows]
    specialist = rewards[NOTHING][:, -LAST:].mean()
    times = {start: _reached(each, ENOUGH * specialist, end) for start, each in rewards.items()}
    names = {NOTHING: "nothing", FIVE: "the five other games"}
    rows = []
    for start, each in rewards.items():
        known = start != NOTHING and np.isfinite([*times[start], *times[NOTHING]]).all()
        rows.append(
            [
                names.get(start, f"`{start}`"),
                f"{each[:, -LAST:].mean():.1f}",
                ", ".join(f"{time:,.0f}" if np.isfinite(time) else "never" for time in times[start]),
                share(times[start][None], times[NOTHING][None]) if known else "",
            ]
        )
    made = (
        f"Made in the checkout by `python -m tools.held_out`, with the settings of `{STUDY.config}`. "
        f"`{game}` is learned alone for {end:,} timesteps. A policy begins from nothing, from a policy of the five "
        "other games, or from one of a single game; these two are one run each, and have learned from as many "
        f"timesteps per game. The reward is that of training, at the end the mean of the last {LAST} of {ROWS} rows. "
        f"Enough is {ENOUGH:.0%} of what policies from nothing have at the end. The share is that of the timesteps of "
        "those from nothing, with the 95 % interval of a bootstrap over the seeds (n = "
        f"{len(rewards[NOTHING])}; so few make it narrower than it should be)."
    )
    heads = ["begins from", "reward at the end", "timesteps until enough, of each seed", "share"]
    return "\n\n".join(["# A game held out, from pictures", filled(made), table(heads, rows)]) + "\n"


def _reached(rewards: Array, enough: float, end: int) -> Array:
    """Return at which of its timesteps rewards [seeds, rows] are first enough, [seeds]; inf if they never are."""
    have = rewards >= enough
    times: Array = np.where(have.any(axis=1), have.argmax(axis=1) + 1, np.inf) * end / rewards.shape[1]
    return times


if __name__ == "__main__":
    main()
