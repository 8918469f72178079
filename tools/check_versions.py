"""Train with the trainer of one version and the simulator of another, both ways: `python -m tools.check_versions`.

Earlier versions are those of which tests/data keeps files, with the commit that wrote them. The wheel of each commit
gets an environment of its own, in which only `joybridge` is its own: the other packages are those of this program. Each
trainer first asks the other's simulator who it is, then trains over localhost.

Exit status: 0; 1 at the first failure; 77 where the history of git is not present, as in a shallow clone.
"""

import argparse
import io
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tools.check_wheel import ROOT, Environment, Programs
from tools.checked import MISSING, Failed

COMMITS = {path.parent.name: path.read_text().strip() for path in sorted((ROOT / "tests/data").glob("*/COMMIT"))}
TRAININGS = {  # a small game over the Unix socket that a simulator offers, and a large one over gRPC
    "archer/hybrid": ["arenas=8", "total_timesteps=960", "log_interval=480"],
    "shooting_birds/bucket-3": ["total_timesteps=900", "log_interval=450", "policy.rollout_steps=30", "transport=grpc"],
}
PRODUCT = "from joybridge.contract.versions import own_version; print(own_version().product)"
WHO = """
import grpc
from joybridge.contract.versions import client_version
from joybridge.v1 import bridge_pb2 as pb, bridge_pb2_grpc as rpc
with grpc.insecure_channel({address!r}) as channel:
    request = pb.ListGamesRequest(version=client_version())
    games = rpc.SimulatorServiceStub(channel).ListGames(request, timeout=60)
print(f"trainer {{client_version().product}}, simulator {{games.version.product}}")
"""


class Earlier(Environment):
    """An environment whose `joybridge` is the wheel of a commit, and whose other packages are those of this program."""

    def __init__(self, commit: str, folder: Path) -> None:
        """Build the wheel in `folder` and install it there, with the commit in its version. Raises Failed."""
        super().__init__(Path(sys.executable), build(commit, folder), "", folder / "environment")
        (metadata,) = self.bin.parent.glob("lib/python*/site-packages/joybridge-*.dist-info/METADATA")
        text = metadata.read_text(encoding="utf-8")
        metadata.write_text(
            re.sub(r"^Version: \S+", rf"\g<0>+{commit[:8]}", text, count=1, flags=re.M), encoding="utf-8"
        )

    def install(self, wheel: Path, extra: str) -> None:
        """Install the wheel alone. Raises Failed."""
        (packages,) = self.bin.parent.glob("lib/python*/site-packages")
        (packages / "shared.pth").write_text(f"{sysconfig.get_path('purelib')}\n")  # whose own .pth files are not read
        pip = (sys.executable, "-m", "pip", "--python", str(self.bin / "python"))
        self.run(*pip, "install", "--quiet", "--no-deps", "--no-index", "--no-compile", str(wheel))


def main(arguments: Sequence[str] | None = None) -> int:
    """Check all pairs of versions and return the exit status."""
    argparse.ArgumentParser(
        description="Train with earlier trainers and this simulator, and the other way around."
    ).parse_args(arguments)
    begin = time.monotonic()
    if missing := [f"{version} is {commit}" for version, commit in COMMITS.items() if not is_here(commit)]:
        print(f"not checked: the history of git has no commit of {', '.join(missing)}; fetch it", file=sys.stderr)
        return MISSING
    with tempfile.TemporaryDirectory() as temporary:
        here = Programs(Path(sys.executable).parent, Path(temporary) / "here")
        try:
            for version, commit in COMMITS.items():
                earlier = Earlier(commit, Path(temporary) / version)
                train(earlier, here)
                train(here, earlier)
        except Failed as failure:
            print(f"failed: {failure}", file=sys.stderr)
            return 1
    print(f"trainers and simulators of {', '.join(COMMITS)} and of this checkout work together", end="")
    print(f" ({time.monotonic() - begin:.0f} s)")
    return 0


def is_here(commit: str) -> bool:
    """Return whether the history has a commit."""
    command = ["git", "-C", str(ROOT), "cat-file", "-e", f"{commit}^{{commit}}"]
    return shutil.which("git") is not None and subprocess.run(command, capture_output=True, check=False).returncode == 0


def build(commit: str, folder: Path) -> Path:
    """Build the wheel of a commit in `folder` and return its path. Raises Failed."""
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", commit], stdout=subprocess.PIPE, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder / "source", filter="data")
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(folder / "source")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        output = f"{result.stdout}{result.stderr}"
        raise Failed(f"{' '.join(command)} ended with {result.returncode}; its output:\n{output}")
    (wheel,) = folder.glob("*.whl")
    return wheel


def train(trainer: Programs, simulator: Programs) -> None:
    """Train with the trainer of one version and the simulator of another. Raises Failed."""
    with simulator.server() as address:
        who = f"trainer {product(trainer)}, simulator {product(simulator)}\n"
        trainer.expect(who, "python", "-P", "-c", WHO.format(address=address))
        for number, (config, changes) in enumerate(TRAININGS.items()):
            begin = time.monotonic()
            run = ["--run", f"run-{number}", "--simulator", address]
            trainer.run("joybridge", "train", config, *run, *changes)
            print(f"{config}: {who.strip()} ({time.monotonic() - begin:.0f} s)", flush=True)


def product(programs: Programs) -> str:
    """Return the name and version with which programs speak. Raises Failed."""
    return programs.run("python", "-P", "-c", PRODUCT).strip()


if __name__ == "__main__":
    sys.exit(main())
