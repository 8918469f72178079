"""Which place of a player an agent takes: its lane, from its first decision to the end of its episode.

An agent's id is that of its episode, and players number episodes in the order in which they begin. The next episode of
a place often asks for its first decision later than others do, so the id that it will have is worked out.
"""

from collections.abc import Iterable


class Slots:
    """The places of the agents of one behavior in one player."""

    def __init__(self, count: int) -> None:
        """Number the places; they are free after `clear`."""
        self.count = count
        self._next = 0  # the id of the next episode that begins
        self._of: dict[int, int] = {}  # places by agent
        self._free: dict[int, int] = {}  # free places, by the id of the agent that is expected there

    def clear(self) -> None:
        """Free all places, because new episodes begin."""
        self._of = {}
        self._free = {self._next + place: place for place in range(self.count)}
        self._next += self.count

    def find(self, ids: Iterable[int]) -> list[int]:
        """Return the place of each agent, -1 for those that have none."""
        return [self._of.get(one, -1) for one in ids]

    def end(self, ids: Iterable[int]) -> None:
        """Free the places of agents whose episodes have ended."""
        for one in ids:
            place = self._of.pop(one, -1)
            if place >= 0:
                self._free[self._next] = place
            self._next += 1

    def begin(self, ids: Iterable[int]) -> None:
        """Give places to agents that have none, as far as there are any."""
        new = sorted(set(ids) - self._of.keys())
        if not new:
            return
        self._next = max(self._next, new[-1] + 1)
        expected = list(self._free) if len(new) == len(self._free) else new
        for one, wanted in zip(new, expected, strict=True):
            if wanted in self._free:
                self._of[one] = self._free.pop(wanted)
        for one in new:
            if one not in self._of and self._free:
                self._of[one] = self._free.pop(next(iter(self._free)))
