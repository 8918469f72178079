"""Run the conformance kit on environments of other packages, served with `--gym` and `--pettingzoo`; write a page.

The packages are installed into `.venv-environments` once. Each environment is served by a simulator of its own. The
page says which checks passed and which do not apply, with the reasons. Exit status: 0; 1 if a check failed; 77 if the
packages cannot be installed.
"""

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tools.checked import MISSING, make_environment

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv-environments"  # which git ignores
PYTHON = ENVIRONMENT / "bin/python"
PAGE = ROOT / "results/environments.md"
REQUIREMENTS = (
    "gymnasium[classic-control,box2d,mujoco]==1.4.0",
    "pettingzoo[classic]==1.27.0",
    "ale-py==0.12.1",
    "Box2D==2.3.10",
    "minigrid==3.2.0",
    "mpe2==1.1.1",
    "mujoco==4.0.0",
)
ENVIRONMENTS: Mapping[str, tuple[tuple[str, ...], ...]] = {  # by package: the options of `joybridge serve`
    "gymnasium, classic control": (
        ("--gym", "CartPole-v1"),
        ("--gym", "MountainCar-v0"),
        ("--gym", "MountainCarContinuous-v0"),
        ("--gym", "Acrobot-v1"),
        ("--gym", "Pendulum-v1"),
    ),
    "gymnasium, toy text": (
        ("--gym", "FrozenLake-v1 map_name=8x8"),
        ("--gym", "Taxi-v4"),
        ("--gym", "CliffWalking-v1"),
        ("--gym", "Blackjack-v1"),
    ),
    "gymnasium, Box2D": (
        ("--gym", "LunarLander-v3"),
        ("--gym", "LunarLander-v3 continuous=true"),
        ("--gym", "BipedalWalker-v3"),
        ("--gym", "CarRacing-v3"),
    ),
    "gymnasium, MuJoCo": (
        ("--gym", "HalfCheetah-v5"),
        ("--gym", "Hopper-v5"),
        ("--gym", "InvertedPendulum-v5"),
        ("--gym", "Ant-v5"),
    ),
    "ale-py": (("--gym", "ale_py:ALE/Pong-v5"), ("--gym", "ale_py:ALE/Breakout-v5 obs_type=ram")),
    "minigrid": (("--gym", "tools.minigrid_images:MiniGridImages-v0"),),
    "pettingzoo, AEC": (
        ("--pettingzoo", "pettingzoo.classic.tictactoe_v3"),
        ("--pettingzoo", "pettingzoo.classic.connect_four_v3"),
        ("--pettingzoo", "pettingzoo.classic.rps_v2"),
    ),
    "mpe2, parallel": (("--pettingzoo", "mpe2.simple_spread_v3"), ("--pettingzoo", "mpe2.simple_tag_v3")),
}
SECONDS = 900.0  # to check one environment, or to install all


@dataclass(frozen=True)
class Result:
    """What the kit says of one environment."""

    package: str
    option: tuple[str, ...]  # of `joybridge serve`
    error: str  # why there is no report; "": there is one
    outcomes: Mapping[str, int]
    failed: Sequence[str]  # checks, each with what came and what was expected
    reasons: Mapping[str, int]  # why checks do not apply, and of how many this is the reason


def main() -> int:
    """Check the environments and return the exit status."""
    parser = argparse.ArgumentParser(description="Run the conformance kit on environments of other packages.")
    parser.add_argument("--only", default="", help="part of the names of the environments to check; then no page")
    only = parser.parse_args().only
    if reason := install():
        print(f"not checked: {reason}")
        return MISSING
    results = []
    for package, options in ENVIRONMENTS.items():
        for option in options:
            if only in option[1]:
                results.append(result := check(package, option))
                print(f"{option[1]}: {result.error or dict(result.outcomes)}", *result.failed, sep="\n  ", flush=True)
    if not only:
        PAGE.write_text(page(results))
        print(PAGE.relative_to(ROOT))
    return int(any(result.error or result.failed for result in results))


