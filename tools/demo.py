"""The demonstration: train on Shooting Birds for a few minutes, then show how well it went.

Runs the commands a person would type, and says which.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from tools.curves import plot

CONFIG = Path("configs/shooting_birds/bucket-11.yaml")
TIMESTEPS = 3_000_000


def main() -> int:
    """Run the demonstration and return its exit status."""
    parser = argparse.ArgumentParser(description="Train on Shooting Birds for a few minutes and show the result.")
    parser.add_argument("--timesteps", type=int, default=TIMESTEPS, help="default %(default)s")
    parser.add_argument("--run", type=Path, default=Path("runs/demo"), help="default %(default)s")
    options = parser.parse_args()
    run, video, picture = options.run, options.run / "play.mp4", options.run / "curves.png"
    resume = ["--resume"] if (run / "checkpoints").exists() else []
    commands = (
        ["train", str(CONFIG), "--run", str(run), f"stop={options.timesteps}", *resume],
        ["evaluate", str(run), "--episodes", "70"],
        ["record", str(run), str(video), "--seconds", "40"],
    )
    for command in commands:
        print(f"\n$ python -m joybridge.trainer {' '.join(command)}", flush=True)
        status = subprocess.run([sys.executable, "-m", "joybridge.trainer", *command], check=False).returncode
        if status:
            return status
    plot([run], picture)
    print(f"\nlearning curve, with the original's results beside it: {picture}\nvideo of the trained policy: {video}")
    print(f"go on training: joybridge train {CONFIG} --run {run} --resume stop=30000000")
    return 0


if __name__ == "__main__":
    sys.exit(main())
