"""Training goes on when a simulator or a learner is lost: with new ones, from the last state between two rollouts."""

import logging
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing

from joybridge.client.errors import SimulatorLost, SimulatorShutDown
from joybridge.run.run_state import RunState

log = logging.getLogger("joybridge.trainer")

LONGEST_PAUSE = 30.0  # seconds
States = Generator[RunState, None, None]
Revive = Callable[[], Sequence[str]]


def recovering(
    proceed: Callable[[Sequence[str], RunState], States],
    state: RunState,
    addresses: Sequence[str],
    revive: Revive | None,
    max_restarts: int,
) -> States:
    """Yield the states of `proceed`, which continues a run from a state with the simulators at some addresses.

    When a simulator or a learner is lost, `revive` returns the addresses of simulators that answer, and `proceed` is
    called again with the last state. This happens at most `max_restarts` times. A simulator that announced its end does
    not count, unless the run has not reached a new state since the last loss. After that, and without `revive`, raises
    SimulatorLost.
    """
    used = 0
    losses = 0  # since the last state
    while True:
        try:
            with closing(proceed(addresses, state)) as states:
                for state in states:
                    losses = 0
                    yield state
            return
        except SimulatorLost as lost:
            losses += 1
            if losses > 1 or not isinstance(lost, SimulatorShutDown):
                used += 1
            if revive is None or used > max_restarts:
                raise
            done = f"{state.timesteps:,}"
            log.warning("%s; training goes on from %s timesteps (restart %d of %d)", lost, done, used, max_restarts)
        if losses > 1:
            time.sleep(min(2.0 ** (losses - 2), LONGEST_PAUSE))
        addresses = revive()
