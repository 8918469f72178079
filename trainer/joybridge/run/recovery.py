"""Training goes on when a simulator is lost or slow: with others, from the last state between two rollouts."""

import logging
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing

from joybridge.client.errors import SimulatorError, SimulatorLost, SimulatorShutDown
from joybridge.run.run_state import RunState
from joybridge.run.waits import Slow

log = logging.getLogger("joybridge.trainer")

MAX_PAUSE_SECONDS = 30.0  # seconds
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

    Where a state names a slow simulator and sessions continue from it, a fast one plays its arenas, too, unless it
    refuses to.
    """
    used = 0
    losses = 0  # since the last state
    before: Sequence[str] | None = None  # the addresses, if a slow one has been left since the last state
    leaving = True
    while True:
        try:
            with closing(proceed(addresses, state)) as states:
                for state in states:
                    losses, before = 0, None
                    yield state
                    if leaving and state.slow and state.snapshots is not None:
                        before, addresses = addresses, without(state.slow, addresses)
                        break
                else:
                    return
            continue
        except SimulatorLost as lost:
            losses += 1
            if losses > 1 or not isinstance(lost, SimulatorShutDown):
                used += 1
            if revive is None or used > max_restarts:
                raise
            done = f"{state.timesteps:,}"
            log.warning("%s; training goes on from %s timesteps (restart %d of %d)", lost, done, used, max_restarts)
        except SimulatorError as refusal:
            if before is None:
                raise
            log.warning("%s; each simulator plays its own arenas again", refusal)
            addresses, before, leaving = before, None, False
            continue
        if losses > 1:
            time.sleep(min(2.0 ** (losses - 2), MAX_PAUSE_SECONDS))
        addresses = revive()


def without(slow: Slow, addresses: Sequence[str]) -> list[str]:
    """Return addresses with the fastest one in place of the slow one, so that sessions and their arenas stay."""
    log.warning("%s; from now on the simulator at %s plays its arenas", slow.text, slow.fastest)
    return [slow.fastest if address == slow.address else address for address in addresses]
