"""The players of some arenas, each in the seats that it holds: one batch per policy in every decision."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from joybridge.config.arrays import select
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.player import PolicyPlayer
from joybridge.policy.seats import Seats
from joybridge.v1 import bridge_pb2 as pb

SAMPLES = 2**62  # plus the number of the table: the second word of the key of what its players draw


class Seated(Protocol):
    """Who plays where a holder has seats of one behavior. Lanes are given by their numbers; see `PolicyPlayer`."""

    name: str
    behavior: int
    seed: int
    rng: np.random.Generator

    def begin(self, step: StepArrays) -> None: ...  # noqa: D102
    def act(self, step: StepArrays, act: ActArrays, held: Array) -> None: ...  # noqa: D102
    def store(self, step: StepArrays, held: Array) -> object: ...  # noqa: D102
    def state(self, held: Array) -> dict[str, Array]: ...  # noqa: D102
    def load(self, state: dict[str, Array], held: Array) -> None: ...  # noqa: D102


class Guest(Protocol):
    """Who may sit down: a script or an exported policy, and whose state a checkpoint holds."""

    name: str
    behavior: int

    def seat(self, lanes: int) -> Seated: ...  # noqa: D102
    def state(self) -> dict[str, Array]: ...  # noqa: D102
    def load(self, state: dict[str, Array]) -> None: ...  # noqa: D102


class Table:
    """Seats, and the frozen policies and scripts that hold some of them: those who have joined under a number."""

    def __init__(self, spec: pb.GameSpec, arenas: int, seed: int, number: int = 0) -> None:
        """Begin without players. number: of the table, among those with the same seed."""
        self.arenas, self.seats = arenas, Seats(spec, arenas)
        self.players: dict[int, list[Seated]] = {}  # by the number of a holder: a player per policy
        self._lanes = [lane_count(behavior, arenas) for behavior in spec.behaviors]
        self._key, self._decisions = [seed, SAMPLES + number], 0

    def reseed(self, seed: int) -> None:
        """Sample as a new table with this seed does."""
        self._key[0], self._decisions = seed, 0

    def join(self, holder: int, parts: Sequence[Actor | Guest]) -> None:
        """Let actors or guests of all behaviors play where a holder has a seat.

        They see nothing before the next match.
        """
        self.players[holder] = [
            PolicyPlayer(one, lanes, 0, deterministic=False) if isinstance(one, Actor) else one.seat(lanes)
            for one, lanes in ((one, self._lanes[one.behavior]) for one in parts)
        ]

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Take the first steps of a session; entries are behaviors."""
        for _, player in self._seated():
            player.begin(steps[player.behavior])

    def act(self, steps: Sequence[StepArrays], acts: Sequence[ActArrays]) -> None:
        """Write what the players do into their lanes of `acts`. Samples depend on the seed and the decision alone."""
        for act in acts:
            act.scripts = None  # those who had them may have left their seats
        acted: list[tuple[PolicyPlayer, Array]] = []
        for holder, player in self._seated():
            behavior, held = player.behavior, self._held(holder, player)
            if (deciding := steps[behavior].deciding) is not None:
                held = held[deciding[held]]
            if len(held):
                counter = [0, player.seed, holder, self._decisions]
                player.rng = np.random.Generator(np.random.Philox(key=self._key, counter=counter))
                player.act(steps[behavior], acts[behavior], held)
                if isinstance(player, PolicyPlayer):
                    acted.append((player, held))
        for player, held in acted:  # when all parts of the device are chosen
            player.note(steps[player.behavior], acts[player.behavior], held)
        self._decisions += 1

    def sit(self, steps: Sequence[StepArrays]) -> None:
        """Change seats where episodes ended in a step, and let all players see what they hold now."""
        self.seats.sit(steps)
        for holder, player in self._seated():
            held = self._held(holder, player)
            if len(held):
                player.store(steps[player.behavior], held)

    def _held(self, holder: int, player: Seated) -> Array:
        """Return the numbers of the lanes that a player of a holder has now."""
        return np.flatnonzero(self.seats.holders(player.behavior) == holder)

    def _seated(self) -> list[tuple[int, Seated]]:
        return [(holder, player) for holder, players in self.players.items() for player in players]

    def state(self) -> dict[str, Array]:
        """Return copies of everything but the policies, for a checkpoint."""
        arrays = {f"seats.{name}": array for name, array in self.seats.state().items()}
        for holder, player in self._seated():
            remembered = player.state(self._held(holder, player))
            arrays |= {f"players.{holder}.{player.name}.{name}": array for name, array in remembered.items()}
        return arrays | {"decisions": np.array(self._decisions)}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned, with the same players."""
        self.seats.load(select(state, "seats."))
        self._decisions = int(state["decisions"])
        for holder, player in self._seated():
            remembered = select(state, f"players.{holder}.{player.name}.")
            player.load(remembered, self._held(holder, player))
