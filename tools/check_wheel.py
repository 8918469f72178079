"""Build the wheel and test every extra in an empty virtual environment of its own, on every Python that is present.

The programs run in a folder that contains `trainer.py`, `simulator.py`, `tools.py` and `tests/`, all of which fail when
they are imported. Python versions of the package's classifiers must work. Newer ones are skipped, with the reason,
where a dependency has no wheel for them. PyTorch is large, so the extra `train` is installed only on the Python that
runs this program, unless --train names others. As many Pythons are checked at once as there are cores. What comes with
`train` must have the hashes of hashes.txt, and CycloneDX must list it.

Exit status: 0, or 1 at the first failure.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from joybridge.contract.address import READY
from tools.checked import Failed

ROOT = Path(__file__).resolve().parents[1]
HASHES = ROOT / "hashes.txt"
REQUIRED = ("3.11", "3.12", "3.13")  # the classifiers
NEWER = ("3.14",)
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
TRAPS = ("trainer.py", "simulator.py", "tools.py", "configs.py", "tests/__init__.py")
DEADLINE = 600.0  # seconds of one command, on a busy machine

PLAY = """
import numpy as np
from joybridge.gym import BridgeVectorEnv
envs = BridgeVectorEnv("shooting_birds", arenas=4, simulator={address!r})
observations, infos = envs.reset(seed=1)
for _ in range(100):
    envs.action_space.seed(2)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
assert observations.shape == envs.observation_space.shape and np.isfinite(rewards).all(), observations.shape
envs.close()
"""
VISIT = """
import subprocess, sys
from urllib.request import urlopen
command = [sys.executable, "-m", "joybridge", "play", "orchard", "--simulator", {address!r}, "--no-browser", "--port=0"]
with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as play:
    url = play.stdout.readline().split(" at ")[1].strip()
    with urlopen(url) as page, urlopen(url + "play.js") as script:
        assert b"play.js" in page.read() and b"WebSocket" in script.read()
    play.terminate()
"""
DIGESTS = """
import hashlib
import numpy as np
from joybridge.games import BUILT_IN
from joybridge.simulator.catalog import load_game
from joybridge.contract.codec import ActArrays
for name, place in BUILT_IN.items():
    kind = load_game(place)
    game = kind({option.name: option.default_choice for option in kind.options}, {}, 2, 0, 7)
    digest, random, steps = hashlib.sha256(), np.random.default_rng(3), game.observe()
    for _ in range(200):
        acts = []
        for step, behavior in zip(steps, kind.describe(
            {option.name: option.default_choice for option in kind.options}).behaviors):
            device, lanes = behavior.device, len(step.terminated)
            axes = np.array([random.uniform(a.low, a.high, lanes) for a in device.axes], np.float32)
            masks = step.masks or [np.ones((lanes, len(b.choices)), bool) for b in device.branches]
            choices = np.array([(random.random(mask.shape) * mask).argmax(1) for mask in masks], np.int32)
            acts.append(ActArrays(axes.reshape(-1, lanes).T.copy(), choices.reshape(-1, lanes).T.copy()))
        steps = game.step(acts)
        for step in steps:
            for array in (*step.observations, step.rewards, step.terminated, step.truncated):
                digest.update(array.tobytes())
    print(name, digest.hexdigest())
