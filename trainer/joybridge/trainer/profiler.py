"""Where the time of a run goes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from joybridge.trainer.metrics import ACTIVITIES


class Simulated(Protocol):
    """Something that knows how long the games took in the last step."""

    @property
    def simulate_seconds(self) -> float:
        """Return seconds."""


class Profiler:
    """Seconds by activity, and timesteps, since the last row of metrics."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(ACTIVITIES, 0.0)
        self.begin = time.perf_counter()
        self.timesteps = 0

    @contextmanager
    def measure(self, activity: str) -> Iterator[None]:
        """Add the time of the block to an activity."""
        begin = time.perf_counter()
        yield
        self.seconds[activity] += time.perf_counter() - begin

    @contextmanager
    def measure_wait(self, simulators: Simulated) -> Iterator[None]:
        """Split the time of the block, a wait for the simulators, into their own work and the wire."""
        begin = time.perf_counter()
        yield
        waited = time.perf_counter() - begin
        simulated = min(waited, simulators.simulate_seconds)  # the wait begins later than the step
        self.seconds["simulate"] += simulated
        self.seconds["wire"] += waited - simulated

    def shares(self) -> dict[str, float]:
        """Return each activity's fraction of the time since the last row."""
        elapsed = max(time.perf_counter() - self.begin, 1e-9)
        return {name: seconds / elapsed for name, seconds in self.seconds.items()}

    def speed(self) -> float:
        """Return timesteps per second since the last row."""
        return self.timesteps / max(time.perf_counter() - self.begin, 1e-9)

    def live(self) -> dict[str, float]:
        """Return speed and shares."""
        return {"timesteps_per_second": self.speed(), **self.shares()}

    def summarize(self) -> dict[str, float]:
        """Return speed and shares, and start over."""
        row = self.live()
        self.__init__()  # type: ignore[misc]
        return row
