"""It is slower only if the median of several rounds is, twice, on the machine of the baseline."""

import json

import pytest

from tools import ratios


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Return a function that runs the program with some rounds of one ratio, whose baseline is 2, and its status."""
    monkeypatch.setattr(ratios, "BASELINE", tmp_path / "ratios.json")
    ratios.BASELINE.write_text(json.dumps({"machine": "here", "start": 2.0}))

    def run(*rounds, machine="here", arguments=()):
        values = iter([99.0, *rounds[: ratios.ROUNDS], 99.0, *rounds[ratios.ROUNDS :]])  # 99: warms caches up
        monkeypatch.setattr(ratios, "MEASURES", {"start": lambda: next(values)})
        monkeypatch.setattr(ratios, "machine", lambda: machine)
        return ratios.main(arguments)

    return run


FAST, SLOW = [2.0] * ratios.ROUNDS, [2.4] * ratios.ROUNDS


@pytest.mark.promise("Q2")
def test_what_is_slower_twice_fails(measured, capsys):
    assert measured(*SLOW, *SLOW) == 1
    assert "slower than ratios.json: start" in capsys.readouterr().err


@pytest.mark.parametrize("rounds", [FAST, [2.29] * ratios.ROUNDS, [*SLOW[:2], *FAST[2:]], [*SLOW, *FAST]])
def test_noise_and_a_second_measurement_forgive(measured, rounds):
    assert measured(*rounds) == 0


def test_another_machine_is_measured_and_not_judged(measured, capsys):
    assert measured(*SLOW, *SLOW, machine="elsewhere") == ratios.MISSING
    assert "start: 2.400" in capsys.readouterr().out


def test_a_baseline_is_written_for_this_machine(measured):
    assert measured(*SLOW, arguments=["--write"]) == 0
    assert json.loads(ratios.BASELINE.read_text()) == {"machine": "here", "start": 2.4}


def test_the_baseline_has_every_ratio():
    baseline = json.loads(ratios.BASELINE.read_text(encoding="utf-8"))
    assert baseline.keys() == {"machine", *ratios.MEASURES}
    assert all(0.0 < baseline[name] < 100.0 for name in ratios.MEASURES)
