"""The limits of a person: what is seen late, and fingers that need a moment."""

import random
from collections import deque
from typing import NamedTuple

DELAY, SPAN = 0.2, 0.25  # s: of what is seen, and for how long a speed is watched

JUMP = 100  # pixels, between two pictures: nothing moves so fast


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
                break  # it turned here, or started over
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
