"""One session spread over several simulators, or over several options of a game, with the interface of `Session`.

Part k of n plays its share of the arenas, with the same seed and with their numbers in the whole. So the episodes do
not depend on the number of simulators.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Protocol

from joybridge.client.calls import CALL_SECONDS
from joybridge.client.client import Distributions, Session, Transport
from joybridge.client.errors import SimulatorError
from joybridge.config.config import Config
from joybridge.config.game_settings import drawn, fixed
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.sharding import join, part_of, split

__all__ = [
    "SessionSpec",
    "ShardedSession",
    "Snapshot",
    "check_alike",
    "divide",
    "open_session",
    "session_spec",
    "split",
]

Snapshot = dict[str, bytes]


def check_alike(session: Session, first: Session) -> None:
    """Raise SimulatorError unless two sessions have the same behaviors: names, sizes and their order."""
    if list(session.spec.behaviors) != list(first.spec.behaviors):
        raise SimulatorError(
            f"the simulators at {first.address} and {session.address} run different versions of {first.spec.name}: "
            "their behaviors differ; restart both from the same files"
        )


@dataclass(frozen=True)
class SessionSpec:
    """What a session plays: the arguments of `Session` beside the address of the simulator."""

    game: str
    arenas: int
    seed: int
    first_arena: int = 0
    options: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    distributions: Distributions = field(default_factory=dict)
    snapshot: Snapshot | None = None
    timeout: float = CALL_SECONDS
    transport: Transport = "auto"

    def open(self, address: str) -> Session:
        """Open the session at one simulator. Raises SimulatorError."""
        return Session(address, **vars(self))


def session_spec(config: Config, arenas: int, seed: int) -> SessionSpec:
    """Return the spec of a session with the game of a configuration, its options and its parameters."""
    return SessionSpec(
        config.game,
        arenas,
        seed,
        options=config.options,
        parameters=fixed(config.parameters),
        distributions=drawn(config.parameters),
        timeout=config.timeout_seconds,
        transport=config.transport,
    )


def divide(
    whole: SessionSpec, parts: int, options: Sequence[Mapping[str, str]] = (), snapshots: Sequence[Snapshot] = ()
) -> list[SessionSpec]:
    """Return the specs of so many sessions that play the arenas of one, side by side.

    options, snapshots: one for each part, if they are not those of the whole.
    """
    bounds = split(whole.arenas, parts)
    return [
        replace(
            whole,
            arenas=bounds[index + 1] - first,
            first_arena=whole.first_arena + first,
            options=options[index] if options else whole.options,
            snapshot=snapshots[index] if snapshots else whole.snapshot,
        )
        for index, first in enumerate(bounds[:-1])
    ]


class ShardedSession:
    """Sessions with the interface of a single one. `steps` holds the last step, one StepArrays per behavior."""

    def __init__(self, addresses: Sequence[str], parts: Sequence[SessionSpec]) -> None:
        """Open one session per address, each with its part of the arenas. Raises SimulatorError.

        The options of the parts must give the same behaviors.
        """
        self.sessions: list[Session] = []
        with ExitStack() as opened:
            for address, part in zip(addresses, parts, strict=True):
                session = opened.enter_context(part.open(address))
                self.sessions.append(session)
                check_alike(session, self.sessions[0])
            self._opened = opened.pop_all()
        bounds = [0, *accumulate(part.arenas for part in parts)]
        self.spec = self.sessions[0].spec
        self.bounds = [[lane_count(behavior, arena) for arena in bounds] for behavior in self.spec.behaviors]
        self.steps = join([session.steps for session in self.sessions])
        self._first = 0  # who is waited for first

    @property
    def simulate_seconds(self) -> float:
        """Return the time that the game itself took for the last step: the longest, as simulators work in parallel."""
        return max(session.simulate_seconds for session in self.sessions)

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep without waiting; `receive` returns the step. Raises SimulatorError."""
        for index, session in enumerate(self.sessions):
            session.send(part_of(acts, self.bounds, index))

    def distribute(self, distributions: Distributions) -> None:
        """Draw these parameters in all episodes that begin from the next step on; running ones keep theirs."""
        for session in self.sessions:
            session.distribute(distributions)

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        count = len(self.sessions)
        self._first = (self._first + 1) % count  # in turns: whoever is first is waited for while all others work, too
        turns = [(self._first + turn) % count for turn in range(count)]
        received = {index: self.sessions[index].receive() for index in turns}
        self.steps = join([received[index] for index in range(count)])
        return self.steps

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one timestep and return the step. Raises SimulatorError."""
        self.send(acts)
        return self.receive()

    def close(self) -> None:
        """End all sessions."""
        self._opened.close()


def open_session(addresses: Sequence[str], parts: Sequence[SessionSpec]) -> Session | ShardedSession:
    """Open one session at a single address, or a sharded one at several. Raises SimulatorError."""
    return ShardedSession(addresses, parts) if len(parts) > 1 else parts[0].open(addresses[0])


class Composed(Protocol):
    """A session that is made of others."""

    sessions: list[Session]


def single_sessions(session: Session | Composed) -> list[Session]:
    """Return the sessions that a session is made of, or the only one."""
    return [session] if isinstance(session, Session) else session.sessions
