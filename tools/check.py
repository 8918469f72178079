"""Check style, types and tests.

Wrong style ends the check at once. Types are checked while modules and kernels are compiled and the tests run, in one
process more than there are cores, because tests wait for servers, and at most four. Tests marked `nightly` are left
out, with --quick also those marked `slow`. With --nightly, those marked `nightly` run alone. With --coverage, all but
the slow tests run alone and are measured: the line coverage of proto, simulator and trainer has a lower limit, see
pyproject.toml.
"""

import argparse
import os
import subprocess
import sys

STYLE = (("ruff", "format", "--check", "."), ("ruff", "check", "."))
TYPES = ("mypy",)
COMPILING = ("tests.support.compiled",)
# A file is run by one process, so what its tests share is made once; see conftest.py for the order of files.
PROCESSES = min(4, (os.cpu_count() or 1) + 1)
TESTS = ("pytest", f"--numprocesses={PROCESSES}", "--dist=loadfile", "--no-loadscope-reorder")
DAILY = ("-m", "not nightly")
QUICK = ("-m", "not nightly and not slow")
NIGHTLY = ("-m", "nightly")
MEASURED = ("-m", "not slow", "--cov", "--cov-report=term")


def main() -> int:
    """Run the checks and return an exit status that is not 0 if one fails."""
    parser = argparse.ArgumentParser(description="Check style, types and tests.")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_true", help="leave out the tests marked slow")
    which.add_argument("--nightly", action="store_true", help="only run the tests marked nightly")
    which.add_argument("--coverage", action="store_true", help="only measure the coverage of all but the slow tests")
    options = parser.parse_args()
    if options.nightly or options.coverage:
        return run_tests(NIGHTLY if options.nightly else MEASURED)
    for command in STYLE:
        show(command)
        if status := subprocess.run(module(command), check=False).returncode:
            return status
    with subprocess.Popen(module(TYPES), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as types:
        failed_tests = run_tests(QUICK if options.quick else DAILY)
        show(TYPES)
        print(types.communicate()[0], end="")
    return failed_tests or types.returncode


def run_tests(which: tuple[str, ...]) -> int:
    """Compile the kernels, run some of the tests, and return their exit status."""
    subprocess.run(module(COMPILING), check=False)  # the tests say what is wrong if it fails
    show(TESTS + which)
    return subprocess.run(module(TESTS + which), check=False).returncode


def show(command: tuple[str, ...]) -> None:
    """Print a command."""
    print("•", *command, flush=True)


def module(command: tuple[str, ...]) -> list[str]:
    """Return the command that runs a Python module with arguments."""
    return [sys.executable, "-m", *command]


if __name__ == "__main__":
    sys.exit(main())
