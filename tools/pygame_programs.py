"""Play pygame programs of other packages twice, and say whether every frame is the same: one row of a table for each.

    python -m tools.pygame_programs pygame.examples.chimp "xboing keys=LEFT,RIGHT,SPACE" --frames 10000
    python -m tools.pygame_programs --names NAMES --seed 46 --count 20

The programs are installed by hand, beside this project. The second form draws names from a file by a seed, so that
nobody has chosen them. Exit status: 1 if a program was not the same twice.
"""

import argparse
import random
import sys
import time
from collections.abc import Iterator, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

from joybridge.adapters.pygame_programs.rerun import opened, random_acts
from joybridge.contract.errors import JoybridgeError

FRAMES = 10_000
EPISODES = 1000  # at most: some programs end at once


class Row(NamedTuple):
    """What was seen of a program."""

    program: str
    result: str
    seconds: float
    same: bool

    def __str__(self) -> str:
        """Return the row of a Markdown table."""
        return f"| {self.program} | {self.result} | {self.seconds:.1f} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Play pygame programs twice, and compare every frame.")
    parser.add_argument("programs", nargs="*", help="as after --pygame")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each program; default %(default)s")
    parser.add_argument("--names", type=Path, help="draw names from the lines of this file, and print them")
    parser.add_argument("--count", type=int, default=20, help="how many are drawn; default %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="of the draw and of what is played; default %(default)s")
    options = parser.parse_args(arguments)
    if options.names:
        print("\n".join(draw(options.names.read_text(encoding="utf-8").split(), options.count, options.seed)))
        return 0
    print(f"| program | {options.frames:,} frames twice | seconds |\n| --- | --- | --- |", flush=True)
    rows = []
    for program in options.programs:
        rows.append(look_at(program, options.frames, options.seed))
        print(rows[-1], flush=True)
    return 0 if all(row.same for row in rows) else 1


def draw(names: Sequence[str], count: int, seed: int) -> list[str]:
    """Return names that nobody has chosen."""
    return sorted(random.Random(seed).sample(sorted(names), count))


def look_at(program: str, frames: int, seed: int) -> Row:
    """Play a program twice."""
    begin = time.monotonic()
    try:
        with opened(program, {}) as (rerun, game):
            started = time.monotonic() - begin
            first, second = (_hash(rerun, frames, seed) for _ in range(2))
    except JoybridgeError as error:
        text = str(error).replace("|", "/").replace("\n", " ")
        return Row(program, f"refused: {text}", time.monotonic() - begin, True)
    same = first == second
    exact = "" if game.exact else ", without snapshots"
    text = f"the same, {first}" if same else f"**not the same**: {first}, {second}"
    return Row(program, f"{text}; served after {started:.1f} s{exact}", time.monotonic() - begin, same)


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
    for _, hashes in rerun.play(seed, random_acts(rerun, seed, frames)):
        yield hashes
        frames -= len(hashes)
        if frames <= 0:
            return


if __name__ == "__main__":
    sys.exit(main())
