"""The conformance kit: good servers keep every rule, and each broken one is found out by the right checks."""

import json
import logging
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

from joybridge.conformance.registry import Broken as BrokenRule
from joybridge.conformance.registry import Check
from joybridge.conformance.report import FAILED, NO_MATTER, PASSED, Result, write_junit
from joybridge.conformance.rules import CHECKS, FAMILIES
from joybridge.conformance.runner import PATIENCE, main, run_checks
from joybridge.conformance.wire import Server
from joybridge.games import BUILT_IN
from tests.support.broken_servers import BROKEN, Broken, Gauntlet, Honest, serving

ROOT = Path(__file__).parents[1]
GAMES = [*BUILT_IN, "hybrid", "duel", "ends"]
SECONDS = 10.0


@pytest.fixture(autouse=True)
def _quiet():
    """Keep the servers of this process from logging what they refuse."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def failed(results):
    return {result.check.name for result in results if result.outcome == FAILED}


def test_there_are_many_checks_each_with_a_rule_and_its_place_in_the_manual():
    manual = (ROOT / "proto/joybridge/v1/bridge.proto").read_text()
    assert len(CHECKS) >= 100
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert {check.family for check in CHECKS} == set(FAMILIES)
    for check in CHECKS:
        assert check.rule.endswith(".") and check.manual in manual, check.name


def test_the_server_keeps_every_rule_with_every_well_behaved_game(simulator, tmp_path):
    junit = tmp_path / "junit.xml"
    arguments = [part for game in GAMES for part in ("--game", game)]
    command = [
        sys.executable,
        "-m",
        "joybridge.simulator",
        "check",
        simulator,
        *arguments,
        "--json",
        "--junit",
        str(junit),
    ]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    lines = process.stdout.splitlines()
    assert (process.returncode, process.stderr) == (0, ""), "\n".join(line for line in lines if "failed" in line)
    came = json.loads(lines[-1])
    assert came["failed"] == 0 and came["passed"] + came["does_not_apply"] == len(came["results"])
    own = [check for check in CHECKS if not check.once]
    for game in GAMES:
        assert [r["check"] for r in came["results"] if r["game"] == game] == [check.name for check in own]
        assert any(line.startswith(f"{game}  an act before start is refused: passed") for line in lines)
    assert {r["check"] for r in came["results"] if r["outcome"] == PASSED} == {check.name for check in CHECKS}
    suites = ElementTree.parse(junit).getroot()
    assert [suite.get("name") for suite in suites] == ["server", *GAMES]
    assert sum(int(suite.get("tests", "")) for suite in suites) == len(came["results"])


def test_a_game_that_has_everything_is_tried_on_everything():
    with serving(Broken(set())) as address:
        results = list(run_checks(address, seconds=SECONDS))
    assert not failed(results)
    assert {result.check.name for result in results if result.outcome == NO_MATTER} == {
        "a_game_without_a_picture_refuses_to_draw",
        "a_game_without_snapshots_refuses_to_save",
        "a_game_without_snapshots_refuses_to_start_from_one",
    }


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_server_is_found_out_by_the_right_checks_of_its_families(name):
    broken = BROKEN[name]
    families = {check.family for check in CHECKS if check.name in broken.checks}
    with serving(broken) as address:
        results = list(
            run_checks(address, seconds=SECONDS, checks=[check for check in CHECKS if check.family in families])
        )
    assert failed(results) == broken.checks


def test_there_are_broken_servers_for_every_family():
    names = {name for broken in BROKEN.values() for name in broken.checks}
    assert len(BROKEN) >= 25 and names <= {check.name for check in CHECKS}
    assert {check.family for check in CHECKS if check.name in names} == set(FAMILIES)


class Sleeps(Gauntlet):
    """Takes longer for a decision than anybody waits."""

    def step(self, acts):
        time.sleep(0.5)
        return super().step(acts)


def test_a_server_that_does_not_answer_is_a_failure_and_no_hang():
    steps = [check for check in CHECKS if check.family in ("pictures", "sessions")]
    begin = time.monotonic()
    with serving(Broken(set(), game=Sleeps)) as address:
        results = list(run_checks(address, seconds=0.3, checks=steps))
    assert time.monotonic() - begin < 10.0
    assert [r.came for r in results].count("no answer within 0.3 s") == PATIENCE
    assert results[-1].outcome == FAILED and results[-1].came.startswith("not tried: ")


def test_a_server_that_is_not_there_fails(capsys):
    assert main("127.0.0.1:1", [], 1.0, as_object=True, junit=None) == 1
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["passed"] == 0


class Tired(Honest):
    def answer(self, request):
        if request.HasField("reset"):
            raise ZeroDivisionError("a server's own bug \x00\udcff")
        return super().answer(request)


def test_a_failure_says_the_rule_what_came_what_was_expected_and_where_it_stands(capsys):
    def strange(subject):
        """A rule."""
        raise BrokenRule("\x00 a & b", "<c>")

    check = Check("a_rule_holds", "order", "A rule.", "Act", False, strange)
    with serving(Broken(set(), session=Tired)) as address:
        (result,) = run_checks(address, [Gauntlet.name], checks=[check])
    assert (result.outcome, result.came, result.expected) == (FAILED, "\x00 a & b", "<c>")
    assert result.lines == [
        "gauntlet  a rule holds: failed", "    rule: A rule.", "    got: \x00 a & b", "    expected: <c>",
        "    manual: bridge.proto, Act",
    ]  # fmt: skip


def test_junit_holds_whatever_a_server_says(tmp_path):
    check = Check("a_rule_holds", "order", "A rule.", "Act", False, lambda subject: None)
    results = [
        Result("game\x1b", check, FAILED, 0.1, "\x00\ufffe <&>", "c"),
        Result("game\x1b", check, NO_MATTER, 0.1, "no \x07 bell"),
    ]
    write_junit(str(tmp_path / "junit.xml"), results)
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("2", "1", "1")


def test_a_kit_that_trips_over_a_server_reports_it_and_goes_on():
    def trips(subject):
        raise KeyError("nothing there")

    check = Check("a_rule_holds", "order", "A rule.", "Act", False, trips)
    with serving(Broken(set())) as address:
        one, other = run_checks(address, [Gauntlet.name], checks=[check, check])
    assert one.outcome == other.outcome == FAILED and "KeyError" in one.came


def test_an_unknown_game_fails_all_its_checks_that_ask_for_it():
    with serving(Broken(set())) as address:
        results = list(
            run_checks(address, ["chess"], seconds=SECONDS, checks=[c for c in CHECKS if c.family == "starts"])
        )
        with Server(address, SECONDS) as server, pytest.raises(BrokenRule, match="NOT_FOUND"):
            server.describe("chess")
    assert len(failed(results)) == len(results)