"""
NAMES = """
from importlib.metadata import distributions
print(*{one.name.lower().replace("_", "-").replace(".", "-") for one in distributions()})
"""
START = """
from joybridge.gym import BridgeEnv
BridgeEnv("archer")
"""


class NoWheel(Exception):
    """A dependency without a wheel for a Python."""


class Programs:
    """The programs of an environment, and an empty folder to work in."""

    def __init__(self, programs: Path, work: Path) -> None:
        """Run what is in the folder `programs`, in the folder `work`, which is made."""
        self.bin, self.work = programs, work
        self.work.mkdir(parents=True)
        for trap in TRAPS:
            (self.work / trap).parent.mkdir(exist_ok=True)
            (self.work / trap).write_text(f"raise RuntimeError('{trap} of the working folder was imported')\n")
        hidden = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NUMBA_CACHE_DIR"}
        self.variables = {name: value for name, value in os.environ.items() if name not in hidden}

    def run(self, program: str, *arguments: str, status: int = 0) -> str:
        """Run a program, of the environment if it is there, and return its output. Raises Failed."""
        command = [str(self.bin / program) if (self.bin / program).exists() else program, *arguments]
        try:
            result = subprocess.run(
                command,
                cwd=self.work,
                env=self.variables,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=DEADLINE,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise Failed(f"{' '.join(command)} did not end within {DEADLINE:g} s") from error
        if result.returncode != status:
            expected = f"ended with {result.returncode}, expected {status}"
            raise Failed(f"{' '.join(command)} {expected}; its output:\n{result.stdout}")
        return result.stdout

    def expect(self, text: str, program: str, *arguments: str, status: int = 0) -> None:
        """Run a program and raise Failed unless its output contains `text`."""
        output = self.run(program, *arguments, status=status)
        if text not in output:
            raise Failed(f"{program} {' '.join(arguments)}: expected {text!r} in its output:\n{output}")

    def expect_absent(self, *modules: str) -> None:
        """Raise Failed if any of these modules can be imported."""
        program = f"import importlib.util as u; print([m for m in {modules} if u.find_spec(m) is not None])"
        self.expect("[]\n", "python", "-P", "-c", program)  # -P: not the modules of the working folder

    @contextmanager
    def server(self) -> Iterator[str]:
        """Run `joybridge serve` on a free port and yield its address. Raises Failed if it does not start."""
        command = [str(self.bin / "joybridge"), "serve", "--address", "127.0.0.1:0", "--with-parent"]
        with (
            (self.work / "server.txt").open("w+") as log,
            subprocess.Popen(
                command,
                cwd=self.work,
                env=self.variables,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            ) as process,
        ):
            try:
                assert process.stdout is not None
                line = process.stdout.readline()
                if not line.startswith(READY):
                    log.seek(0)
                    raise Failed(f"{' '.join(command)} printed {line!r}, expected its address; its log:\n{log.read()}")
                yield line.removeprefix(READY).strip()
            finally:
                process.kill()


class Environment(Programs):
    """A virtual environment with the wheel and one of its extras, and an empty folder to work in."""

    def __init__(self, python: Path, wheel: Path, extra: str, folder: Path) -> None:
        """Make the environment in `folder` and install `extra` ("": none). Raises NoWheel and Failed."""
        super().__init__(folder / "venv/bin", folder / "work")
        self.run(str(python), "-m", "venv", "--without-pip", str(folder / "venv"))
        self.install(wheel, extra)

    def install(self, wheel: Path, extra: str) -> None:
        """Install the wheel with an extra. Raises NoWheel and Failed."""
        command = (
            sys.executable,
            "-m",
            "pip",
            "--python",
            str(self.bin / "python"),
            "install",
            "--quiet",
            "--no-compile",
            "--only-binary",
            ":all:",
            "--constraint",
            str(ROOT / "constraints.txt"),
            f"{wheel}[{extra}]" if extra else str(wheel),
        )
        try:
            self.run(*command)
        except Failed as failure:
            missing = [line for line in str(failure).splitlines() if "No matching distribution found" in line]
            if missing:
                raise NoWheel(missing[0].removeprefix("ERROR: ")) from failure
            raise


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the wheel and return the exit status."""
    parser = argparse.ArgumentParser(description="Build the wheel and test each extra in an empty environment.")
    parser.add_argument(
        "--train", nargs="*", default=[HERE], help="Python versions that get PyTorch; default %(default)s"
    )
    options = parser.parse_args(arguments)
    begin = time.monotonic()
    try:
        with tempfile.TemporaryDirectory() as temporary:
            one = partial(check_python, build(Path(temporary)), Path(temporary), options.train)
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                digests = [each for each in pool.map(one, (*REQUIRED, *NEWER)) if each]
        if len(set(digests)) > 1:
            raise Failed("the games are not the same on all Pythons:\n" + "\n".join(digests))
        print(f"the games have the same bytes on {len(digests)} Pythons", flush=True)
    except Failed as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return 1
    print(f"the wheel works on every Python that is present ({time.monotonic() - begin:.0f} s)")
    return 0


