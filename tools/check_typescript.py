"""Hold the server in TypeScript to all that it promises: the tests in tests/typescript_server.py.

They build it from nothing with npm, so they are no part of `make test`. Exit status: that of pytest, or 77 where
Node.js or npm is missing or too old.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from tools.checked import MISSING

ROOT = Path(__file__).resolve().parents[1]
NODE = 20  # the oldest that will do


def main() -> int:
    """Test the server and return the exit status."""
    argparse.ArgumentParser(description="Build the server in TypeScript, check it and train on it.").parse_args()
    if node_version() < NODE or shutil.which("npm") is None:
        print(f"not checked: the server in TypeScript needs Node.js {NODE} or newer, with npm")
        return MISSING
    command = [sys.executable, "-m", "pytest", "tests/typescript_server.py"]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


def node_version() -> int:
    """Return the major version of Node.js that is installed, 0 if there is none."""
    if shutil.which("node") is None:
        return 0
    text = subprocess.run(["node", "--version"], capture_output=True, text=True, check=True).stdout
    return int(text[1:].split(".")[0])


if __name__ == "__main__":
    sys.exit(main())
