"""Who holds the seats that the person does not, and whether its matches are rated. Needs torch."""

from collections.abc import Sequence

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.policy.players import Players
from joybridge.viewer.rated import RatedMatches


class Others:
    """Who holds the seats that the person does not."""

    def __init__(self, players: Players, rated: RatedMatches | None) -> None:
        """players: in all seats; the person takes one from them. rated: the log of its matches, if it wants one."""
        self._players, self._rated = players, rated

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Take the first steps of a session."""
        self._players.begin(steps)

    def act(self, steps: Sequence[StepArrays], seat: int | None) -> list[ActArrays]:
        """Return what they do in all seats. seat: the person's, None: all."""
        if self._rated:
            self._rated.hold(seat)
        return self._players.act(steps)

    def store(self, steps: Sequence[StepArrays]) -> None:
        """Take what followed. Raises StorageError and CheckpointError."""
        self._players.store(steps)
        if self._rated:
            self._rated.take(steps)
