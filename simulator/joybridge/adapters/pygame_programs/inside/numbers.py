"""Notes the numbers in the texts that a program renders while it is watched: each of them may be a reward."""

import re
from collections import Counter

NUMBER = re.compile(r"(?:(?<!\S)-)?\d+(?:[,'_]\d{3})*(?:\.\d+)?")
MAX_NUMBERS = 4  # in a text; one with more is a table
MAX_TEXTS = 500  # that are kept apart
MAX_FOUND = 8  # proposals
MAX_SEEN = 8  # texts that are kept to be shown, each with other words
MAX_CHARS = 24  # of a text whose numbers do not change: a longer one tells something else


class Numbers:
    """Reads rendered texts. Those with the same words are one text, whose numbers change."""

    def __init__(self) -> None:
        self._texts: dict[tuple[int, tuple[str, ...]], _Text] = {}  # by which of its words in a frame it is
        self._counts: Counter[tuple[str, ...]] = Counter()  # in this frame
        self._seen: dict[tuple[str, ...], str] = {}  # the first texts, whatever is in them, by their words

    def read(self, text: str) -> None:
        """Note a text."""
        numbers, words = NUMBER.findall(text), NUMBER.split(text)
        if len(self._seen) < MAX_SEEN:
            self._seen.setdefault(tuple(words), text)
        if not 0 < len(numbers) <= MAX_NUMBERS:
            return
        plain = tuple(word.strip() for word in words)
        self._counts[plain] += 1
        key = (self._counts[plain], plain)
        if key not in self._texts and len(self._texts) < MAX_TEXTS:
            self._texts[key] = _Text(words, numbers)
        if key in self._texts:
            self._texts[key].see(words, numbers)

    def end_frame(self) -> None:
        """Begin the next frame."""
        self._counts.clear()

    def seen(self) -> list[str]:
        """Return some of the texts, each with other words."""
        return list(self._seen.values())

    def found(self) -> list[tuple[str, float, float]]:
        """Return rewards that would be possible, and the lowest and the highest number.

        Numbers that have changed come first, and among them what was shown most often.
        """
        shown = [(key, text) for key, text in self._texts.items() if text.changed or len(text) <= MAX_CHARS]
        best = sorted(shown, key=lambda item: (not item[1].changed, -item[1].shown))
        rewards = [(nth, text, at, text.pattern(at)) for (nth, _), text in best for at in text.places()]
        often = Counter(pattern for *_, pattern in rewards)
        return [
            (f"text{nth}:{pattern}" if often[pattern] > 1 else pattern, min(text.values[at]), max(text.values[at]))
            for nth, text, at, pattern in rewards[:MAX_FOUND]
        ]


class _Text:
    """A text with numbers in it."""

    def __init__(self, words: list[str], numbers: list[str]) -> None:
        self._words, self._numbers = words, numbers  # as they were first
        self._signs = [set[str]() for _ in numbers]  # that stand in each number beside digits
        self._padded = False  # with changing space
        self.values = [set[float]() for _ in numbers]
        self.shown = 0

    def __len__(self) -> int:
        return len("".join([*self._words, *self._numbers]))

    @property
    def changed(self) -> bool:
        return any(len(values) > 1 for values in self.values)

    def see(self, words: list[str], numbers: list[str]) -> None:
        self.shown += 1
        self._padded = self._padded or words != self._words
        for number, signs, values in zip(numbers, self._signs, self.values, strict=True):
            signs.update(re.sub(r"\d", "", number))
            values.add(float(re.sub(r"[,'_]", "", number)))

    def places(self) -> list[int]:
        """Return which of its numbers have changed or may change, the first if none may."""
        return [at for at in range(len(self.values)) if self._may_change(at)] or [0]

    def _may_change(self, place: int) -> bool:
        """Whether a number has changed, or a word of its own, as in "Popped 0  Lost 3", tells that it counts something.

        The 1 of "P1: 5" and of "Player 1: 5" is a name, and the 20 of "3/20" a limit.
        """
        named = re.search(r"[A-Za-z]\W*[\s(\[=:]$", self._words[place]) and not self._words[place + 1].startswith(":")
        return len(self.values[place]) > 1 or bool(named)

    def pattern(self, place: int) -> str:
        """Return a pattern with a group for one of the numbers, as short as words before it allow."""
        parts = ["^"]
        for at, word in enumerate(self._words):
            parts.append(self._literal(word))
            if at == place:
                parts.append(f"({self._sign(at)}{self._digits(at)})")
                if re.search("[A-Za-z]", "".join(self._words[: at + 1])):
                    return "".join(parts)
            elif at < len(self._numbers):
                changing = self._sign(at) + self._digits(at)
                parts.append(changing if self._may_change(at) else re.escape(self._numbers[at]))
        return "".join([*parts, "$"])

    def _literal(self, word: str) -> str:
        word = re.sub(r"([\\.^$*+?{}\[\]|()])", r"\\\1", word)
        word = re.sub(r"\s*[^\S ]\s*", r"\\s+", word)  # tabs and new lines, which a command line has no place for
        return re.sub(r"\s+" if self._padded else r"\s{2,}", " *", word)

    def _sign(self, place: int) -> str:
        """Return the pattern of a sign before a number that was negative, or that may become it, as after "Score: "."""
        counts = re.search(r"[A-Za-z].*\s$", "".join(self._words[: place + 1]))
        return "-?" if "-" in self._signs[place] or counts else ""

    def _digits(self, place: int) -> str:
        inner = "".join(sorted(self._signs[place] - {"-"}))
        return rf"[\d{inner}]+" if inner else r"\d+"
