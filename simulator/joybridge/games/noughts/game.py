"""Noughts and crosses: three in a row wins. Two agents of one behavior take turns.

One agent decides while the other waits, taken fields are masked, and only the end of an episode is rewarded. Both
agents have the same policy, so their rewards add up to 0; the metric `sound`, the fraction of moves that do not worsen
the outcome of perfect play, shows how well it plays.
"""

from collections.abc import Mapping
from functools import cache

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    behavior,
    branch,
    sensor,
    spec,
    termination,
    transition,
    waiting,
)
from joybridge.v1 import bridge_pb2 as pb

FIELDS = range(9)  # row by row; a player's marks are an integer with a bit per field
FULL = 0b111_111_111
ROWS = (0b111, 0b111_000, 0b111_000_000, 0b1_001_001, 0b10_010_010, 0b100_100_100, 0b100_010_001, 0b1_010_100)
SIZE = 280


class Noughts(Game):
    """One board with two players."""

    name = "noughts"
    description = "Three in a row wins: two agents of one behavior take turns, and one of them always waits."
    version = "1"
    in_event_loop = True
    last = (0, 0)  # both players' marks at the end of the previous episode, for the picture

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: two agents that choose a field."""
        player = behavior(
            "player",
            description="reward at the end: 1 for a win, -1 for a loss, 0 for a draw",
            sensors=[sensor("own", [9], 0, 1, "marks, row by row"), sensor("other", [9], 0, 1, "the other's marks")],
            branches=[branch("field", [f"{column}{row}" for row in "123" for column in "abc"])],
            metrics=["sound", "drawn"],
            scripts={
                "perfect": "any move that does not worsen the outcome of perfect play",
                "careless": "half of its moves are perfect, the others random",
                "random": "any move",
            },
            agents=2,
        )
        return spec(cls, [player], picture=(SIZE, SIZE))

    def reset(self) -> list[TimeStep]:
        """Begin an episode with an empty board; who moves first is random."""
        self.mover = int(self.rng.integers(2))
        self.marks, self.moves, self.sound = [0, 0], [0, 0], [0, 0]
        return self._take_turns()

    def step(self, action: list[Action]) -> list[TimeStep]:
        """Mark the field that the mover has chosen; then it is the other agent's turn."""
        mover, other = self.mover, 1 - self.mover
        before, theirs = self.marks[mover], self.marks[other]
        after = before | 1 << int(action[mover]["field"])
        self.moves[mover] += 1
        self.sound[mover] += -outcome(theirs, after) == outcome(before, theirs)
        self.marks[mover], self.mover = after, other
        if not wins(after) and after | theirs != FULL:
            return self._take_turns()
        self.last = (self.marks[0], self.marks[1])
        won, turns = float(wins(after)), []
        for agent in (0, 1):
            metrics = {"sound": self.sound[agent] / self.moves[agent], "drawn": 1 - won}
            turns.append(termination(self._observe(agent), {"reward": won if agent == mover else -won}, metrics))
        return turns

    def script(self, name: str, agent: int) -> Action:
        """Return a move of a script: one of those that it likes equally."""
        own, other = self.marks[agent], self.marks[1 - agent]
        moves = [field for field in FIELDS if not (own | other) >> field & 1]
        if name == "perfect" or (name == "careless" and self.rng.random() < 0.5):
            moves = [move for move in moves if -outcome(other, own | 1 << move) == outcome(own, other)]
        return {"field": moves[int(self.rng.integers(len(moves)))]}

    def _take_turns(self) -> list[TimeStep]:
        free = [not (self.marks[0] | self.marks[1]) >> field & 1 for field in FIELDS]
        turns = [waiting(self._observe(agent)) for agent in (0, 1)]
        turns[self.mover] = transition(self._observe(self.mover), masks={"field": free})
        return turns

    def _observe(self, agent: int) -> dict[str, list[int]]:
        own, other = ([marks >> field & 1 for field in FIELDS] for marks in (self.marks[agent], self.marks[1 - agent]))
        return {"own": own, "other": other}

    def draw(self) -> Array:
        """Return a picture of the board; before the first move, the end of the previous episode in faint colors."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, disc, fit, picture, shape

        canvas = pygame.Surface((SIZE * FINE, SIZE * FINE))
        frame = fit(*canvas.get_size(), 1.7, 1.7)
        canvas.fill((248, 242, 228))

        def bar(place: Array, half: float, turn: float, color: tuple[int, int, int], thick: float = 0.06) -> None:
            corners = [(-half, -thick), (half, -thick), (half, thick), (-half, thick)]
            shape(canvas, frame.placed(place[0], place[1], turn=turn), corners, color)

        for line in (-0.5, 0.5):
            bar(np.array([0, line]), 1.45, 0, (96, 88, 84), 0.02)
            bar(np.array([line, 0]), 1.45, np.pi / 2, (96, 88, 84), 0.02)
        new = not any(self.marks)
        noughts, crosses = self.last if new else self.marks
        red, blue = ((238, 190, 178), (178, 202, 216)) if new else ((214, 68, 60), (47, 111, 180))
        places = [np.array([field % 3 - 1.0, 1.0 - field // 3]) for field in FIELDS]
        for field, place in enumerate(places):
            if noughts >> field & 1:
                disc(canvas, frame.points([place])[0], frame.length(0.33), blue, frame.length(0.12))
            for turn in (-np.pi / 4, np.pi / 4) if crosses >> field & 1 else ():
                bar(place, 0.4, turn, red)
        for row in ROWS:
            if row in (noughts & row, crosses & row):
                begin, middle, end = (place for field, place in enumerate(places) if row >> field & 1)
                way = end - begin
                bar(middle, 0.65 * float(np.hypot(*way)), float(np.arctan2(way[1], way[0])), (96, 88, 84), 0.03)
        return picture(canvas)


def wins(marks: int) -> bool:
    """Return whether a player has three in a row."""
    return any(marks & row == row for row in ROWS)


@cache
def outcome(own: int, other: int) -> int:
    """Return the outcome of perfect play for the player to move: 1 a win, 0 a draw, -1 a loss."""
    if wins(other):
        return -1
    free = [1 << field for field in FIELDS if not (own | other) >> field & 1]
    return max((-outcome(other, own | field) for field in free), default=0)