def build(folder: Path) -> Path:
    """Build the source distribution and, from it alone, the wheel, twice; return its path. Raises Failed."""
    wheels: list[Path] = []
    for number in "12":
        command = [sys.executable, "-m", "build", "--outdir", str(folder / number), str(ROOT)]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode:
            output = f"{result.stdout}{result.stderr}"
            raise Failed(f"{' '.join(command)} ended with {result.returncode}; its output:\n{output}")
        wheels += (folder / number).glob("*.whl")
    wheel, again = wheels
    if wheel.read_bytes() != again.read_bytes():
        raise Failed(f"{wheel.name} is another file when it is built again, expected the same bytes")
    with zipfile.ZipFile(wheel) as archive:
        names = {name.split("/")[0] for name in archive.namelist()}
        ours = {name for name in names if not name.endswith(".dist-info")}
        if ours != {"joybridge"}:
            raise Failed(f"{wheel.name} installs the top-level names {sorted(ours)}, expected only 'joybridge'")
    print(f"{wheel.name}: {wheel.stat().st_size / 1e3:.0f} kB", flush=True)
    return wheel


def find_python(version: str) -> Path | None:
    """Return the interpreter of a Python version such as "3.12", from PATH or pyenv, or None."""
    found = shutil.which(f"python{version}")
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates = [Path(found)] if found else []
    candidates += sorted(pyenv.glob(f"versions/{version}.*/bin/python"))
    for candidate in candidates:
        program = "import sys; print('{}.{}'.format(*sys.version_info[:2]))"
        result = subprocess.run([candidate, "-c", program], capture_output=True, text=True, check=False)
        if result.stdout.strip() == version:  # pyenv's shims exist for versions that are not switched on
            return candidate
    return None


def check_python(wheel: Path, temporary: Path, train: Sequence[str], version: str) -> str:
    """Test all extras on one Python, if it is present. Return digests of the games, "" without it. Raises Failed."""
    python = find_python(version)
    if python is None:
        print(f"Python {version}: not checked, it is not installed here", flush=True)
        return ""
    folder = temporary / version
    try:
        return check(version, python, wheel, folder, train=version in train)
    except NoWheel as reason:
        if version in REQUIRED:
            raise Failed(f"Python {version}: {reason}") from reason
        print(f"Python {version}: not checked: {reason}", flush=True)
        return ""
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def check(version: str, python: Path, wheel: Path, folder: Path, train: bool) -> str:
    """Test all extras on one Python. Return digests of the games. Raises Failed and NoWheel."""
    begin = time.monotonic()

    def done(extra: str) -> None:
        nonlocal begin
        print(f"Python {version}: {extra} works ({time.monotonic() - begin:.0f} s)", flush=True)
        begin = time.monotonic()

    simulator = Environment(python, wheel, "simulator", folder / "simulator")
    simulator.expect_absent("torch", "gymnasium", "pydantic")
    simulator.expect("shooting_birds: ", "joybridge", "list")
    simulator.run("joybridge", "new", "my_game")
    simulator.expect("my_game: ", "joybridge", "list", "--game", "my_game:MyGame")
    simulator.expect("12 pictures of my_game", "joybridge", "look", "my_game:MyGame", "look.png")
    digests = simulator.run("python", "-c", DIGESTS)
    with simulator.server() as address:
        done("joybridge[simulator]")

        gym = Environment(python, wheel, "gym", folder / "gym")
        gym.expect_absent("torch", "pydantic", "numba", "pygame")
        gym.run("python", "-W", "error", "-c", PLAY.format(address=address))
        gym.expect("pip install 'joybridge[simulator]'", "python", "-c", START, status=1)
        done("joybridge[gym]")

        viewer = Environment(python, wheel, "viewer", folder / "viewer")
        viewer.expect_absent("torch", "gymnasium", "pydantic", "numba", "pygame")
        viewer.run("python", "-W", "error", "-c", VISIT.format(address=address))
        done("joybridge[viewer]")

        base = Environment(python, wheel, "", folder / "base")
        base.expect_absent(
            "torch", "gymnasium", "pydantic", "numba", "pygame", "simulator", "trainer", "tools", "tests"
        )
        base.expect("usage: joybridge COMMAND", "joybridge", "--help")
        base.expect(" 0 failed", "joybridge", "check", address, "--game", "archer")
        base.expect(
            "pip install 'joybridge[train]'", "joybridge", "doctor", address, "archer/hybrid", "--game", "archer"
        )
        base.expect("pip install 'joybridge[train]'", "joybridge", "train", "archer/hybrid", status=2)
        base.expect("pip install 'joybridge[viewer]'", "joybridge", "play", "archer", status=2)
        base.expect("pip install 'joybridge[simulator]'", "joybridge", "list", status=2)
        done("joybridge")
    if not train:
        print(f"Python {version}: joybridge[train] not checked (--train {version} does)", flush=True)
        return digests
    trainer = Environment(python, wheel, "train", folder / "train")
    trainer.expect_absent("gymnasium", "pettingzoo", "pygame", "ray", "matplotlib")
    check_hashes(trainer, folder / "hashes")
    check_list(trainer, folder / "list")
    done("the hashes, and the list, of what is installed")
    trainer.run("joybridge", "train", "archer/hybrid", "--run", "run", "arenas=8", "stop_at=960")
    output = trainer.run("joybridge", "evaluate", "run", "--episodes", "8", "--json")
    (result,) = json.loads(output.splitlines()[-1]).values()
    if result["timesteps"] < 960:
        raise Failed(f"joybridge evaluate: the run has {result['timesteps']} timesteps, expected 960")
    done("joybridge[train]")

    trainer.expect("--layouts", "joybridge", "compare", "--help")
    variants = ["--layouts", "hybrid", "bucket-3", "--seeds", "1", "--output", "compared"]
    trainer.expect("pip install 'joybridge[compare]'", "joybridge", "compare", "archer/hybrid", *variants, status=2)
    trainer.install(wheel, "compare")
    small = ["arenas=8", "total_timesteps=960", "log_interval=240", "policy.rollout_steps=30"]
    trainer.expect("compared/page.html", "joybridge", "compare", "archer/hybrid", *variants, *small)
    done("joybridge[compare]")
    ranges = ["--search", "policy.epochs=1..2", "--trials", "2", "--output", "searched"]
    trainer.expect(
        "pip install 'joybridge[search]'", "joybridge", "compare", "archer/hybrid", *ranges, *small, status=1
    )
    trainer.install(wheel, "search")
    trainer.expect("searched/page.html", "joybridge", "compare", "archer/hybrid", *ranges, *small)
    done("joybridge[search]")

    trainer.expect("pip install 'joybridge[minari]'", "joybridge", "minari", "demos", "datasets", status=2)
    trainer.install(wheel, "minari")
    trainer.run("joybridge", "evaluate", "run", "--episodes", "8", "--demos", "demos")
    trainer.expect("archer-v0: ", "joybridge", "minari", "demos", "datasets")
    trainer.run(
        "joybridge", "train", "archer/hybrid", "--run", "clone", "--demos", "datasets", "arenas=8", "stop_at=960"
    )
    done("joybridge[minari]")

    trainer.expect("pip install 'joybridge[export]'", "joybridge", "export", "run", "policy.onnx", status=2)
    trainer.install(wheel, "export")
    trainer.expect("policy.onnx: ", "joybridge", "export", "run", "policy.onnx")
    done("joybridge[export]")
    return digests


