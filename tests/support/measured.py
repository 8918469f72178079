"""Programs whose lines count as those of the tests do: interpreted rules and kernels, and a server.

Programs that tests interrupt are not measured: an interrupt while coverage holds its own lock makes them hang.
"""

import os
import subprocess
import sys

from coverage import Coverage

from tests.support.servers import ROOT


def measured(module: str) -> list[str]:
    """Return the command that runs a module from ROOT and, if the tests are measured, measures it as well."""
    measuring = ["-m", "coverage", "run", "--parallel-mode"] if Coverage.current() else []
    return [sys.executable, *measuring, "-m", module]


def interpreted(module: str, *arguments: str) -> str:
    """Run a module in which compiled functions are interpreted, which coverage can see, and return its output."""
    result = subprocess.run(
        [*measured(module), *arguments],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout
