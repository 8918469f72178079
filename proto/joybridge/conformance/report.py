"""What came of the checks: as lines, as JSON and as JUnit XML."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from joybridge.conformance.registry import Check

PASSED, FAILED, NO_MATTER = "passed", "failed", "does not apply"
# What XML 1.0 cannot hold; what a server says may be anything.
_UNSPEAKABLE = dict.fromkeys((*range(9), 11, 12, *range(14, 32), *range(55296, 57344), 65534, 65535), "�")


@dataclass(frozen=True)
class Result:
    """What came of one check of one game."""

    game: str
    check: Check
    outcome: str
    seconds: float
    came: str = ""  # where it failed; where it does not apply, why
    expected: str = ""

    @property
    def lines(self) -> list[str]:
        """Return the result in words: one line, and what went wrong below it."""
        line = f"{self.game}  {self.check.name.replace('_', ' ')}: {self.outcome}"
        if self.outcome == NO_MATTER:
            return [f"{line} ({self.came})"]
        return [line, *(f"    {part}" for part in self.explanation)]

    @property
    def explanation(self) -> list[str]:
        """Return what went wrong: the rule, what came, what was expected and where the manual says so."""
        if self.outcome != FAILED:
            return []
        return [
            f"rule: {self.check.rule}", f"got: {self.came}", f"expected: {self.expected}",
            f"manual: bridge.proto, {self.check.manual}",
        ]  # fmt: skip


def summary(results: Sequence[Result]) -> str:
    """Return the counts in one line. What does not apply has not been passed."""
    counts = Counter(result.outcome for result in results)
    return ", ".join(f"{counts[outcome]} {outcome}" for outcome in (PASSED, FAILED, NO_MATTER))


def as_json(address: str, results: Sequence[Result]) -> dict[str, Any]:
    """Return the results as an object for JSON."""
    counts = Counter(result.outcome for result in results)
    return {
        "address": address,
        "passed": counts[PASSED],
        "failed": counts[FAILED],
        "does_not_apply": counts[NO_MATTER],
        "results": [
            {
                "game": r.game, "family": r.check.family, "check": r.check.name, "outcome": r.outcome,
                "seconds": round(r.seconds, 4), "rule": r.check.rule, "manual": r.check.manual, "got": r.came,
                "expected": r.expected,
            }
            for r in results
        ],
    }  # fmt: skip


def write_junit(path: str, results: Sequence[Result]) -> None:
    """Write the results as JUnit XML, a suite per game. Raises OSError."""
    root = ElementTree.Element("testsuites", name="joybridge.v1")
    for game in dict.fromkeys(result.game for result in results):
        own = [result for result in results if result.game == game]
        counts = Counter(result.outcome for result in own)
        suite = ElementTree.SubElement(
            root, "testsuite", name=game.translate(_UNSPEAKABLE), tests=str(len(own)), failures=str(counts[FAILED]),
            skipped=str(counts[NO_MATTER]), time=f"{sum(result.seconds for result in own):.3f}",
        )  # fmt: skip
        for result in own:
            name, place = result.check.name, f"{game}.{result.check.family}".translate(_UNSPEAKABLE)
            case = ElementTree.SubElement(suite, "testcase", name=name, classname=place, time=f"{result.seconds:.3f}")
            if result.outcome == FAILED:
                text = "\n".join(result.explanation).translate(_UNSPEAKABLE)
                came = result.came.translate(_UNSPEAKABLE)
                ElementTree.SubElement(case, "failure", message=came).text = text
            elif result.outcome == NO_MATTER:
                ElementTree.SubElement(case, "skipped", message=result.came.translate(_UNSPEAKABLE))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
