"""One session spread over several simulators, or over several options of a game, with the interface of `Session`.

Part k of n plays its share of the arenas, with the same seed and with their numbers in the whole. So the episodes do
not depend on the number of simulators.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Protocol

from joybridge.client.client import CALL_SECONDS, Distributions, Session, Transport
from joybridge.client.errors import SimulatorError
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.parts import join, part_of, split

__all__ = ["ShardedSession", "Snapshot", "check_alike", "split"]

Snapshot = dict[str, bytes]


def check_alike(session: Session, first: Session) -> None:
    """Raise SimulatorError unless two sessions have the same behaviors: names, sizes and their order."""
    if list(session.spec.behaviors) != list(first.spec.behaviors):
        raise SimulatorError(
            f"the simulators at {first.address} and {session.address} run different versions of {first.spec.name}: "
            "their behaviors differ; restart both from the same files"
        )


class ShardedSession:
    """Sessions with the interface of a single one. `steps` holds the last step, one StepArrays per behavior."""

    def __init__(
        self,
        addresses: Sequence[str],
        game: str,
        *,
        arenas: int,
        seed: int,
        first_arena: int = 0,
        options: Sequence[Mapping[str, str]],
        parameters: Mapping[str, float] | None = None,
        distributions: Distributions | None = None,
        snapshots: Sequence[Snapshot] | None = None,
        timeout: float = CALL_SECONDS,
        transport: Transport = "auto",
    ) -> None:
        """Open one session per address, each with its own options; arenas are divided among them.

        The options must give the same behaviors. Raises SimulatorError.
        """
        bounds = split(arenas, len(addresses))
        self.sessions: list[Session] = []
        with ExitStack() as opened:
            for index, address in enumerate(addresses):
                session = Session(
                    address, game, arenas=bounds[index + 1] - bounds[index], seed=seed,
                    first_arena=first_arena + bounds[index], options=options[index], parameters=parameters,
                    distributions=distributions,
                    snapshot=snapshots[index] if snapshots else None, timeout=timeout, transport=transport,
                )  # fmt: skip
                self.sessions.append(opened.enter_context(session))
                check_alike(session, self.sessions[0])
            self._opened = opened.pop_all()
        self.spec = self.sessions[0].spec
        self.bounds = [[lane_count(behavior, arena) for arena in bounds] for behavior in self.spec.behaviors]
        self.steps = join([session.steps for session in self.sessions])

    @property
    def simulate_seconds(self) -> float:
        """Return the time that the game itself took for the last step: the longest, as simulators work in parallel."""
        return max(session.simulate_seconds for session in self.sessions)

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep without waiting; `receive` returns the step. Raises SimulatorError."""
        for index, session in enumerate(self.sessions):
            session.send(part_of(acts, self.bounds, index))

    def distribute(self, distributions: Distributions) -> None:
        """Draw these parameters anew in all episodes that begin from the next step on; running ones keep theirs."""
        for session in self.sessions:
            session.distribute(distributions)

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        self.steps = join([session.receive() for session in self.sessions])
        return self.steps

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one timestep and return the step. Raises SimulatorError."""
        self.send(acts)
        return self.receive()

    def close(self) -> None:
        """End all sessions."""
        self._opened.close()


def open_session(
    addresses: Sequence[str],
    game: str,
    *,
    arenas: int,
    seed: int,
    first_arena: int = 0,
    options: Sequence[Mapping[str, str]],
    parameters: Mapping[str, float] | None = None,
    distributions: Distributions | None = None,
    snapshots: Sequence[Snapshot] | None = None,
    timeout: float = CALL_SECONDS,
    transport: Transport = "auto",
) -> Session | ShardedSession:
    """Open one session at a single address, or a sharded one at several. Raises SimulatorError."""
    if len(addresses) > 1:
        return ShardedSession(
            addresses, game, arenas=arenas, seed=seed, first_arena=first_arena, options=options, parameters=parameters,
            distributions=distributions, snapshots=snapshots, timeout=timeout, transport=transport,
        )  # fmt: skip
    return Session(
        addresses[0], game, arenas=arenas, seed=seed, first_arena=first_arena, options=options[0],
        parameters=parameters, distributions=distributions, snapshot=snapshots[0] if snapshots else None,
        timeout=timeout, transport=transport,
    )  # fmt: skip


class Composed(Protocol):
    """A session that is made of others."""

    sessions: list[Session]


def single_sessions(session: Session | Composed) -> list[Session]:
    """Return the sessions that a session is made of, or the only one."""
    return [session] if isinstance(session, Session) else session.sessions
