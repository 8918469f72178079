"""Hold the C++ server to all that it promises: it builds, keeps the contract, can be trained, and ends in order.

Runs the commands a person would type, and says which. Ends with the first thing that fails, exit status 1, or
before it begins with exit status 77 where the compiler or a package is missing.
"""

import argparse
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from joybridge.client.client import Session, SimulatorLost
from joybridge.layouts import make_acts
from tools.checked import MISSING, Failed

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "proto/examples/cpp"
BUILD = SOURCE / "build"  # which git ignores
CONFIG = ROOT / "configs/paddle/hybrid.yaml"
PROGRAMS = {  # and the packages of Debian 12 that have them
    "cmake": "cmake",
    "make": "make",
    "c++": "g++",
    "pkg-config": "pkg-config",
    "protoc": "protobuf-compiler",
    "grpc_cpp_plugin": "protobuf-compiler-grpc",
}
LIBRARIES = {"grpc++": "libgrpc++-dev", "protobuf": "libprotobuf-dev"}
UNTRAINED = ("stop_at=4000", "policy.learning_rate=1e-9")  # a run that learns nothing
GAIN = 25.0  # reward of a trained policy above an untrained one's; three seeds gained 36
MOST_APART = 1.0  # of mean rewards; over so many episodes, the standard error of the difference is about 0.15
ENDING_SECONDS = 10.0


def main() -> int:
    """Check the server and return the exit status."""
    argparse.ArgumentParser(description="Build the C++ server, check it and train on it.").parse_args()
    packages = missing()
    if packages:
        print(f"not checked: the C++ server needs what is not installed here: {' '.join(packages)}")
        return MISSING
    try:
        run("cmake", "-S", str(SOURCE), "-B", str(BUILD))
        run("cmake", "--build", str(BUILD), "--parallel", str(os.cpu_count()))
        with server() as (process, address):
            run(sys.executable, "-m", "joybridge", "check", address, "--json")
            with tempfile.TemporaryDirectory() as folder:
                reward = check_learning(address, Path(folder))
                check_export(address, Path(folder), reward)
                check_refusals(Path(folder))
            check_ending(process, address)
        with tempfile.TemporaryDirectory() as folder:
            token = Path(folder) / "token"
            token.write_text(secrets.token_hex(16))
            token.chmod(0o600)
            protection = ("--token-file", str(token))
            with server(*protection) as (_, address):
                run(sys.executable, "-m", "joybridge", "check", address, *protection, "--family", "security")
    except Failed as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return 1
    print("the C++ server builds, keeps the contract, can be trained, and ends in order")
    return 0


def missing() -> list[str]:
    """Return the packages that are not there and needed to build the server."""
    packages = [package for program, package in PROGRAMS.items() if shutil.which(program) is None]
    if "pkg-config" not in packages:
        found = {name: subprocess.run(["pkg-config", "--exists", name], check=False) for name in LIBRARIES}
        packages += [LIBRARIES[name] for name, result in found.items() if result.returncode]
    return packages


def run(*command: str) -> list[str]:
    """Run a command, showing it and what it prints, and return the lines of its output. Raises Failed."""
    print("\n$", *command, flush=True)
    lines = []
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    if process.returncode:
        raise Failed(f"{' '.join(command)} ended with {process.returncode}; what it says is above")
    return lines


@contextmanager
def server(*more: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the server on a free port and yield the process and its address. Raises Failed if it does not start."""
    command = [str(BUILD / "paddle"), "--address", "127.0.0.1:0", *more]
    print("\n$", *command, flush=True)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            print(line, end="")
            if not line.startswith("joybridge simulator listening on 127.0.0.1:"):
                raise Failed(f"the server said {line!r}, expected where it listens")
            yield process, line.split()[-1]
        finally:
            process.kill()


def check_learning(address: str, folder: Path) -> float:
    """Return the reward of a trained policy. Raise Failed unless training made it clearly better, seeds being fixed."""
    rewards = [
        learn(address, folder / name, overrides) for name, overrides in (("untrained", UNTRAINED), ("trained", ()))
    ]
    print(f"reward {rewards[0]:.1f} untrained, {rewards[1]:.1f} trained")
    if not rewards[1] >= rewards[0] + GAIN:
        raise Failed(f"training gained {rewards[1] - rewards[0]:.1f}, expected at least {GAIN:g}")
    return rewards[1]


def check_export(address: str, folder: Path, reward: float) -> None:
    """Raise Failed unless the exported policy, played by the server itself, scores as the trainer does."""
    policy = str(folder / "policy.json")
    run(sys.executable, "-m", "joybridge", "export", str(folder / "trained"), policy, "--simulator", address)
    alone = float(run(str(BUILD / "paddle"), "--policy", policy, "--episodes", "200")[1].split()[1])
    if not abs(alone - reward) <= MOST_APART:
        raise Failed(f"alone, the policy scores {alone:.1f}, with the trainer {reward:.1f}")


def check_refusals(folder: Path) -> None:
    """Raise Failed unless a policy of another device, wrong options and forgotten values are refused in a sentence."""
    document = json.loads((folder / "policy.json").read_text())
    for name, changes, reason in (
        ("other", {"axes": [], "branches": [], "policies": []}, "acts on another device than the game has"),
        ("listed", {"options": [1], "game": "pong"}, "no game named 'pong'"),
    ):
        file = folder / f"{name}.json"
        file.write_text(json.dumps(document | changes))
        refused(reason, "--policy", str(file))
    refused("'--token-file' needs a value", "--token-file")
    refused("'--policy' needs a value", "--policy", "")


def refused(reason: str, *options: str) -> None:
    """Raise Failed unless the server ends with status 2 and says why."""
    command = [str(BUILD / "paddle"), *options]
    print("\n$", *command, flush=True)
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=ENDING_SECONDS)
    print(ended.stderr, end="")
    if ended.returncode != 2 or reason not in ended.stderr:
        raise Failed(f"the server ended with {ended.returncode} and {ended.stderr!r}, expected 2 and {reason!r}")


def learn(address: str, folder: Path, overrides: Sequence[str]) -> float:
    """Train a policy and return its mean reward per episode."""
    trainer = (sys.executable, "-m", "joybridge")
    run(*trainer, "train", str(CONFIG), "--simulator", address, "--run", str(folder), *overrides)
    *_, last = run(*trainer, "evaluate", str(folder), "--simulator", address, "--episodes", "64", "--json")
    result: dict[str, Any] = json.loads(last)
    return float(result["player"]["means"]["reward"])


def check_ending(process: "subprocess.Popen[str]", address: str) -> None:
    """Raise Failed unless SIGTERM ends an open session, and the server with status 0."""
    print("\n$ kill -TERM, with a session open", flush=True)
    with Session(address, "paddle", arenas=1, seed=0) as session:
        process.send_signal(signal.SIGTERM)
        try:
            for _ in range(100_000):  # steps go on until the server has noticed the signal
                session.step(make_acts(session.spec, 1))
            raise Failed("the open session goes on after SIGTERM, expected its end")
        except SimulatorLost as lost:
            print(lost)
    try:
        status = process.wait(ENDING_SECONDS)
    except subprocess.TimeoutExpired as error:
        raise Failed(f"the server runs {ENDING_SECONDS:g} s after SIGTERM") from error
    if status:
        raise Failed(f"the server ended with {status}, expected 0")


if __name__ == "__main__":
    sys.exit(main())
