"""Scripts with the limits of a person play programs through the page of `joybridge play`, for demonstrations.

    python -m tools.person chimp demos/chimp --minutes 10

A script sees the picture in the page and nothing else, as it was 0.2 s before, and expects things to go on as they did.
It misses what it aims at, and needs a moment to get there. Needs Chromium.
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
from typing import NamedTuple

from tests.support.chromium import Tab, chromium

DELAY, SPAN = 0.2, 0.25  # s: of what is seen, and for how long a speed is watched
JUMP = 100  # pixels, between two pictures: nothing moves so fast
SHOWN = "document.querySelector('#curtain').classList.contains('shown')"
READY = "document.querySelector('#curtain-title').textContent.startsWith('Click or press Enter')"
BOX = "(({ x, y, width, height }) => [x, y, width, height])(document.querySelector('#picture').getBoundingClientRect())"
SEEN = """(() => {
  const { width, height } = document.querySelector("#picture");
  const { data } = document.querySelector("#picture").getContext("2d").getImageData(0, 0, width, height);
  const scale = %s / width;
  %s
})()"""


class Hands(NamedTuple):
    """Where the hands are."""

    pressed: frozenset[str]  # "mouse", or codes of keys
    pointer: tuple[float, float] | None = None  # in pixels of the program


class Past:
    """What was seen, of which only what is older than DELAY is known."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._seen: deque[tuple[float, list[float]]] = deque(maxlen=60)

    def add(self, now: float, values: list[float]) -> None:
        """See something."""
        self._seen.append((now, values))

    def known(self, now: float) -> tuple[list[float], list[float], float] | None:
        """Return the newest known values, their speeds and how old they are, if there are any."""
        past = [(when, values) for when, values in self._seen if DELAY <= now - when < DELAY + SPAN]
        if not past:
            return None
        last, end = first, begin = past[-1]
        for when, values in reversed(past[:-1]):
            if any(abs(b - a) > JUMP or (b - a) * (c - b) < 0 for a, b, c in zip(values, begin, end, strict=True)):
                break  # it turned here, or began anew
            first, begin = when, values
        return end, [(b - a) / max(last - first, 0.02) for a, b in zip(begin, end, strict=True)], now - last


class Finger:
    """Presses for PRESS seconds again and again, with rests of about REST between."""

    PRESS, REST = 0.09, 0.12  # s

    def __init__(self, seed: int) -> None:
        """Begin with a press. seed: of rests."""
        self._rng, self._change, self.down = random.Random(seed), 0.0, False

    def tap(self, now: float) -> bool:
        """Return whether it is down."""
        if now >= self._change:
            self.down = not self.down
            self._change = now + (self.PRESS if self.down else abs(self._rng.gauss(self.REST, 0.05)))
        return self.down


class Puncher:
    """Plays chimp with the mouse."""

    WIDTH = 1280
    POINTER_ROW = 300  # where the pointer stays: the fist is drawn there and below, and never covers the chimp
    LAG = 0.08  # s: the time constant of the pointer
    MISS = 18  # pixels, the deviation of where it aims from what it aims at
    SEEN = """
  const row = Math.round(200 / scale) * width, columns = []; // the chimp is there, also while it spins
  for (let x = 0; x < width; x += 4) {
    const ground = [170, 238, 187];
    const apart = ground.reduce((sum, value, part) => sum + Math.abs(value - data[4 * (row + x) + part]), 0);
    if (apart > 60) columns.push(x * scale);
  }
  return columns;"""

    def __init__(self, seed: int) -> None:
        """Begin in the middle. seed: of misses and rests."""
        self._x, self._past, self._finger = self.WIDTH / 2, Past(), Finger(seed)
        self._rng, self._miss = random.Random(seed), 0.0

    def see(self, now: float, seen: list[float]) -> None:
        """Take in the columns that are not the ground."""
        if seen:
            self._past.add(now, [sum(seen) / len(seen)])

    def act(self, now: float, seconds: float) -> Hands:
        """Move the pointer towards where the chimp should be by now, and press from time to time."""
        if known := self._past.known(now):
            (x,), (speed,), age = known
            aim = min(max(_reflected(x + speed * age, 64, self.WIDTH - 64) + self._miss, 0.0), float(self.WIDTH))
            self._x += (aim - self._x) * (1 - math.exp(-seconds / self.LAG))
        before, pressed = self._finger.down, self._finger.tap(now)
        if before and not pressed:
            self._miss = self._rng.gauss(0, self.MISS)
        return Hands(frozenset({"mouse"} if pressed else ()), (self._x, self.POINTER_ROW))


