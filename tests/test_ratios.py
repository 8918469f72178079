"""It is slower only if the median of several rounds is, twice, beside an earlier version in the same rounds."""

import json
from contextlib import contextmanager

import pytest

from tools import ratios
from tools.checked import MISSING, Failed


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Return a function that runs the program with what this version takes in each round, and returns its status.

    The baseline is twice what the earlier version takes, which is 10.
    """
    monkeypatch.setattr(ratios, "BASELINE", tmp_path / "ratios.json")
    ratios.BASELINE.write_text(json.dumps({"start": 2.0}))

    @contextmanager
    def both_versions():
        yield "here", "earlier"

    def run(*rounds, arguments=()):
        values = iter([99.0, *rounds])  # the first warms caches up
        monkeypatch.setattr(ratios, "is_here", lambda commit: True)
        monkeypatch.setattr(ratios, "both_versions", both_versions)
        monkeypatch.setattr(ratios, "measure", lambda who: {"start": next(values) if who == "here" else 10.0})
        return ratios.main(arguments)

    return run


FAST, SLOW = [20.0] * ratios.ROUNDS, [24.0] * ratios.ROUNDS


@pytest.mark.promise("Q2")
def test_what_is_slower_twice_fails(measured, capsys):
    assert measured(*SLOW, *SLOW) == 1
    assert "slower than ratios.json: start" in capsys.readouterr().err


@pytest.mark.parametrize("rounds", [FAST, [22.9] * ratios.ROUNDS, [*SLOW[:2], *FAST[2:]], [*SLOW, *FAST]])
def test_noise_and_a_second_measurement_forgive(measured, rounds):
    assert measured(*rounds) == 0


def test_without_the_history_nothing_is_judged(monkeypatch, capsys):
    monkeypatch.setattr(ratios, "is_here", lambda commit: False)
    assert ratios.main([]) == MISSING
    assert "no commit of 0.1.0; fetch it" in capsys.readouterr().err


def test_a_program_that_fails_is_an_error(measured, monkeypatch, capsys):
    def failing(here, earlier):
        raise Failed("it ended with 1")

    monkeypatch.setattr(ratios, "rounds", failing)
    assert measured(*FAST) == 1
    assert "failed: it ended with 1" in capsys.readouterr().err


def test_a_baseline_is_written(measured):
    assert measured(*SLOW, arguments=["--write"]) == 0
    assert json.loads(ratios.BASELINE.read_text()) == {"start": 2.4}


def test_the_baseline_has_every_ratio():
    baseline = json.loads(ratios.BASELINE.read_text(encoding="utf-8"))
    assert baseline.keys() == {"start", "first update", "timesteps", "round trip"}
    assert all(0.5 < ratio < 1.5 for ratio in baseline.values())
