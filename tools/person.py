"""A script with the limits of a person plays chimp through the page of `joybridge play`, for demonstrations.

    python -m tools.person demos/chimp --minutes 10

It sees the picture in the page and nothing else, as it was 0.2 s before, and expects the chimp to go on as it did. Its
pointer approaches what it aims at with a time constant of 0.08 s, and misses it by some 18 pixels; it presses for
0.09 s and rests for about 0.12. Needs Chromium.
"""

import argparse
import math
import random
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from tests.support.chromium import Tab, chromium

DELAY, LAG, PRESS, REST = 0.2, 0.08, 0.09, 0.12  # s
MISS = 18  # pixels of the program, the deviation of where it aims from what it aims at
WIDTH, HEIGHT, GROUND = 1280, 480, (170, 238, 187)  # of the program
ROW = 200  # of the picture: the chimp is there, also while it spins
POINTER_ROW = 300  # where the pointer stays: the fist is drawn there and below, so it never covers ROW
SHOWN = "document.querySelector('#curtain').classList.contains('shown')"
READY = "document.querySelector('#curtain-title').textContent.startsWith('Click or press Enter')"
BOX = "(({ x, y, width, height }) => [x, y, width, height])(document.querySelector('#picture').getBoundingClientRect())"
SEEN = f"""(() => {{
  const picture = document.querySelector("#picture"), columns = [];
  const row = Math.round(picture.height * {ROW / HEIGHT});
  const data = picture.getContext("2d").getImageData(0, row, picture.width, 1).data;
  for (let x = 0; x < picture.width; x += 4) {{
    const apart = {list(GROUND)}.reduce((sum, value, part) => sum + Math.abs(value - data[4 * x + part]), 0);
    if (apart > 60) columns.push(x * {WIDTH} / picture.width);
  }}
  return columns;
}})()"""


class Person:
    """Where the pointer is, and what was seen."""

    def __init__(self, seed: int) -> None:
        """Begin in the middle. seed: of misses and rests."""
        self.rng, self.x = random.Random(seed), WIDTH / 2
        self.seen: deque[tuple[float, float]] = deque(maxlen=60)  # when, and the middle of the chimp
        self.miss = 0.0

    def see(self, now: float, columns: Sequence[float]) -> None:
        """Take in which columns are not the ground."""
        if columns:
            self.seen.append((now, sum(columns) / len(columns)))

    def move(self, now: float, seconds: float) -> None:
        """Move the pointer towards where the chimp should be by now."""
        past = [(when, x) for when, x in self.seen if DELAY <= now - when < DELAY + 0.25]
        if not past:
            return
        (first, begin), (last, end) = past[0], past[-1]
        speed = (end - begin) / max(last - first, 0.02) if len(past) > 1 else 0.0
        chimp = end + speed * (now - last)
        chimp = 128 - chimp if chimp < 64 else 2 * (WIDTH - 64) - chimp if chimp > WIDTH - 64 else chimp  # it turns
        aim = min(max(chimp + self.miss, 0.0), float(WIDTH))
        self.x += (aim - self.x) * (1 - math.exp(-seconds / LAG))

    def rest(self) -> float:
        """Return for how long nothing is pressed, and aim anew."""
        self.miss = self.rng.gauss(0, MISS)
        return abs(self.rng.gauss(REST, 0.05))


def play(tab: Tab, url: str, seconds: float, person: Person) -> None:
    """Play for some time through the page."""
    tab.size(1280, 900)
    tab.go(url)
    tab.wait(READY)
    begin = last = time.monotonic()
    pressed, change = False, begin  # and when this changes
    for number in count():
        if number % 10 == 0 and tab.value(SHOWN):
            tab.key("Enter", "Enter")
            tab.wait(f"!({SHOWN})")
        now = time.monotonic()
        if now - begin > seconds:
            return
        person.see(now, tab.value(SEEN))
        person.move(now, now - last)
        last = now
        left, top, width, height = tab.value(BOX)
        x, y = left + person.x / WIDTH * width, top + POINTER_ROW / HEIGHT * height
        tab.mouse("mouseMoved", x, y, "left" if pressed else "none", int(pressed))
        if now >= change:
            pressed = not pressed
            tab.mouse("mousePressed" if pressed else "mouseReleased", x, y, "left", int(pressed))
            change = now + (PRESS if pressed else person.rest())


@contextmanager
def page(folder: Path) -> Iterator[str]:
    """Start the page that records in a folder; yield its URL."""
    command = [sys.executable, "-m", "joybridge", "play", "pygame/chimp", "--demos", str(folder)]
    with subprocess.Popen([*command, "--no-browser", "--port", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield next(line.split()[-1] for line in process.stdout if "http://" in line)
        finally:
            process.terminate()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="A script with the limits of a person plays chimp in a page.")
    parser.add_argument("demos", type=Path, help="the folder in which its play is recorded")
    parser.add_argument("--minutes", type=float, default=10.0, help="of play; default %(default)g")
    parser.add_argument("--seed", type=int, default=0, help="of its misses and rests; default %(default)s")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, chromium(folder) as browser, page(options.demos) as url:
        play(browser.tab(), url, 60 * options.minutes, Person(options.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
