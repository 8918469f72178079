"""Long steps say how far they are."""

import pytest

from joybridge.compare.display import Display
from joybridge.compare.job import Job
from joybridge.conformance import __main__ as check
from joybridge.progress import Progress, say


@pytest.fixture
def said(monkeypatch):
    """Return what was said, with a clock that goes on by four seconds whenever it is read."""
    now = iter(range(0, 4000, 4))
    monkeypatch.setattr("joybridge.progress.time.monotonic", lambda: next(now))
    return []


def test_a_step_is_told_of_when_nothing_was_said_for_long(said):
    progress = Progress(said.append, seconds=10.0)
    for number in range(8):  # at 4, 8, 12 (said, and the clock read again: 16), 20, 24, 28 (said, 32), 36, 40
        progress.report(f"{number} of 8")
    assert said == ["2 of 8", "5 of 8"]


def test_it_is_said_on_standard_error(capsys):
    say("half of it")
    assert capsys.readouterr() == ("", "half of it\n")


def test_a_grid_says_how_far_it_is_where_there_is_no_terminal(tmp_path, capsys):
    job = Job("archer", 0, 1000, tmp_path, tmp_path)
    display = Display([job], [])
    display.progress = Progress(display.progress._say, seconds=0.0)
    display.update([job])
    assert capsys.readouterr().out.splitlines()[-1] == "0 of 1 runs finished; measuring"


def test_a_quiet_check_says_how_far_it_is(simulator, monkeypatch, capsys):
    monkeypatch.setattr(check, "Progress", lambda: Progress(seconds=0.0))
    assert check.main(["check", simulator, "--quiet", "--game", "hybrid", "--only", "list_of_games_is_not_empty"]) == 0
    out = capsys.readouterr()
    assert "done" not in out.out and "checks are done" in out.err
