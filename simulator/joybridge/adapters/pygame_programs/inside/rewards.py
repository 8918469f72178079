r"""Rewards and ends of episodes without code: from the text that the program renders, its sounds, and its variables.

Score: (\d+)         the difference of a number in rendered text
text2:^(\d+)$        the same, of the second text of each frame that matches
sound:punch.wav      1 for each time that this sound begins
attr:main.score      the difference of a variable of a module, an object in it, or of a function that runs
"""

import io
import math
import re
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pygame
import pygame.freetype
import pygame.ftfont

from joybridge.adapters.pygame_programs.inside.variables import number_at
from joybridge.adapters.pygame_programs.wire import nth_text

DEFAULT_SIZE = 20  # of pygame's fonts
DEFAULT_SCALE = 0.6875  # by which pygame makes its own font smaller
MAX_CHARS = 1000  # of a rendered text that is searched


class Reader(Protocol):
    """Is shown all text that the program renders."""

    def read(self, text: str) -> None:
        """Look at a text."""

    def end_frame(self) -> None:
        """Note that a frame ends."""


class Texts:
    """Searches all text that the program renders."""

    def __init__(self) -> None:
        """Take the place of the classes that render text."""
        self.readers: list[Reader] = []
        texts = self

        class Font(pygame.font.Font):
            def __init__(self, name: Any = None, size: int = DEFAULT_SIZE) -> None:
                if name is None:
                    size = max(1, int(size * DEFAULT_SCALE))
                super().__init__(_in_memory(name, pygame.font), size)

            def render(self, text: Any, *arguments: Any, **options: Any) -> Any:
                texts._read(text)
                return super().render(text, *arguments, **options)

        class FreetypeFont(pygame.freetype.Font):
            def __init__(self, file: Any = None, *arguments: Any, **options: Any) -> None:
                super().__init__(_in_memory(file, pygame.freetype), *arguments, **options)

            def render(self, text: Any, *arguments: Any, **options: Any) -> Any:
                texts._read(text)
                return super().render(text, *arguments, **options)

            def render_to(self, surf: Any, dest: Any, text: Any, *arguments: Any, **options: Any) -> Any:
                texts._read(text)
                return super().render_to(surf, dest, text, *arguments, **options)

        pygame.font.Font = pygame.font.FontType = pygame.sysfont.Font = Font
        pygame.freetype.Font = FreetypeFont

    def search(self, pattern: str, found: Callable[["re.Match[str]"], None], nth: int = 0) -> None:
        """Call `found` for every rendered text with a match, or for the nth of each frame. Raises ValueError."""
        self.readers.append(_Search(pattern, found, nth))

    def end_frame(self) -> None:
        """Note that a frame ends."""
        for reader in self.readers:
            reader.end_frame()

    def _read(self, text: Any) -> None:
        if self.readers and text:
            text = text.decode(errors="replace") if isinstance(text, bytes) else str(text)
            for reader in self.readers:
                reader.read(text[:MAX_CHARS])


class _Search:
    """Finds a pattern in all texts, or in the nth of a frame that has it."""

    def __init__(self, pattern: str, found: Callable[["re.Match[str]"], None], nth: int) -> None:
        self._search = lru_cache(maxsize=1024)(_compiled(pattern).search)
        self._found, self._nth, self._count = found, nth, 0

    def read(self, text: str) -> None:
        if (match := self._search(text)) is not None:
            self._count += 1
            if self._nth in (0, self._count):
                self._found(match)

    def end_frame(self) -> None:
        self._count = 0


def _in_memory(font: Any, module: Any) -> Any:
    """Return a font's file in memory: forks that read an open file would move each other's place in it."""
    if font is None or font == module.get_default_font():
        font = Path(pygame.__file__).parent / module.get_default_font()
    return io.BytesIO(Path(font).read_bytes()) if isinstance(font, str | Path) else font


class Difference:
    """How much a number has grown since it was last asked for; one that is not seen, or infinite, has not changed."""

    def __init__(self) -> None:
        self.value: float | None = None
        self._growth = 0.0

    def see(self, value: float | None) -> None:
        """Note the present value, if there is one."""
        if value is None or not math.isfinite(value):
            return
        if self.value is not None:
            self._growth += value - self.value
        self.value = value

    def take(self) -> float:
        """Return the growth, and start over."""
        growth, self._growth = self._growth, 0.0
        return growth


class Source(NamedTuple):
    """What pays in one channel."""

    look: Callable[[], None]  # after each frame: a variable may be gone with its function when the program ends
    take: Callable[[], float]  # returns the reward since its last call
    found: Callable[[], bool]  # whether there has been a number, or the sound


def reward_of(source: str, texts: Texts, played: Counter[str]) -> Source:
    """Return what pays. Raises ValueError for a wrong pattern."""
    kind, _, name = source.partition(":")
    difference = Difference()
    if kind == "sound" and name:

        def heard() -> float:
            return float(sum(n for file, n in played.items() if _is_sound(file, name)))

        return Source(_nothing, lambda: _take(difference, heard()), lambda: heard() > 0)
    if kind == "attr" and name:
        return Source(
            lambda: difference.see(number_at(name)),
            lambda: _take(difference, number_at(name)),
            lambda: difference.value is not None,
        )
    nth, text = nth_text(source)
    pattern = _compiled(text)
    if pattern.groups != 1:
        raise ValueError(f"reward {source!r} has {pattern.groups} groups, expected one for the number: Score: (\\d+)")
    texts.search(text, lambda match: _see(difference, match[1]), nth)
    return Source(_nothing, difference.take, lambda: difference.value is not None)


def _nothing() -> None:
    """Look at nothing: texts and sounds are noted when they come."""


def _take(difference: Difference, value: float | None) -> float:
    difference.see(value)
    return difference.take()


def _see(difference: Difference, text: str) -> None:
    number = re.sub(r"[\s,'_]", "", text)
    try:
        difference.see(float(number))
    except ValueError:  # what the pattern has found is no number
        return


def _is_sound(file: str, name: str) -> bool:
    return name in (file, file.rpartition(".")[0])


def _compiled(pattern: str) -> "re.Pattern[str]":
    try:
        return re.compile(pattern)
    except re.error as error:
        raise ValueError(f"{pattern!r} is no regular expression: {error}") from error