def check_hashes(environment: Environment, folder: Path) -> None:
    """Raise Failed unless pip finds all that is installed with the hashes of hashes.txt; PyTorch has none there."""
    entries = re.split(r"\n(?=\w)", HASHES.read_text(encoding="utf-8"))[1:]
    installed = environment.run("python", "-c", NAMES).split()
    chosen = [entry for entry in entries if re.sub(r"[-_.]+", "-", entry.split("==")[0]).lower() in installed]
    if len(chosen) < 20:
        raise Failed(f"{HASHES} has hashes of {len(chosen)} of the packages {installed}, expected all but PyTorch")
    folder.mkdir()
    (folder / "chosen.txt").write_text("\n".join(chosen), encoding="utf-8")
    pip = (sys.executable, "-m", "pip", "--python", str(environment.bin / "python"), "download", "--quiet", "--no-deps")
    whence = ("--only-binary", ":all:", "--requirement", str(folder / "chosen.txt"), "--dest", str(folder / "files"))
    environment.run(*pip, "--require-hashes", *whence)


def check_list(environment: Environment, folder: Path) -> None:
    """Raise Failed unless CycloneDX lists joybridge and PyTorch among what is installed."""
    environment.run(sys.executable, "-m", "venv", str(folder))
    environment.run(str(folder / "bin/pip"), "install", "--quiet", "cyclonedx-bom>=7")
    place, python = folder / "sbom.json", str(environment.bin / "python")
    environment.run(str(folder / "bin/cyclonedx-py"), "environment", python, "--output-file", str(place))
    names = {component["name"] for component in json.loads(place.read_text(encoding="utf-8"))["components"]}
    if not {"joybridge", "torch"} <= names:
        raise Failed(f"cyclonedx-py lists {sorted(names)}, expected joybridge and torch among them")


if __name__ == "__main__":
    sys.exit(main())