def install() -> str:
    """Install the packages where they are not there yet; return why they cannot be had, "" if they are."""
    done = ENVIRONMENT / "installed"
    if done.exists() and done.read_text() == "\n".join(REQUIREMENTS):
        return ""
    what = ["--constraint", str(ROOT / "constraints.txt"), "--editable", f"{ROOT}[simulator,gym]", *REQUIREMENTS]
    if problem := make_environment(ENVIRONMENT, sys.executable, what):
        return f"the packages cannot be installed: {problem}"
    done.write_text("\n".join(REQUIREMENTS))
    return ""


def check(package: str, option: tuple[str, ...]) -> Result:
    """Serve one environment and run the kit on it."""
    serve = ["serve", "--address", "127.0.0.1:0", "--step-seconds", "240", *option]
    with TemporaryDirectory() as folder:  # some environments write files where they are started
        said = Path(folder) / "stderr"
        with (
            said.open("w") as errors,
            subprocess.Popen(
                [str(PYTHON), "-m", "joybridge", *serve],
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            ) as server,
        ):
            try:
                assert server.stdout is not None
                line = next((line for line in server.stdout if "listening on" in line), "")
                if line:
                    return run_kit(package, option, line.split()[-1])
            finally:
                server.terminate()
        return Result(package, option, said.read_text().strip().rpartition("\n")[2], {}, (), {})


def run_kit(package: str, option: tuple[str, ...], address: str) -> Result:
    """Run the kit on the last game of a server, which is the one that is not built in."""
    joybridge = [str(PYTHON), "-m", "joybridge"]
    listed = subprocess.run(
        [*joybridge, "list", "--simulator", address], cwd=ROOT, capture_output=True, text=True, check=True
    )
    game = next(line for line in reversed(listed.stdout.splitlines()) if line and line[0] != " ").partition(": ")[0]
    command = [*joybridge, "check", address, "--game", game, "--json", "--quiet", "--deadline", "240"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return Result(package, option, f"the kit took longer than {SECONDS:g} s", {}, (), {})
    try:
        report: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return Result(package, option, (done.stderr.strip().splitlines() or ["no report"])[-1], {}, (), {})
    results = report["results"]
    failed = [
        f"{each['check']}: got {each['got']}, expected {each['expected']}"
        for each in results
        if each["outcome"] == "failed"
    ]
    outcomes = Counter(each["outcome"] for each in results)
    return Result(package, option, "", outcomes, failed, Counter(why(each) for each in results if why(each)))


def why(result: Mapping[str, Any]) -> str:
    """Return why a check does not apply; "" if it does."""
    return str(result["got"]) if result["outcome"] == "not applicable" else ""


def page(results: Sequence[Result]) -> str:
    """Return the page as Markdown."""
    lines = [
        "# Environments of other packages",
        "",
        "Written by `python -m tools.check_environments` in a checkout: the conformance kit on environments that",
        "`joybridge serve` adapts. Each has a server of its own. MiniGrid is served with the wrapper that leaves out",
        "its text, because `--gym` refuses texts.",
        "",
        "| package | served with | passed | failed | warnings | not applicable |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for each in results:
        counts = [str(each.outcomes.get(kind, 0)) for kind in ("passed", "failed", "warning", "not applicable")]
        cells = [each.package, f"`{each.option[0]} {each.option[1]!r}`".replace("'", '"'), *counts]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", "Checks that do not apply, by reason, and the number of environments with this reason:", ""]
    reasons = Counter(reason for each in results for reason in each.reasons)
    lines += [f"- {reason}: {count}" for reason, count in reasons.most_common()]
    problems = [f"- {each.option[1]}: {text}" for each in results for text in (each.error, *each.failed) if text]
    if problems:
        lines += ["", "What failed:", "", *problems]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
