"""One session spread over several simulators, or over several options of a game, with the interface of `Session`.

Part k of n plays its share of the arenas, with the same seed and with their numbers in the whole. So the episodes do
not depend on the number of simulators.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.trainer.wire.client import CALL_SECONDS, Session, Transport
from joybridge.trainer.wire.errors import SimulatorError

__all__ = ["ShardedSession", "Snapshot", "check_alike", "split"]

Snapshot = dict[str, bytes]


def split(arenas: int, parts: int) -> list[int]:
    """Return the bounds of nearly equal parts: part k has the arenas from bounds[k] to bounds[k + 1] - 1."""
    return [int(bound) for bound in np.linspace(0, arenas, parts + 1).round()]


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
                    snapshot=snapshots[index] if snapshots else None, timeout=timeout, transport=transport,
                )  # fmt: skip
                self.sessions.append(opened.enter_context(session))
                check_alike(session, self.sessions[0])
            self._opened = opened.pop_all()
        self.spec = self.sessions[0].spec
        self.bounds = [[lane_count(behavior, arena) for arena in bounds] for behavior in self.spec.behaviors]
        self.steps = _join([session.steps for session in self.sessions])

    @property
    def simulate_seconds(self) -> float:
        """Return the time that the game itself took for the last step: the longest, as simulators work in parallel."""
        return max(session.simulate_seconds for session in self.sessions)

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep without waiting; `receive` returns the step. Raises SimulatorError."""
        for index, session in enumerate(self.sessions):
            session.send([
                ActArrays(act.axes[lanes[index] : lanes[index + 1]], act.choices[lanes[index] : lanes[index + 1]])
                for act, lanes in zip(acts, self.bounds, strict=True)
            ])  # fmt: skip

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        self.steps = _join([session.receive() for session in self.sessions])
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
    snapshots: Sequence[Snapshot] | None = None,
    timeout: float = CALL_SECONDS,
    transport: Transport = "auto",
) -> Session | ShardedSession:
    """Open one session at a single address, or a sharded one at several. Raises SimulatorError."""
    if len(addresses) > 1:
        return ShardedSession(
            addresses, game, arenas=arenas, seed=seed, first_arena=first_arena, options=options, parameters=parameters,
            snapshots=snapshots, timeout=timeout, transport=transport,
        )  # fmt: skip
    return Session(
        addresses[0], game, arenas=arenas, seed=seed, first_arena=first_arena, options=options[0],
        parameters=parameters, snapshot=snapshots[0] if snapshots else None, timeout=timeout, transport=transport,
    )  # fmt: skip


def single_sessions(session: Session | ShardedSession) -> list[Session]:
    """Return the sessions that a sharded one is made of, or the only one."""
    return session.sessions if isinstance(session, ShardedSession) else [session]


def _join(parts: list[list[StepArrays]]) -> list[StepArrays]:
    """Return one StepArrays per behavior, with the lanes of all parts in order."""
    return [_join_lanes(list(steps)) for steps in zip(*parts, strict=True)]


def _join_lanes(parts: list[StepArrays]) -> StepArrays:
    lanes = np.cumsum([0, *(len(part.rewards) for part in parts)])
    ending = [part for part in parts if len(part.ended)]
    joined = StepArrays(
        [np.concatenate(columns) for columns in zip(*(part.observations for part in parts), strict=True)],
        np.concatenate([part.rewards for part in parts]),
        np.concatenate([part.terminated for part in parts]),
        np.concatenate([part.truncated for part in parts]),
        _join_masks(parts),
        _join_deciding(parts),
        np.concatenate([part.ended + first for part, first in zip(parts, lanes, strict=False)]).astype(np.int32),
    )
    if ending:
        finals = [part.final_observations or [] for part in ending]
        joined.final_observations = [np.concatenate(columns) for columns in zip(*finals, strict=True)]
        metrics = [part.metrics for part in ending if part.metrics is not None]
        joined.metrics = np.concatenate(metrics) if metrics else None
    return joined


def _join_masks(parts: list[StepArrays]) -> list[Array] | None:
    given = next((part.masks for part in parts if part.masks is not None), None)
    if given is None:
        return None
    filled = [part.masks or [np.ones((len(part.rewards), mask.shape[1]), bool) for mask in given] for part in parts]
    return [np.concatenate(columns) for columns in zip(*filled, strict=True)]


def _join_deciding(parts: list[StepArrays]) -> Array | None:
    if all(part.deciding is None for part in parts):
        return None
    return np.concatenate([
        np.ones(len(part.rewards), bool) if part.deciding is None else part.deciding for part in parts
    ])  # fmt: skip
