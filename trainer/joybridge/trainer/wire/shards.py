"""Arenas spread over several sessions, used like one: at several simulators, or under different options.

Session k of n plays its share of the arenas as arenas first..last of the one seed, so what is played does not
depend on how many simulators play it.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.trainer.wire.client import Session, SimulatorError

Snapshot = dict[str, bytes]


def split(arenas: int, parts: int) -> list[int]:
    """Return the first arena of each of `parts` nearly equal parts, and behind them the number of arenas."""
    return [int(bound) for bound in np.linspace(0, arenas, parts + 1).round()]


def check_alike(session: Session, first: Session) -> None:
    """Raise SimulatorError unless two sessions play the same: names, sizes and their order."""
    if list(session.spec.behaviors) != list(first.spec.behaviors):
        raise SimulatorError(
            f"the simulators at {first.address} and {session.address} run different versions of {first.spec.name}: "
            "their behaviors differ; start both anew from the same files"
        )


class Shards:
    """Sessions with the interface of a single one."""

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
    ) -> None:
        """Open a session per address, with options of its own; `steps` holds the first observations.

        The options must give the same behaviors. Raises SimulatorError.
        """
        bounds = split(arenas, len(addresses))
        self._stack = ExitStack()
        self.sessions: list[Session] = []
        with self._stack:
            for index, address in enumerate(addresses):
                session = Session(
                    address, game, arenas=bounds[index + 1] - bounds[index], seed=seed,
                    first_arena=first_arena + bounds[index], options=options[index], parameters=parameters,
                    snapshot=snapshots[index] if snapshots else None,
                )  # fmt: skip
                self.sessions.append(self._stack.enter_context(session))
                check_alike(session, self.sessions[0])
            self._stack = self._stack.pop_all()
        self.spec = self.sessions[0].spec
        self.bounds = [[lane_count(b, arena) for arena in bounds] for b in self.spec.behaviors]
        self.steps = _join([session.steps for session in self.sessions])

    @property
    def simulate_seconds(self) -> float:
        """Return the games' own time in the last step; simulators work side by side, so the longest counts."""
        return max(session.simulate_seconds for session in self.sessions)

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one decision without waiting for the step; `receive` returns it."""
        for index, session in enumerate(self.sessions):
            session.send([
                ActArrays(act.axes[lanes[index] : lanes[index + 1]], act.choices[lanes[index] : lanes[index + 1]])
                for act, lanes in zip(acts, self.bounds, strict=True)
            ])  # fmt: skip

    def receive(self) -> list[StepArrays]:
        """Wait for the step of the last `send`; it is also kept in `steps`. Raises SimulatorError."""
        self.steps = _join([session.receive() for session in self.sessions])
        return self.steps

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. Raises SimulatorError."""
        self.send(acts)
        return self.receive()

    def save(self) -> list[Snapshot]:
        """Return a snapshot per simulator."""
        return [session.save() for session in self.sessions]

    def close(self) -> None:
        """End all sessions."""
        self._stack.close()


def _join(parts: list[list[StepArrays]]) -> list[StepArrays]:
    """Return one StepArrays per behavior, the lanes of all parts in order."""
    return parts[0] if len(parts) == 1 else [_join_lanes(list(steps)) for steps in zip(*parts, strict=True)]


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