class Returner:
    """Plays pong-arcade in its dark mode with two keys."""

    WIDTH, HEIGHT, FRONT, SPEED = 800, 600, 35, 600  # the last: where its paddle ends, and its pixels per second
    NEAR, MISS = 12, 6  # pixels: it moves if it is farther than this; the deviation of where it aims
    WAIT = 0.27  # s, until it sees what a key has done
    SEEN = """
  let [x, y, bright, paddle, blue] = [0, 0, 0, 0, 0];
  for (let row = 0; row < height; row += 2) for (let column = 0; column < width; column += 2) {
    const at = 4 * (row * width + column);
    if (data[at] > 200 && data[at + 1] > 200 && Math.abs(column * scale - 400) > 10) {
      x += column; y += row; bright += 1;
    }
    if (data[at + 2] - data[at] > 120 && column * scale < 60) { paddle += row; blue += 1; }
  }
  return bright && blue ? [scale * x / bright, scale * y / bright, scale * paddle / blue] : [];"""

    def __init__(self, seed: int) -> None:
        """Begin with no key pressed. seed: of misses."""
        self._rng, self._ball, self._paddle = random.Random(seed), Past(), Past()
        self._key, self._release, self._next = "", 0.0, 0.0  # the last two: when it releases, and presses again

    def see(self, now: float, seen: list[float]) -> None:
        """Take in where the ball and the paddle are."""
        if seen:
            self._ball.add(now, seen[:2])
            self._paddle.add(now, seen[2:])

    def act(self, now: float, _: float) -> Hands:
        """Press a key for as long as the way to where the ball will come takes, and wait for what it does."""
        if now >= self._release:
            self._key = ""
        ball, paddle = self._ball.known(now), self._paddle.known(now)
        if now >= self._next and ball and paddle:
            (x, y), (across, speed), age = ball
            seconds = (x - self.FRONT) / -across if across < 0 else age  # from when it was seen until it comes
            place = _reflected(y + speed * min(max(seconds, age), 2.0), 0, self.HEIGHT)
            apart = place + self._rng.gauss(0, self.MISS) - paddle[0][0]
            if abs(apart) > self.NEAR:
                self._key = "KeyS" if apart > 0 else "KeyW"
                self._release = now + min(abs(apart) / self.SPEED, 0.5)
                self._next = self._release + self.WAIT
        return Hands(frozenset({self._key} if self._key else ()))


