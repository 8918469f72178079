r"""Play pygame programs of other packages twice, and go on from snapshots: is every frame the same? A row for each.

    python -m tools.pygame_programs pygame.examples.chimp "xboing keys=LEFT,RIGHT,SPACE" --frames 10000
    python -m tools.pygame_programs "pygame.examples.aliens 'reward=Score: (\d+)'" --paid 10
    python -m tools.pygame_programs --names NAMES --seed 46 --count 20

The programs are installed by hand, beside this project. The second form shows what rewards pay in random play. The
third draws names from a file by a seed, so that nobody has chosen them. Exit status: 1 if a program was not the same
twice or did not go on from a snapshot as before.
"""

import argparse
import random
import sys
import time
from collections.abc import Iterator, Sequence
from hashlib import blake2b
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from joybridge.adapters.pygame_programs.first_play import branch_off, playing, random_acts
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.rerun import opened
from joybridge.contract.errors import JoybridgeError

FRAMES = 10_000
EPISODES = 1000  # at most: some programs end at once
AFTER_SNAPSHOTS = 2_000  # frames
BEFORE_SNAPSHOTS = 50  # frames, of each episode


class Row(NamedTuple):
    """What was seen of a program."""

    program: str
    result: str
    snapshots: str
    seconds: float
    same: bool

    def __str__(self) -> str:
        """Return the row of a Markdown table."""
        return f"| {self.program} | {self.result} | {self.snapshots} | {self.seconds:.1f} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Play pygame programs twice, and compare every frame.")
    parser.add_argument("programs", nargs="*", help="as after --pygame")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each program; default %(default)s")
    parser.add_argument(
        "--snapshots", type=int, default=AFTER_SNAPSHOTS, help="frames after snapshots, 0: none; default %(default)s"
    )
    parser.add_argument("--paid", type=int, metavar="EPISODES", help="say what rewards pay in so many episodes")
    parser.add_argument("--decisions", type=int, default=400, help="of such an episode; default %(default)s")
    parser.add_argument("--names", type=Path, help="draw names from the lines of this file, and print them")
    parser.add_argument("--count", type=int, default=20, help="how many are drawn; default %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="of the draw and of what is played; default %(default)s")
    options = parser.parse_args(arguments)
    if options.names:
        print("\n".join(draw(options.names.read_text(encoding="utf-8").split(), options.count, options.seed)))
        return 0
    if options.paid:
        print("| program | reward, and where it was paid |\n| --- | --- |")
        for program in options.programs:
            text = paid(program, options.paid, options.decisions, options.seed)
            print(f"| {program.partition(' ')[0]} | {text} |", flush=True)
        return 0
    print(f"| program | {options.frames:,} frames twice | after snapshots | seconds |\n| --- | --- | --- | --- |")
    rows = []
    for program in options.programs:
        rows.append(look_at(program, options.frames, options.snapshots, options.seed))
        print(rows[-1], flush=True)
    return 0 if all(row.same for row in rows) else 1


def draw(names: Sequence[str], count: int, seed: int) -> list[str]:
    """Return names that nobody has chosen."""
    return sorted(random.Random(seed).sample(sorted(names), count))


def look_at(program: str, frames: int, after_snapshots: int, seed: int) -> Row:
    """Play a program twice, and so many frames after snapshots."""
    begin = time.monotonic()
    try:
        with opened(program, {}) as (rerun, game):
            started = time.monotonic() - begin
            first, second = (_hash(rerun, frames, seed) for _ in range(2))
            compared, different = _continued(game, after_snapshots, seed)
    except JoybridgeError as error:
        text = str(error).replace("|", "/").replace("\n", " ")
        return Row(program, f"refused: {text}", "", time.monotonic() - begin, True)
    text = f"the same, {first}" if first == second else f"**not the same**: {first}, {second}"
    snapshots = f"**not the same** after {different:,} frames" if different else f"the same, {compared:,} frames"
    note = "" if game.exact else ", which are not served"
    same = first == second and (not different or not game.exact)
    return Row(program, f"{text}; served after {started:.1f} s", snapshots + note, time.monotonic() - begin, same)


def paid(program: str, episodes: int, decisions: int, seed: int) -> str:
    """Play a program at random and return in how many episodes each reward channel was paid, and how much in all."""
    with opened(program, {}) as (_, game), playing(game.processes, game.look, interval=4) as (players, form):
        table = []  # of episodes and channels
        for episode in range(seed, seed + episodes):
            players.begin([0], [episode])
            rewards = [one.rewards for one in players.play(0, random_acts(form, episode, decisions))]
            table.append([np.count_nonzero(rewards, axis=0), np.sum(rewards, axis=0)])
        often, sums = np.swapaxes(np.array(table), 0, 1)
    return "; ".join(
        f"`{source}`: {np.count_nonzero(often[:, at])} of {episodes} episodes, "
        f"{often[:, at].mean():.1f} times and {sums[:, at].mean():+.1f} in each"
        for at, source in enumerate(game.settings.rewards.values())
    )


def _continued(game: type[PygameGame], frames: int, seed: int) -> tuple[int, int]:
    """Return how many frames after snapshots were the same, and which was the first in an episode that was not."""
    compared = 0
    with playing(game.processes, game.look, hashes=True) as (players, form):
        for episode in range(seed, seed + EPISODES):
            if compared >= frames:
                break
            acts = list(random_acts(form, episode, BEFORE_SNAPSHOTS + frames - compared))
            trial = branch_off(players, episode, acts[:BEFORE_SNAPSHOTS], acts[BEFORE_SNAPSHOTS:])
            if trial.original != trial.copied:
                pairs = zip_longest(trial.original, trial.copied)
                return compared, 1 + next(at for at, (one, other) in enumerate(pairs) if one != other)
            compared += len(trial.original)
    return compared, 0


def _hash(rerun: Any, frames: int, seed: int) -> str:
    """Return a hash of all frames of some episodes."""
    digest, count = blake2b(digest_size=8), 0
    for episode in range(EPISODES):
        for hashes in _episode(rerun, seed + episode, frames - count):
            digest.update(hashes.tobytes())
            count += len(hashes)
        if count >= frames:
            break
    return f"`{digest.hexdigest()}` of {count:,} frames"


def _episode(rerun: Any, seed: int, frames: int) -> Iterator[Any]:
    for _, hashes in rerun.play(seed, random_acts(rerun.form, seed, frames)):
        yield hashes
        frames -= len(hashes)
        if frames <= 0:
            return


if __name__ == "__main__":
    sys.exit(main())
