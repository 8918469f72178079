"""The command `joybridge check`: what is selected, printed, written and refused."""

import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from xml.etree import ElementTree

import grpc
import pytest

from joybridge.conformance.__main__ import main
from joybridge.conformance.expectations import Violation
from joybridge.conformance.report import FAILED, NOT_APPLICABLE, WARNING, Result, write_junit
from joybridge.conformance.rules import CHECKS, FAMILIES
from joybridge.conformance.runner import SERVER, run_checks
from joybridge.conformance.selection import SelectionError, select
from tests.support.broken_servers import (
    BROKEN,
    BrokenServer,
    Gauntlet,
    serving,
)
from tests.support.checked import made_up, run

NOWHERE = "127.0.0.1:1"


pytestmark = pytest.mark.usefixtures("quiet_servers")


def test_list_prints_every_family_check_and_rule_and_needs_no_address(capsys):
    assert main(["check", "--list"]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert [line.partition(":")[0] for line in lines if line.partition(":")[0] in FAMILIES] == list(FAMILIES)
    for check in CHECKS:
        assert lines[lines.index(check.name) + 1] == check.rule


def test_list_prints_only_the_selected_checks(capsys):
    assert main(["check", "--list", "--family", "order"]) == 0
    text = capsys.readouterr().out
    assert "act_before_start_is_refused" in text and "zero_arenas_are_refused" not in text and "limits:" not in text


def test_a_family_is_selected_by_its_name(correct, capsys):
    status, report, _ = run(capsys, correct, "--family", "order", "--family", "limits")
    assert status == 0 and report["passed"] == len(report["results"])
    assert {r["check"] for r in report["results"]} == {c.name for c in CHECKS if c.family in ("order", "limits")}


def test_checks_are_selected_by_their_names_in_addition_to_families(correct, capsys):
    names = ["game_names_are_unique", "masked_choice_is_refused"]
    _, report, _ = run(capsys, correct, "--only", names[1], "--only", names[0])
    assert [(r["game"], r["check"]) for r in report["results"]] == [(SERVER, names[0]), (Gauntlet.name, names[1])]
    _, report, _ = run(capsys, correct, "--only", names[0], "--family", "order")
    assert {r["family"] for r in report["results"]} == {"games", "order"}


def test_quiet_prints_nothing_but_failures_and_the_summary(correct, capsys):
    arguments = ["--only", "zero_arenas_are_refused", "--only", "unknown_request_is_refused", "--quiet"]
    assert main(["check", correct, "--only", "zero_arenas_are_refused", "--quiet"]) == 0
    assert re.fullmatch(r"\n1 passed, 0 failed, 0 warnings, 0 not applicable in \d+\.\d s\n", capsys.readouterr().out)
    with serving(BROKEN["NoArenasIsOne"]) as address:
        assert main(["check", address, *arguments[:2], "--quiet"]) == 1
    first, *_, last = capsys.readouterr().out.splitlines()
    assert first == "gauntlet  zero_arenas_are_refused: failed" and last.startswith("0 passed, 1 failed")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--family", "picture"], "unknown family 'picture'; the nearest are pictures"),
        (["--family", "seds"], "unknown family 'seds'; the nearest are seeds, "),
        (["--only", "masked"], "unknown check 'masked'; the nearest are masked_choice_is_refused"),
        (["--only", "nan_axes_are_refused"], "unknown check 'nan_axes_are_refused'; the nearest are "),
        ([], "no server responds at 127.0.0.1:1 ("),
    ],
)
def test_what_cannot_be_checked_is_an_error_in_one_sentence(arguments, error, capsys):
    assert main(["check", NOWHERE, *arguments]) == 2
    output = capsys.readouterr()
    assert output.out == "" and output.err.startswith(f"error: {error}") and output.err.count("\n") == 1


def test_a_game_that_the_server_does_not_have_is_an_error_in_one_sentence(correct, capsys):
    assert main(["check", correct, "--game", "chess"]) == 2
    assert capsys.readouterr() == ("", "error: unknown game 'chess'; expected gauntlet\n")


def test_a_file_that_cannot_be_written_is_an_error_in_one_sentence(correct, tmp_path, capsys):
    path = tmp_path / "missing" / "junit.xml"
    assert main(["check", correct, "--only", "zero_arenas_are_refused", "--junit", str(path)]) == 2
    assert capsys.readouterr().err == f"error: [Errno 2] No such file or directory: '{path}'\n"


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ([], "ADDRESS is missing; only --list needs none"),
        (
            ["nowhere"],
            "or unix:PATH; it is a running server that is tested: start one by `joybridge serve`, with --game",
        ),
        ([NOWHERE, "--deadline", "0"], "argument --deadline: got '0', expected a positive number of seconds"),
        ([NOWHERE, "--wait", "soon"], "argument --wait: got 'soon', expected a positive number of seconds"),
    ],
)
def test_a_malformed_command_line_is_refused(arguments, error, capsys):
    with pytest.raises(SystemExit) as end:
        main(["check", *arguments])
    assert end.value.code == 2 and error in capsys.readouterr().err


def test_a_server_that_begins_later_is_waited_for(monkeypatch, capsys):
    with socket.socket() as reserved, ExitStack() as later:
        reserved.bind(("127.0.0.1", 0))  # and does not listen
        port = reserved.getsockname()[1]
        assert main(["check", f"127.0.0.1:{port}", "--only", "zero_arenas_are_refused"]) == 2
        ready = grpc.channel_ready_future

        def begin(channel):
            reserved.close()
            later.enter_context(serving(BrokenServer(set()), port))
            return ready(channel)

        monkeypatch.setattr(grpc, "channel_ready_future", begin)
        assert main(["check", f"127.0.0.1:{port}", "--only", "zero_arenas_are_refused", "--wait", "60"]) == 0


def test_an_unknown_name_lists_the_nearest_ones():
    with pytest.raises(SelectionError, match="the nearest are axis_below_low_is_refused, axis_above_high_is_refused"):
        select(names=["axis_above_low_is_refused"])


LEAVES = """
import threading
from joybridge.process import leave
threading.Thread(target=threading.Event().wait).start()  # a normal exit waits for it forever
print("x" * 1_000_000)
leave(3)
"""


def test_the_process_ends_with_all_its_output_whatever_its_threads_wait_for():
    process = subprocess.run([sys.executable, "-c", LEAVES], capture_output=True, text=True, timeout=600, check=False)
    assert (process.returncode, process.stdout, process.stderr) == (3, "x" * 1_000_000 + "\n", "")


def test_a_failure_prints_the_rule_both_values_and_the_section(correct):
    def strange(subject):
        """A rule."""
        raise Violation("\x00 a & b", "<c>")

    (result,) = run_checks(correct, [Gauntlet.name], checks=[made_up(strange)])
    assert (result.outcome, result.got, result.expected) == (FAILED, "\x00 a & b", "<c>")
    assert result.lines == [
        "gauntlet  rule_holds: failed",
        "    rule: A rule.",
        "    got: \\x00 a & b",
        "    expected: <c>",
        "    see: bridge.proto, Act",
    ]


def test_junit_holds_any_text_of_a_server(tmp_path):
    check = made_up(lambda subject: None)
    results = [
        Result("game\x1b", check, FAILED, 0.1, "\x00\ufffe <&>", "c"),
        Result("game\x1b", check, NOT_APPLICABLE, 0.1, "no \x07 bell"),
        Result("game\x1b", check, WARNING, 0.1, "\x00", "c"),
    ]
    write_junit(str(tmp_path / "junit.xml"), results)
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
