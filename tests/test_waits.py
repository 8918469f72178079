"""A simulator that holds up the others is named, and another one plays its arenas, to the same bits."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from joybridge.client import sharded_session
from joybridge.client.errors import SimulatorError
from joybridge.run import collect, waits
from joybridge.run.recovery import recovering
from joybridge.run.run_state import RunState
from joybridge.run.train import train
from joybridge.run.training import Audience
from joybridge.run.waits import CYCLES, Slow, Waits
from tests.test_recovery import CONFIG, outcome


class Clock:
    def __init__(self, monkeypatch: Any) -> None:
        self.now = 0.0
        monkeypatch.setattr(waits, "time", SimpleNamespace(perf_counter=lambda: self.now))


def cycles(clock: Clock, sessions: Any, *all_waited: dict[int, float]) -> list[Slow | None]:
    """Return what is found after cycles of ten seconds, in which sessions were waited for."""
    watched, found = Waits(sessions), []
    for waited in all_waited:
        clock.now += 10.0
        for index, seconds in waited.items():
            sessions[index].waited += seconds
        found.append(watched.look())
    return found


def at(*addresses: str) -> Any:
    return [SimpleNamespace(address=address, waited=0.0) for address in addresses]


@pytest.mark.promise("F4")
def test_one_slow_simulator_of_eight_is_named_after_some_cycles(monkeypatch):
    usual = dict.fromkeys(range(8), 0.2)
    slow = usual | {5: 6.2}
    found = cycles(Clock(monkeypatch), at(*"abcdefgh"), *[slow] * (CYCLES - 1), slow | {5: 5.2}, slow)
    assert found[: CYCLES - 1] == [None] * (CYCLES - 1)
    first = found[CYCLES - 1]
    assert first is not None and (first.address, first.far) == ("f", True)
    assert first.share == pytest.approx(0.5)  # the least: 5.2 s, less the 0.2 s of each other one, of 10 s
    assert "50% of the time is spent on the simulator at f alone" in first.text
    assert found[-1] == first  # it is still the least of the last cycles


@pytest.mark.parametrize(
    ("addresses", "waited"),
    [
        ("ab", [{0: 4.0, 1: 0.1}, {0: 0.1, 1: 4.0}]),  # now one, now the other
        ("ab", [{0: 5.0, 1: 0.1}, {0: 5.0, 1: 0.1}, {0: 0.3, 1: 0.1}]),  # it stalled and does no more
        ("ab", [{0: 1.5, 1: 0.1}] * 3),  # less than is named
        ("a", [{0: 9.0}] * 3),
        ("aa", [{0: 9.0, 1: 0.0}] * 3),
        ("aab", [{0: 4.0, 1: 4.0, 2: 0.1}] * 3),  # it plays the arenas of two
    ],
)
def test_nobody_is_named_who_is_not_slow(monkeypatch, addresses, waited):
    assert cycles(Clock(monkeypatch), at(*addresses), *waited) == [None] * len(waited)


def test_who_is_less_than_three_times_as_slow_is_named_and_keeps_its_arenas(monkeypatch):
    *_, found = cycles(Clock(monkeypatch), at("a", "b"), *[{0: 2.0, 1: 5.0}] * CYCLES)
    assert found is not None and not found.far


@pytest.mark.parametrize("refuses", [False, True])
@pytest.mark.promise("F4", "D1")
def test_a_run_that_leaves_a_slow_simulator_ends_in_the_same_bits(refuses, simulator, tmp_path, monkeypatch, caplog):
    other = simulator.replace("127.0.0.1", "localhost")
    train(CONFIG, tmp_path / "quiet", [simulator, other], resume=False)
    slow = Slow(other, 0.5, simulator, far=True)
    looks = iter([None, slow])
    monkeypatch.setattr(Waits, "look", lambda _: next(looks, None))
    opened: list[list[str]] = []
    said: list[str] = []
    open_session = sharded_session.open_session

    def spy(addresses: Any, parts: Any) -> Any:
        opened.append(list(addresses))
        if refuses and len(opened) == 3:
            raise SimulatorError("there is no room for more sessions")
        return open_session(addresses, parts)

    monkeypatch.setattr(collect, "open_session", spy)
    train(CONFIG, tmp_path / "run", [simulator, other], resume=False, audience=Audience(say=said.append))
    assert outcome(tmp_path / "run") == outcome(tmp_path / "quiet")
    assert opened[:2] == [[simulator], [other]] and opened[2] == [simulator]
    assert opened[-1] == ([other] if refuses else [simulator])
    assert said.count(slow.text) == 1
    assert f"from now on the simulator at {simulator} plays its arenas" in caplog.text
    assert ("there is no room for more sessions; each simulator plays its own arenas again" in caplog.text) == refuses


def test_without_snapshots_no_arenas_move():
    opened = []

    def proceed(addresses: Any, state: RunState) -> Any:
        opened.append(addresses)
        yield replace(state, slow=Slow("b", 0.5, "a", far=True))
        yield state

    assert len(list(recovering(proceed, RunState(), ["a", "b"], None, 0))) == 2
    assert opened == [["a", "b"]]
