"""Play a trained policy of noughts and crosses against every player there is: all moves of the other, in both seats.

    python -m tools.noughts RUN...

A line is a whole game: the policy's likeliest moves against one sequence of the other's. For each run, this prints how
many lines there are, and how many of them the policy loses.
"""

import argparse
from collections.abc import Callable
from functools import cache
from pathlib import Path

from joybridge.games.noughts.game import FIELDS, FULL, wins
from joybridge.play.agent import load


def lines(move: Callable[[int, int], int]) -> tuple[int, int]:
    """Return how many lines there are against a player, and how many of them it loses.

    move: its field, for its own marks and the other's, an integer with a bit per field each.
    """

    def play(own: int, other: int, *, mine: bool) -> tuple[int, int]:
        if wins(other):
            return 1, 1
        if wins(own) or own | other == FULL:
            return 1, 0
        if mine:
            return play(own | 1 << move(own, other), other, mine=False)
        free = [1 << field for field in FIELDS if not (own | other) >> field & 1]
        found = [play(own, other | field, mine=True) for field in free]
        return sum(count for count, _ in found), sum(lost for _, lost in found)

    (first, lost_first), (second, lost_second) = (play(0, 0, mine=mine) for mine in (True, False))
    return first + second, lost_first + lost_second


def player(run: Path) -> Callable[[int, int], int]:
    """Return the likeliest moves of a run's policy. Raises ConfigError and CheckpointError."""
    agent = load(run, deterministic=True)

    @cache
    def move(own: int, other: int) -> int:
        agent.begin()
        seen = {name: [marks >> field & 1 for field in FIELDS] for name, marks in (("own", own), ("other", other))}
        free = [not (own | other) >> field & 1 for field in FIELDS]
        return int(agent.act(seen, {"field": free})["field"])

    return move


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.noughts", description=__doc__.splitlines()[0])
    parser.add_argument("run", nargs="+", help="folder of a run")
    for run in parser.parse_args().run:
        count, lost = lines(player(Path(run)))
        print(f"{run}: loses {lost} of {count} lines")


if __name__ == "__main__":
    main()
