"""The command `joybridge`, for tools that train and evaluate."""

import subprocess
import sys


def joybridge(*words: str) -> str:
    """Run the command and return what it prints. Raises SystemExit with its errors if it fails."""
    done = subprocess.run([sys.executable, "-m", "joybridge", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout
