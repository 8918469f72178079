"""The demonstration: train on Shooting Birds for a few minutes, evaluate the policy and record a video of it.

Prints and runs the commands that you would type.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from tools.curves import plot

CONFIG = "shooting_birds/fast"


def main() -> int:
    """Run the demonstration and return its exit status."""
    parser = argparse.ArgumentParser(description="Train on Shooting Birds for a few minutes and show the policy.")
    parser.add_argument("--timesteps", type=int, help="end earlier, after so many timesteps")
    parser.add_argument("--run", type=Path, default=Path("runs/demo"), help="folder of the run; default: %(default)s")
    options = parser.parse_args()
    run, video, picture = options.run, options.run / "play.mp4", options.run / "curves.png"
    stop = [f"stop_at={options.timesteps}"] if options.timesteps is not None else []
    resume = ["--resume"] if (run / "checkpoints").exists() else []
    commands = (
        ["train", CONFIG, "--run", str(run), *stop, *resume],
        ["evaluate", str(run), "--episodes", "70"],
        ["record", str(run), str(video), "--seconds", "40"],
    )
    for command in commands:
        print(f"\n$ joybridge {' '.join(command)}", flush=True)
        status = subprocess.run([sys.executable, "-m", "joybridge", *command], check=False).returncode
        if status:
            return status
    plot([run], picture)
    print(f"\nlearning curve: {picture}\nvideo of the trained policy: {video}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
