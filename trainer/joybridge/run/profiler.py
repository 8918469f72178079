"""Where the time of a run goes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from joybridge.config.metrics import ACTIVITIES, Row

if TYPE_CHECKING:  # the profiler itself needs nothing of the wire
    from joybridge.client.client import Session
    from joybridge.client.several_session import SeveralSession
    from joybridge.client.sharded_session import ShardedSession


LIVE_SECONDS = 0.5  # between two live figures


class Profiler:
    """Seconds by activity, and timesteps, since the last row of metrics."""

    def __init__(self) -> None:
        self.restart()
        self._shown = self.begin

    def restart(self) -> None:
        """Start over."""
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
    def measure_wait(self, session: "Session | ShardedSession | SeveralSession") -> Iterator[None]:
        """Split the time of the block, a wait for the simulators, into their own work and the wire."""
        begin = time.perf_counter()
        yield
        waited = time.perf_counter() - begin
        simulated = min(waited, session.simulate_seconds)  # the wait begins later than the step
        self.seconds["simulate"] += simulated
        self.seconds["wire"] += waited - simulated

    def live(self) -> Row:
        """Return timesteps per second, and the fraction of the time of each activity, since the last row."""
        elapsed = max(time.perf_counter() - self.begin, 1e-9)
        fractions = {name: seconds / elapsed for name, seconds in self.seconds.items()}
        return {"timesteps_per_second": self.timesteps / elapsed, **fractions}

    def due(self) -> bool:
        """Return whether it is time to show live figures again."""
        now = time.perf_counter()
        if now - self._shown < LIVE_SECONDS:
            return False
        self._shown = now
        return True

    def summarize(self) -> Row:
        """Return what `live` does, and start over."""
        row = self.live()
        self.restart()
        return row