class Shooter:
    """Plays aliens with three keys: it waits at the right edge, shoots, and goes out of the way of what falls there."""

    WIDTH = 640
    HIGH = 200  # pixels from above: what has not fallen so far is waited for
    AWAY, BACK = 0.35, 0.7  # s: for how long it goes away, and after what time it comes back
    SEEN = """
  let lowest = 0; // of what is as yellow as a bomb, above the ground, near the right edge
  for (let row = Math.round(100 / scale); row < 415 / scale; row += 2) {
    for (let column = Math.round(530 / scale); column < width; column += 2) {
      const at = 4 * (row * width + column);
      if (data[at] > 180 && data[at + 1] > 170 && data[at + 2] < 110) lowest = row * scale;
    }
  }
  return lowest ? [lowest] : [];"""

    def __init__(self, seed: int) -> None:
        """Begin with no key pressed. seed: of rests."""
        self._past, self._finger = Past(), Finger(seed)
        self._dodged = -10.0  # when it began to go away

    def see(self, now: float, seen: list[float]) -> None:
        """Take in how far a bomb has fallen."""
        if seen:
            self._past.add(now, seen)

    def act(self, now: float, _: float) -> Hands:
        """Go away from a bomb, or back, and shoot from time to time."""
        if now - self._dodged > self.BACK and (known := self._past.known(now)):
            (low,), (speed,), age = known
            if low + max(speed, 0.0) * age > self.HIGH:
                self._dodged = now
        since = now - self._dodged
        way = "ArrowLeft" if since < self.AWAY else "ArrowRight" if since > self.BACK else ""
        return Hands(frozenset(key for key in (way, "Space" if self._finger.tap(now) else "") if key))


def _reflected(place: float, low: float, high: float) -> float:
    return 2 * low - place if place < low else 2 * high - place if place > high else place


Person = Puncher | Returner | Shooter
PERSONS: dict[str, type[Person]] = {"chimp": Puncher, "pong-arcade": Returner, "aliens": Shooter}


def play(tab: Tab, url: str, seconds: float, person: Person) -> None:
    """Play for some time through the page."""
    tab.size(1280, 900)
    tab.go(url)
    tab.wait(READY)
    begin = last = time.monotonic()
    held: frozenset[str] = frozenset()
    for number in count():
        if number % 10 == 0 and tab.value(SHOWN):
            tab.key("Enter", "Enter")
            tab.wait(f"!({SHOWN})")
        now = time.monotonic()
        if now - begin > seconds:
            return
        person.see(now, tab.value(SEEN % (person.WIDTH, person.SEEN)) or [])
        hands = person.act(now, now - last)
        press(tab, person, held, hands)
        held, last = hands.pressed, now


def press(tab: Tab, person: Person, held: frozenset[str], hands: Hands) -> None:
    """Move the mouse and press what is not yet held, and release what no longer is."""
    if hands.pointer:
        left, top, width, _ = tab.value(BOX)
        x, y = (offset + part * width / person.WIDTH for offset, part in zip((left, top), hands.pointer, strict=True))
        tab.mouse("mouseMoved", x, y, "left" if "mouse" in held else "none", int("mouse" in held))
    for key in held ^ hands.pressed:
        down = key in hands.pressed
        if key == "mouse":
            tab.mouse("mousePressed" if down else "mouseReleased", x, y, "left", int(down))
        else:
            tab.key(key, " " if key == "Space" else key.removeprefix("Key").lower(), down=down, up=not down)


@contextmanager
def page(program: str, folder: Path) -> Iterator[str]:
    """Start the page that records a program of configs/pygame in a folder; yield its URL."""
    command = [sys.executable, "-m", "joybridge", "play", f"pygame/{program}", "--demos", str(folder)]
    with subprocess.Popen([*command, "--no-browser", "--port", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            url = next((line.split()[-1] for line in process.stdout if "http://" in line), "")
            if not url:
                sys.exit("error: joybridge play ended before its page was up: its error is above")
            yield url
        finally:
            process.terminate()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="A script with the limits of a person plays a program in a page.")
    parser.add_argument("program", choices=PERSONS, help="of configs/pygame: %(choices)s")
    parser.add_argument("demos", type=Path, help="the folder in which its play is recorded")
    parser.add_argument("--minutes", type=float, default=10.0, help="of play; default %(default)g")
    parser.add_argument("--seed", type=int, default=0, help="of its misses and rests; default %(default)s")
    options = parser.parse_args(arguments)
    with (
        tempfile.TemporaryDirectory() as folder,
        page(options.program, options.demos) as url,
        chromium(folder) as browser,
    ):
        play(browser.tab(), url, 60 * options.minutes, PERSONS[options.program](options.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
