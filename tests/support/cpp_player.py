"""The program in C++ that plays an exported policy, built for tests."""

import subprocess
from pathlib import Path

from tests.support.servers import ROOT

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror"]
# Every read beyond an array, and what else C++ leaves undefined, ends the program with a status of its own.
CHECKS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def build_player(folder: Path) -> str:
    """Return the path of the program, which takes the files of a policy and of decisions."""
    program = str(folder / "play_policy")
    source = [str(Path(__file__).parent / "play_policy.cpp"), f"-I{ROOT / 'proto/examples/cpp/src'}"]
    subprocess.run(["c++", "-std=c++20", *WARNINGS, *CHECKS, *source, "-o", program], check=True)
    return program
