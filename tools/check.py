"""Check style, types and tests, and stop at the first failure.

With --quick, tests marked `slow` are left out. Without it, all tests run and the line coverage of proto, simulator and
trainer is measured; it has a lower limit, see pyproject.toml.
"""

import argparse
import subprocess
import sys

STATIC = (("ruff", "format", "--check", "."), ("ruff", "check", "."), ("mypy",))
QUICK = ("pytest", "-m", "not slow")
ALL = ("pytest", "--cov", "--cov-report=term")


def main() -> int:
    """Run every check and return the exit status of the first that fails."""
    parser = argparse.ArgumentParser(description="Check style, types and tests; stop at the first failure.")
    parser.add_argument("--quick", action="store_true", help="leave out the tests marked slow, and coverage")
    options = parser.parse_args()
    for command in (*STATIC, QUICK if options.quick else ALL):
        print("•", *command, flush=True)
        status = subprocess.run([sys.executable, "-m", *command], check=False).returncode
        if status:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
