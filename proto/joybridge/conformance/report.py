"""Results of checks as text, as JSON and as JUnit XML."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from joybridge.conformance.registry import Check
from joybridge.contract.text import printable

PASSED, FAILED, WARNING, NOT_APPLICABLE = "passed", "failed", "warning", "not applicable"
KEYS = {PASSED: "passed", FAILED: "failed", WARNING: "warnings", NOT_APPLICABLE: "not_applicable"}
MAX_CAUSES = 4  # named in the summary
# Characters that XML 1.0 cannot hold; the text of a server may contain any.
_NOT_IN_XML = dict.fromkeys((*range(9), 11, 12, *range(14, 32), *range(55296, 57344), 65534, 65535), "�")


@dataclass(frozen=True)
class Result:
    """The result of one check of one game."""

    game: str  # "server" for a check of the whole server
    check: Check
    outcome: str
    seconds: float
    got: str = ""  # of a failure or warning; the reason if the check is not applicable
    expected: str = ""
    follows: bool = False  # from another failure: the server is full or does not respond any more

    @property
    def lines(self) -> list[str]:
        """Return one line for the result and, for a failure or warning, lines that explain it."""
        line = f"{self.game}  {self.check.name}: {self.outcome}"
        if self.outcome == NOT_APPLICABLE:
            return [printable(f"{line} ({self.got})")]
        return [printable(text) for text in (line, *(f"    {part}" for part in self.explanation))]

    @property
    def explanation(self) -> list[str]:
        """Return the rule, what came, what was expected and the section of bridge.proto: of a failure or warning."""
        if self.outcome not in (FAILED, WARNING):
            return []
        came = [f"got: {self.got}", f"expected: {self.expected}"]
        return [f"rule: {self.check.rule}", *came, f"see: bridge.proto, {self.check.section}"]


def summary(results: Sequence[Result]) -> str:
    """Return the number of results of each outcome. Checks that are not applicable have not passed."""
    counts = Counter(result.outcome for result in results)
    return ", ".join(f"{counts[outcome]} {key.replace('_', ' ')}" for outcome, key in KEYS.items())


def repair_first(results: Sequence[Result], families: Sequence[str]) -> list[str]:
    """Return the names of the failed checks to repair first; other failures may follow from them.

    They are those of one family: the first in `families` with a failure that does not follow from another one.
    """
    failures = [result for result in results if result.outcome == FAILED]
    causes = [result for result in failures if not result.follows] or failures
    first = min((families.index(result.check.family) for result in causes), default=0)
    return list(dict.fromkeys(r.check.name for r in causes if r.check.family == families[first]))[:MAX_CAUSES]


def as_json(address: str, results: Sequence[Result], families: Sequence[str]) -> dict[str, Any]:
    """Return the results as an object for JSON."""
    counts = Counter(result.outcome for result in results)
    return {
        "address": address,
        **{key: counts[outcome] for outcome, key in KEYS.items()},
        "repair_first": repair_first(results, families),
        "results": [_entry(result) for result in results],
    }


def _entry(result: Result) -> dict[str, Any]:
    check = result.check
    about = {"game": result.game, "family": check.family, "check": check.name, "outcome": result.outcome}
    rule = {"seconds": round(result.seconds, 4), "rule": check.rule, "section": check.section}
    return {**about, **rule, "got": result.got, "expected": result.expected}


def listing(checks: Sequence[Check], families: dict[str, str]) -> Iterator[str]:
    """Yield lines that list the families with their checks and rules."""
    for family, description in families.items():
        own = [check for check in checks if check.family == family]
        if own:
            yield f"{family}: {description}"
            yield from (f"  {check.name}\n      {check.rule}" for check in own)


def write_junit(path: str, results: Sequence[Result]) -> None:
    """Write the results as JUnit XML, one suite per game. Raises OSError."""
    root = ElementTree.Element("testsuites", name="joybridge.v1")
    for game in dict.fromkeys(result.game for result in results):
        own = [result for result in results if result.game == game]
        counts = Counter(result.outcome for result in own)
        suite = ElementTree.SubElement(root, "testsuite", name=game.translate(_NOT_IN_XML), tests=str(len(own)))
        suite.set("failures", str(counts[FAILED]))
        suite.set("skipped", str(counts[NOT_APPLICABLE]))
        suite.set("time", f"{sum(result.seconds for result in own):.3f}")
        for result in own:
            name, place = result.check.name, f"{game}.{result.check.family}".translate(_NOT_IN_XML)
            case = ElementTree.SubElement(suite, "testcase", name=name, classname=place, time=f"{result.seconds:.3f}")
            got = result.got.translate(_NOT_IN_XML)
            text = "\n".join(result.explanation).translate(_NOT_IN_XML)
            if result.outcome == FAILED:
                ElementTree.SubElement(case, "failure", message=got).text = text
            elif result.outcome == WARNING:  # JUnit has none
                ElementTree.SubElement(case, "system-out").text = text
            elif result.outcome == NOT_APPLICABLE:
                ElementTree.SubElement(case, "skipped", message=got)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
