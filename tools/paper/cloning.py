"""Shooting Birds from demonstrations: a trained policy plays, each layout clones it, and PPO trains the clone further.

python -m tools.paper.cloning RUN runs/cloning                  RUN demonstrates; prints a row per layout
python -m tools.paper.cloning RUN runs/cloning --layouts hybrid bucket-3

Finished runs are skipped and interrupted runs are resumed, so the command may be repeated with the same arguments.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.train import train

DEMONSTRATED = 20  # episodes at least: each level is played equally often
EPISODES = 210  # that a score is the mean of
CLONING, LATER = 300_000, 600_000  # timesteps of cloning, and of PPO after it
LAYOUTS = ("hybrid", "bucket-3", "bucket-11", "bucket-41", "threshold-0.0", "multiagent")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print how the teacher scores, then a row per layout: its clone, the clone after PPO, PPO alone."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper.cloning")
    parser.add_argument("teacher", type=Path, help="folder of the run that demonstrates")
    parser.add_argument("folder", type=Path, help="for demonstrations and runs")
    parser.add_argument("--layouts", nargs="+", default=LAYOUTS)
    options = parser.parse_args(arguments)
    demos = options.folder / "demos"
    with simulator_process() as address:
        if not demos.exists():
            recording = options.folder / "recording"
            shutil.rmtree(recording, ignore_errors=True)  # of a command that was interrupted
            score(options.teacher, address, episodes=DEMONSTRATED, demos=recording)
            recording.rename(demos)
        print(f"teacher: {score(options.teacher, address):.1f}", flush=True)
        print("| layout | clone | clone, then PPO | PPO alone |", flush=True)
        for layout in options.layouts:
            clone, later, alone = (options.folder / f"{layout}-{name}" for name in ("clone", "later", "alone"))
            scores = (
                trained(clone, address, layout, CLONING, f"demonstrations={demos}"),
                trained(later, address, layout, LATER, f"weights_from={clone}"),
                trained(alone, address, layout, CLONING + LATER),
            )
            print(f"| `{layout}` |", " | ".join(f"{reward:.1f}" for reward in scores), "|", flush=True)


def trained(run: Path, address: str, layout: str, timesteps: int, *keys: str) -> float:
    """Train a layout in the folder `run`, unless that is done; return its score."""
    overrides = [f"layout={layout}", f"total_timesteps={timesteps}", *keys]
    config = load_config(find_config("shooting_birds/bucket-11"), overrides)
    train(config, run, [address], resume=has_checkpoint(run))
    return score(run, address)


def score(run: Path, address: str, *, episodes: int = EPISODES, demos: Path | None = None) -> float:
    """Return the mean reward of a run's policy, of the one with the buttons if there are two."""
    results = evaluate(PlaySpec(run, address, seed=2), episodes=episodes, say=lambda text: None, demos=demos)
    return list(results.values())[-1].means["reward"]


if __name__ == "__main__":
    main()
