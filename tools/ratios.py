"""Whether it has become slower: CPU seconds beside those of fixed programs, in turns: `python -m tools.ratios`.

    start           a simulator that starts and ends, beside a Python that imports NumPy, gRPC and Numba
    first update    a training of one rollout with its simulator, beside a Python that imports PyTorch and Numba
    timesteps       what 90,000 more of them take, beside a fixed loop of Python and NumPy
    round trip      the median of a decision of one arena, beside that of an echo between two processes; in seconds

CPU seconds count only the work of these processes, so other programs disturb them less than seconds. Each round
measures a program and its yardstick one after the other, and the median of the rounds' ratios is compared with
ratios.json. A ratio that is more than 15 % larger is measured again before it counts.

On a virtual machine, whose neighbors share its caches, `start` was 19 % larger twice, minutes after its baseline had
been written, so CI does not run this: compare two commits one after the other on a quiet machine.

Exit status: 0; 1 if a ratio is larger twice; 77 on another machine than that of ratios.json, or with other versions of
the packages. `--write` writes ratios.json instead: after such a change, or one that is worth its price.
"""

import argparse
import json
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from joybridge.client.launch import simulator_process
from tools.bench import echo, round_trips

ROOT = Path(__file__).resolve().parents[1]
BASELINE = Path(__file__).with_name("ratios.json")
MISSING = 77  # exit status: nothing was judged
LIMIT = 1.15  # times the baseline
ROUNDS = 5
GAME = "shooting_birds"
FIRST, FURTHER = 4_425, 90_000  # timesteps: a rollout, and what comes after it
LOOP = """
import numpy as np
matrix = np.random.default_rng(0).random((128, 128), np.float32)
total = 0
for number in range(60_000):
    total += sum(value & number for value in range(50))
    np.maximum(matrix @ matrix, 0.5)
"""


def cpu_seconds(*arguments: str) -> float:
    """Return the CPU seconds of a Python program and its processes. Raises CalledProcessError if it fails."""
    before = _of_children()
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    command = ["env", *(f"{name}={value}" for name, value in one_thread.items()), sys.executable, *arguments]
    subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    return _of_children() - before


def start() -> float:
    """Return the ratio of `start`."""
    before = _of_children()
    with simulator_process():
        pass
    return (_of_children() - before) / cpu_seconds("-c", "import numpy, grpc.aio, numba")


def first_update() -> float:
    """Return the ratio of `first update`."""
    return _training(FIRST) / cpu_seconds("-c", "import torch, numba")


def timesteps() -> float:
    """Return the ratio of `timesteps`."""
    first = _training(FIRST)
    return (_training(FIRST + FURTHER) - first) / cpu_seconds("-c", LOOP)


def round_trip() -> float:
    """Return the ratio of `round trip`."""
    with simulator_process() as address:
        ours = round_trips(GAME, address)["median"]
    return ours / echo()["median"]


MEASURES: dict[str, Callable[[], float]] = {
    "start": start,
    "first update": first_update,
    "timesteps": timesteps,
    "round trip": round_trip,
}


def measure(name: str) -> list[float]:
    """Return the ratios of some rounds, after one that warms caches up."""
    MEASURES[name]()
    return sorted(MEASURES[name]() for _ in range(ROUNDS))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"write {BASELINE.name}")
    write = parser.parse_args(arguments).write
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each program would compile what it imports
    baseline = {} if write else json.loads(BASELINE.read_text(encoding="utf-8"))
    here = machine()
    judged = here == baseline.get("machine")
    found: dict[str, float | str] = {"machine": here}
    slower = []
    for name in MEASURES:
        ratios = measure(name)
        if judged and too_large(ratios, baseline[name]):
            ratios = measure(name)
            slower += [name] if too_large(ratios, baseline[name]) else []
        found[name] = round(statistics.median(ratios), 3)
        expected = f", at most {LIMIT * baseline[name]:.3f} expected" if judged else ""
        spread = f"{ratios[0]:.3f} to {ratios[-1]:.3f} in {ROUNDS} rounds"
        print(f"{name}: {found[name]:.3f} ({spread}){expected}", flush=True)
    if write:
        BASELINE.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        return 0
    if not judged:
        print(f"not judged: this is {here}, and {BASELINE.name} is of {baseline['machine']}", file=sys.stderr)
        return MISSING
    if slower:
        print(f"slower than {BASELINE.name}: {', '.join(slower)}; see python -m tools.ratios --help", file=sys.stderr)
    return int(bool(slower))


def too_large(ratios: Sequence[float], baseline: float) -> bool:
    """Return whether the median of some ratios is beyond the limit."""
    return statistics.median(ratios) > LIMIT * baseline


def machine() -> str:
    """Return what ratios may depend on: the processor and the versions of what the yardsticks run."""
    found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
    versions = [f"{name} {version(name)}" for name in ("numpy", "numba", "torch", "grpcio")]
    processor = found[1] if found else platform.machine()
    return ", ".join([processor, f"{os.cpu_count()} cores", f"Python {platform.python_version()}", *versions])


def _training(stop_at: int) -> float:
    """Return the CPU seconds of a training and its simulator."""
    with tempfile.TemporaryDirectory() as folder:
        settings = [f"stop_at={stop_at}", "log_interval=1000000", "--run", f"{folder}/run"]
        return cpu_seconds("-m", "joybridge", "train", f"{GAME}/bucket-11", *settings)


def _of_children() -> float:
    """Return the CPU seconds of all processes that have been waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
