"""The conformance kit: correct servers pass every check, and each broken server fails the right ones."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import grpc
import numpy as np
import pytest

from joybridge.conformance import subject
from joybridge.conformance.__main__ import main
from joybridge.conformance.client import Client, Status
from joybridge.conformance.expectations import Unreachable, Violation
from joybridge.conformance.recording import expect_same_recording
from joybridge.conformance.report import FAILED, NOT_APPLICABLE, PASSED, WARNING, repair_first
from joybridge.conformance.rules import CHECKS, FAMILIES, sessions
from joybridge.conformance.runner import MAX_TIMEOUTS, SERVER, run_checks
from joybridge.conformance.selection import select
from joybridge.games import BUILT_IN
from tests.support.broken_servers import (
    BROKEN,
    DRAWS,
    LENGTH,
    PROTECTED,
    BrokenServer,
    Gauntlet,
    Leaks,
    Service,
    serving,
)
from tests.support.checked import made_up, run
from tests.support.servers import server

ROOT = Path(__file__).parents[1]
GAMES = ["shooting_birds", "hybrid", "duel", "ends", "kick", "noughts"]  # to which, together, every rule applies
# Of what a game sends; the other families are about what the server does for every game.
FAMILIES_OF_GAMES = [
    "specs",
    "settings",
    "behaviors",
    "start",
    "choices",
    "seeds",
    "steps",
    "episode_ends",
    "resets",
    "pictures",
    "scripts",
    "snapshots",
]
SECONDS = 10.0


pytestmark = pytest.mark.usefixtures("quiet_servers")


def failed(results, outcome=FAILED):
    return {result.check.name for result in results if result.outcome == outcome}


# ------------------------------------------------------------------------------------------------------ the checks


def test_there_are_many_checks_each_with_a_rule_and_a_section_of_the_manual():
    manual = (ROOT / "proto/joybridge/v1/bridge.proto").read_text()
    headings = re.findall(r"^// ([A-Z]+(?: [A-Z]+)*)\b", manual, re.MULTILINE)
    sections = {*headings, *re.findall(r"^ *(?:message|enum|rpc) (\w+)", manual, re.MULTILINE)}
    assert {"SESSION", "VERSIONS", "ERRORS", "DescribeGame", "Act", "Dtype"} <= sections
    assert len(CHECKS) >= 200
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert {check.family for check in CHECKS} == set(FAMILIES)
    for check in CHECKS:
        assert check.rule.endswith(".") and check.section in sections, check.name


def test_an_axis_as_wide_as_floats_and_a_parameter_of_one_value_break_no_rule():
    with server("--game", "tests.support.games:Farthest") as process:
        results = [*run_checks(process.address, ["farthest"], SECONDS, select(["actions", "snapshots"], []))]
    assert len(results) > 30 and not failed(results)


@pytest.mark.slow
@pytest.mark.promise("P3")
def test_the_server_passes_every_check_from_end_to_end(simulator, tmp_path):
    junit = tmp_path / "junit.xml"
    games = [part for game in GAMES for part in ("--game", game)]
    command = [sys.executable, "-m", "joybridge", "check", simulator, *games, "--deadline", "60", "--json"]
    process = subprocess.run(  # the time is a limit for what hangs: the whole takes two minutes or more
        [*command, "--junit", str(junit)], cwd=ROOT, capture_output=True, text=True, timeout=1800, check=False
    )
    lines = process.stdout.splitlines()
    assert (process.returncode, process.stderr) == (0, ""), "\n".join(line for line in lines if ": failed" in line)
    report = json.loads(lines[-1])
    assert report["failed"] == report["warnings"] == 0 and report["repair_first"] == []
    assert report["passed"] + report["not_applicable"] == len(report["results"])
    per_game = [check.name for check in CHECKS if not check.per_server]
    for game in GAMES:
        assert [r["check"] for r in report["results"] if r["game"] == game] == per_game
        assert f"{game}  act_before_start_is_refused: passed" in lines
    passed = {r["check"] for r in report["results"] if r["outcome"] == PASSED}
    with_token = {
        "calls_with_another_token_are_unauthenticated",
        "calls_without_the_token_are_unauthenticated",
        "health_needs_no_token",
    }
    assert passed == {check.name for check in CHECKS} - with_token
    suites = ElementTree.parse(junit).getroot()
    assert [suite.get("name") for suite in suites] == [SERVER, *GAMES]
    assert sum(int(suite.get("tests", "")) for suite in suites) == len(report["results"])


@pytest.mark.slow
@pytest.mark.parametrize("game", [game for game in BUILT_IN if game not in GAMES])
@pytest.mark.promise("P3")
def test_every_other_game_passes_every_check_of_what_it_sends(game, simulator):
    checks = select(families=FAMILIES_OF_GAMES)
    # Over the Unix socket, because it is faster.
    results = list(run_checks(simulator, [game], seconds=60.0, checks=checks, transport="local"))
    assert not failed(results) | failed(results, WARNING)
    assert {"valid_actions_are_answered", "session_continues_from_a_snapshot"} <= {r.check.name for r in results}


def test_a_game_with_all_features_passes_every_check_but_those_for_missing_features(correct):
    results = list(run_checks(correct, seconds=SECONDS))
    assert not failed(results) | failed(results, WARNING)
    assert failed(results, NOT_APPLICABLE) == {
        "calls_with_another_token_are_unauthenticated",
        "calls_without_the_token_are_unauthenticated",
        "health_needs_no_token",
        "distributions_are_refused_without_the_flag",
        "draw_is_refused_without_pictures",
        "save_is_refused_without_snapshots",
        "start_from_a_snapshot_is_refused_without_snapshots",
    }


@pytest.mark.no_cover  # the rules are covered by the server that passes; measuring them again is slow
@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_server_fails_exactly_the_right_checks_of_their_families(name):
    broken = BROKEN[name]
    found = broken.checks | broken.warned
    checks = select(families=sorted({check.family for check in CHECKS if check.name in found}))
    with serving(broken) as address:
        results = list(run_checks(address, seconds=SECONDS, checks=checks, credentials=broken.credentials))
    assert (failed(results), failed(results, WARNING)) == (broken.checks, broken.warned)


def test_a_protected_server_passes_with_its_token_and_is_not_checked_without(tmp_path, capsys):
    (tmp_path / "token").write_text(PROTECTED.credentials.token)
    (tmp_path / "token").chmod(0o600)
    arguments = ["--token-file", str(tmp_path / "token"), "--family", "security", "--family", "health_and_reflection"]
    with serving(PROTECTED) as address:
        status, report, _ = run(capsys, address, *arguments)
        assert (status, report["passed"]) == (0, len(report["results"]))
        assert main(["check", address]) == 2
    assert "wants another token, or one at all; see --token-file" in capsys.readouterr().err


def test_a_server_that_keeps_lost_sessions_is_found_and_so_is_what_follows_from_it(monkeypatch):
    monkeypatch.setattr(sessions, "ROOM_SECONDS", 0.3)
    checks = select(names=["ended_sessions_are_freed", "zero_arenas_are_refused"])
    with serving(BrokenServer(set(), service=Leaks)) as address:
        results = list(run_checks(address, seconds=SECONDS, checks=checks))
    assert failed(results) == {check.name for check in checks}
    assert repair_first(results, list(FAMILIES)) == ["ended_sessions_are_freed"]
    (leak,) = (result for result in results if result.check.name == "ended_sessions_are_freed")
    assert leak.got == "RESOURCE_EXHAUSTED '12 sessions are open' after 16 sessions were cancelled"
    assert "do sessions that were closed or lost still count?" in results[-1].expected


class Deterministic(Gauntlet):
    """Uses no random number."""

    def draws(self, arena):
        return np.zeros(2)


class Coins(Gauntlet):
    """Tosses two coins at the beginning of an episode: it has four different ones."""

    def draws(self, arena):
        return np.sign(super().draws(arena)) * (self.counts[arena, LENGTH] == 0)


class OneArena(Gauntlet):
    """Runs one arena per session, as a game with a large world does."""

    @classmethod
    def describe(cls, options):
        spec = super().describe(options)
        spec.max_arenas, spec.snapshot_bytes_per_arena = 1, 100
        return spec


@pytest.mark.no_cover  # the server that passes reaches the rules as well
@pytest.mark.parametrize(
    ("game", "families"),
    [
        (Deterministic, ["seeds", "resets"]),
        (Coins, ["seeds", "resets"]),
        (OneArena, ["seeds", "pictures", "snapshots"]),
    ],
)
def test_a_correct_game_of_one_arena_or_of_few_different_episodes_fails_nothing(game, families):
    checks = select(families=families)
    with serving(BrokenServer(set(), game=game)) as address:
        results = list(run_checks(address, seconds=SECONDS, checks=checks))
    assert not failed(results) | failed(results, WARNING)


class Endless(Gauntlet):
    """Cuts time into episodes and goes on from where it was."""

    def begin(self, arena):
        if self.counts[arena, LENGTH] == 0:
            super().begin(arena)
        self.counts[arena, :DRAWS] = 0

    def step(self, acts):
        self.place *= 0.5  # it never goes far
        return super().step(acts)


def test_final_observations_that_are_the_next_ones_are_a_warning_where_a_game_may_go_on():
    checks = select(names=["final_observations_belong_to_the_old_episode"])
    with serving(BrokenServer(set(), game=Endless)) as address:
        (result,) = run_checks(address, seconds=SECONDS, checks=checks)
    assert result.outcome == WARNING, result


class Unseeded(Gauntlet):
    """Draws other numbers in every session."""

    def draws(self, arena):
        return np.random.default_rng().normal(size=2)


class Crashes(Gauntlet):
    """Fails in every step."""

    def step(self, acts):
        raise KeyError("score")


@pytest.mark.no_cover  # the server that passes reaches the rules as well
@pytest.mark.parametrize(
    ("game", "first"), [(Unseeded, "same_seed_gives_the_same_bytes"), (Crashes, "valid_actions_are_answered")]
)
def test_what_other_failures_follow_from_is_to_be_repaired_first(game, first, capsys):
    families = [f"--family={family}" for family in ("versions", "steps", "seeds")]
    with serving(BrokenServer(set(), game=game)) as address:
        status, report, lines = run(capsys, address, *families)
    assert status == 1 and report["failed"] > 5
    assert report["repair_first"][0] == first and lines[-1].startswith(f"repair first: {first}")


def test_there_is_a_broken_server_for_every_family():
    names = {name for broken in BROKEN.values() for name in broken.checks | broken.warned}
    assert names <= {check.name for check in CHECKS}
    assert {check.family for check in CHECKS if check.name in names} == set(FAMILIES)


# ------------------------------------------------------------------------------------------------ the command line


# ----------------------------------------------------------------------------------------- servers that do not work


class Sleeps(Gauntlet):
    """Takes longer for a decision than the deadline."""

    def step(self, acts):
        time.sleep(0.5)
        return super().step(acts)


def test_after_several_timeouts_the_other_checks_of_a_game_are_not_run():
    checks = select(families=["pictures", "seeds"])
    with serving(BrokenServer(set(), game=Sleeps)) as address:
        results = list(run_checks(address, seconds=0.3, checks=checks))
    assert len(results) == len(checks)
    assert [r.got for r in results].count("no response within 0.3 s") == MAX_TIMEOUTS
    assert results[-1].outcome == FAILED and results[-1].got == f"not run after {MAX_TIMEOUTS} timeouts"


class Steady(Gauntlet):
    """Takes a part of the deadline for each decision."""

    def step(self, acts):
        time.sleep(0.06)
        return super().step(acts)


def test_a_session_of_slow_steps_may_take_longer_than_the_deadline_of_a_response():
    with serving(BrokenServer(set(), game=Steady)) as address, Client(address, 1.2) as client:
        recording = subject.Subject(client, Gauntlet.name).record(2 * subject.SHORT)
    assert recording.end is None and len(recording.steps) == 2 * subject.SHORT + 1


class Compiles(Gauntlet):
    """Takes longer than the deadline to begin its first session."""

    compiled = False

    def __init__(self, *arguments):
        if not Compiles.compiled:
            time.sleep(2.5)
        Compiles.compiled = True
        super().__init__(*arguments)


def test_a_game_that_is_compiled_in_its_first_session_may_take_longer_than_the_deadline():
    names = ["ended_sessions_are_freed", "started_has_the_spec_of_describe"]
    with serving(BrokenServer(set(), game=Compiles)) as address:
        results = list(run_checks(address, seconds=2.0, checks=select(names=names)))
    assert Compiles.compiled and [result.outcome for result in results] == [PASSED] * 2


class NoList(Service):
    """A server that is not complete yet."""

    def ListGames(self, request, context):
        raise NotImplementedError


def test_sessions_that_the_clock_ends_at_different_steps_are_compared_as_far_as_both_go(correct, monkeypatch):
    clock = iter([0.0, *[1.0] * 4, 9.0, 0.0, *[1.0] * 7, 9.0, 0.0, 1.0, 9.0])  # 5, 8 and 2 decisions
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    with Client(correct, SECONDS) as client:
        game = subject.Subject(client, Gauntlet.name)
        for decisions in (5, 8, 2):
            assert len(game.record_long(300).steps) == decisions + 1
    clock = iter([0.0, *[1.0] * 4, 9.0, 0.0, 1.0, 9.0])
    (result,) = run_checks(correct, checks=select(names=["same_seed_gives_the_same_bytes_in_a_long_session"]))
    assert result.outcome == PASSED, result


def test_without_a_list_of_games_the_server_is_checked_and_a_named_game_too():
    with serving(BrokenServer(set(), service=NoList)) as address:
        names = ["game_names_are_unique", "zero_arenas_are_refused"]
        (result,) = run_checks(address, checks=select(names=names))
        assert result.got.startswith("ListGames failed with UNKNOWN")
        assert len(list(run_checks(address, [Gauntlet.name], checks=select(names=names)))) == 2
        with pytest.raises(Unreachable, match="no game to check: ListGames failed with UNKNOWN"):
            list(run_checks(address, checks=select(names=names[1:])))


class CannotDraw(Gauntlet):
    """Fails when it draws."""

    def draw(self, arena):
        raise KeyError("canvas")


def test_a_comparison_tells_the_error_that_ended_a_session(correct):
    checks = select(names=["drawing_does_not_change_the_episode"])
    with serving(BrokenServer(set(), game=CannotDraw)) as address:
        (result,) = run_checks(address, seconds=SECONDS, checks=checks)
    assert result.outcome == FAILED and re.search("1 responses to 13 requests, then INTERNAL .*canvas", result.got)

    def ends_early(subject):
        recording = subject.record()
        recording.end = Status(grpc.StatusCode.INTERNAL, "no canvas")
        expect_same_recording(recording, subject.short_session, "after a failure")

    (result,) = run_checks(correct, checks=[made_up(ends_early)])
    assert result.got == "INTERNAL 'no canvas' after a failure"


def test_an_exception_in_a_check_is_a_failure_and_the_next_check_runs(correct):
    def raises(subject):
        raise KeyError("nothing there")

    one, other = run_checks(correct, checks=[made_up(raises), made_up(raises)])
    assert one.outcome == other.outcome == FAILED and one.got == "KeyError: 'nothing there'"


def test_the_spec_of_an_unknown_game_is_a_violation(correct):
    with Client(correct, SECONDS) as client, pytest.raises(Violation, match="NOT_FOUND"):
        client.describe("chess")
