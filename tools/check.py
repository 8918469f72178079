"""Everything that must hold before a change is done: style, types, tests. Stops at the first failure."""

import argparse
import subprocess
import sys

COMMANDS = (
    ("ruff", "format", "--check", "."),
    ("ruff", "check", "."),
    ("mypy",),
    ("pytest",),
)


def main() -> int:
    """Run every check and return the exit status of the first that fails."""
    argparse.ArgumentParser(description="Check everything: " + ", ".join(map(" ".join, COMMANDS))).parse_args()
    for command in COMMANDS:
        print("•", *command, flush=True)
        status = subprocess.run([sys.executable, "-m", *command], check=False).returncode
        if status:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
