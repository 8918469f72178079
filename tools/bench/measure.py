"""What benchmarks share: rates over windows, random actions, and what a process takes."""

import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from joybridge.contract.codec import ActArrays
from joybridge.v1 import bridge_pb2 as pb

WINDOWS = 7
GAMES = ("shooting_birds", "beastly_rivals")
CONFIGS = Path(__file__).resolve().parents[2] / "configs"
Figures = dict[str, dict[str, float]]  # what -> {"median", "low", "high"} per second, or seconds


def measure(work: Callable[[], float]) -> dict[str, float]:
    """Return median, lowest and highest rate over windows; `work` does a window's work and returns its size."""
    work()
    rates = []
    for _ in range(WINDOWS):
        begin = time.perf_counter()
        size = work()
        rates.append(size / (time.perf_counter() - begin))
    return {"median": statistics.median(rates), "low": min(rates), "high": max(rates)}


def random_acts(spec: pb.GameSpec, arenas: int, rng: np.random.Generator) -> list[list[ActArrays]]:
    """Return a few random actions for all lanes to play in turn."""
    device = spec.behaviors[0].device
    axes = [rng.uniform(-1, 1, (arenas, len(device.axes))).astype(np.float32) for _ in range(16)]
    choices = [rng.integers(0, 2, (arenas, len(device.branches))).astype(np.int32) for _ in range(16)]
    return [[ActArrays(a, c)] for a, c in zip(axes, choices, strict=True)]


def spread(values: list[float]) -> dict[str, float]:
    """Return the median of values, and the bounds below and above which 5 % of them are."""
    median, low, high = np.percentile(values, (50, 5, 95)).tolist()
    return {"median": median, "low": low, "high": high}


def children() -> list[int]:
    """Return the children of this process, the newest last."""
    return sorted(int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def megabytes(process: int) -> float:
    """Return the resident memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def machine() -> str:
    """Return what this was measured on."""
    return (
        f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}, torch {torch.__version__}"
    )
