"""Players of programs: what each sees in the picture, and what its hands do."""

import math
import random

from tools.person.limits import Finger, Hands, Past


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


class Keeper:
    """Plays xboing with the mouse: it brings the paddle to where the ball will come down, and presses now and then."""

    WIDTH = 565
    LEFT, RIGHT, PADDLE = 46, 520, 607  # pixels: where the ball turns, and where it meets the paddle
    BESIDE = 34  # pixels, by which the pointer is right of the middle of the paddle
    LAG, MISS = 0.08, 8  # as of `Puncher`
    SEEN = """
  let [x, y, blue] = [0, 0, 0]; // of the ball, below the blue blocks
  for (let row = Math.round(190 / scale); row < 635 / scale; row += 2) {
    for (let column = 0; column < width; column += 2) {
      const at = 4 * (row * width + column);
      if (data[at + 2] > 150 && data[at] < 90 && data[at + 1] < 60) { x += column; y += row; blue += 1; }
    }
  }
  return blue ? [scale * x / blue, scale * y / blue] : [];"""

    def __init__(self, seed: int) -> None:
        """Begin in the middle. seed: of misses and rests."""
        self._x, self._past, self._finger = self.WIDTH / 2, Past(), Finger(seed)
        self._rng, self._miss, self._fell = random.Random(seed), 0.0, False

    def see(self, now: float, seen: list[float]) -> None:
        """Take in where the ball is."""
        if seen:
            self._past.add(now, seen)

    def act(self, now: float, seconds: float) -> Hands:
        """Move the pointer towards where the ball should come down, and press from time to time."""
        if known := self._past.known(now):
            (x, y), (across, speed), age = known
            falls = speed > 0
            if falls and not self._fell:
                self._miss = self._rng.gauss(0, self.MISS)
            self._fell = falls
            ahead = min(max((self.PADDLE - y) / speed, age), 2.0) if falls else age
            place = _reflected(x + across * ahead, self.LEFT, self.RIGHT)
            aim = min(max(place + self._miss + self.BESIDE, 0.0), float(self.WIDTH))
            self._x += (aim - self._x) * (1 - math.exp(-seconds / self.LAG))
        return Hands(frozenset({"mouse"} if self._finger.tap(now) else ()), (self._x, self.PADDLE))


def _reflected(place: float, low: float, high: float) -> float:
    return 2 * low - place if place < low else 2 * high - place if place > high else place
