"""Training goes on by itself when a simulator is lost, and ends with the same bits."""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

from joybridge.client.errors import SimulatorLost, SimulatorShutDown
from joybridge.client.launch import simulator_process
from joybridge.config.config import Config
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.recovery import recovering
from joybridge.run.run_state import RunState
from joybridge.run.train import train
from joybridge.run.training import Audience

LANES, ROLLOUT, ROLLOUTS = 4, 16, 6
CONFIG = Config(
    game="shooting_birds",
    layout="bucket-3",
    arenas=LANES,
    total_timesteps=LANES * ROLLOUT * ROLLOUTS,
    log_interval=LANES,
    max_restarts=5,
    policy=PolicyConfig(rollout_steps=ROLLOUT, time_horizon=ROLLOUT, minibatch_size=32, hidden_sizes=[8]),
)
TIMING = {"seconds", "timesteps_per_second", "simulate", "wire", "act", "learn"}


class Simulator:
    """A simulator that can be killed and started again."""

    def __init__(self, running: ExitStack) -> None:
        self.running, self.starts = running, 0

    def start(self) -> list[str]:
        self.running.close()
        self.starts += 1
        before = children()
        address = self.running.enter_context(simulator_process())
        (self.process,) = children() - before
        return [address]

    def end(self, number: int) -> None:
        """End the process, and wait until it has ended."""
        os.kill(self.process, number)
        os.waitid(os.P_PID, self.process, os.WEXITED | os.WNOWAIT)


@pytest.mark.parametrize(("game", "said_of"), [("archer", True), ("shooting_birds", False)])
def test_a_run_that_is_resumed_says_if_it_gives_other_bits_because_its_game_has_no_snapshots(
    game, said_of, simulator, tmp_path
):
    config, said = CONFIG.model_copy(update={"game": game}), list[str]()
    audience = Audience(say=said.append)
    train(
        config.model_copy(update={"stop_at": LANES * ROLLOUT}), tmp_path, [simulator], resume=False, audience=audience
    )
    assert not any("no snapshots" in line for line in said)
    train(config, tmp_path, [simulator], resume=True, audience=audience)
    assert any(line.startswith(f"{game} has no snapshots, so new episodes begin: the run") for line in said) == said_of


def children() -> set[int]:
    return {int(text) for text in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()}


@pytest.fixture
def mortal() -> Iterator[Simulator]:
    with ExitStack() as running:
        yield Simulator(running)


def killing(simulator: Simulator, number: int, moments: Sequence[int]) -> Callable[..., None]:
    """Return a report that ends the simulator when the run first reaches each of some timesteps."""
    left = list(moments)

    def report(timesteps: int, *_: object) -> None:
        if left and timesteps >= left[0]:
            left.pop(0)
            simulator.end(number)

    return report


def outcome(run: Path) -> tuple[dict[str, bytes], list[dict[str, float]]]:
    rows = read_rows(run / "metrics-hunter.csv")
    return (
        {name: array.tobytes() for name, array in load_checkpoint(run)[0].items()},
        [{name: value for name, value in row.items() if name not in TIMING} for row in rows],
    )


@pytest.mark.promise("F1")
def test_a_run_whose_simulator_is_killed_at_any_moment_ends_like_one_that_is_left_alone(
    mortal, simulator, tmp_path, caplog
):
    train(CONFIG, tmp_path / "quiet", [simulator], resume=False)
    moments = [LANES, LANES * ROLLOUT, LANES * ROLLOUT * 3 + LANES * 5, CONFIG.end - LANES * 3]
    report = killing(mortal, signal.SIGKILL, moments)
    train(CONFIG, tmp_path / "run", mortal.start(), resume=False, audience=Audience(report), revive=mortal.start)
    assert mortal.starts == 1 + len(moments)
    assert outcome(tmp_path / "run") == outcome(tmp_path / "quiet")
    assert len(outcome(tmp_path / "run")[1]) == ROLLOUT * ROLLOUTS
    assert "lost the simulator at " in caplog.text
    assert "training goes on from 192 timesteps (restart 3 of 5)" in caplog.text


def test_a_run_that_has_used_up_its_restarts_saves_and_ends(mortal, tmp_path):
    report = killing(mortal, signal.SIGKILL, [LANES * (ROLLOUT + 1), LANES * (ROLLOUT * 2 + 1)])
    config = CONFIG.model_copy(update={"max_restarts": 1})
    with pytest.raises(SimulatorLost):
        train(config, tmp_path, mortal.start(), resume=False, audience=Audience(report), revive=mortal.start)
    assert mortal.starts == 2
    assert load_checkpoint(tmp_path)[1].timesteps == LANES * ROLLOUT * 2


# Without simulators


class Script:
    """A simulator's life: how many states each session yields, and how it is lost then."""

    def __init__(self, *lives: tuple[int, type[SimulatorLost] | None]) -> None:
        self.lives = list(lives)
        self.begun: list[tuple[str, int]] = []

    def proceed(self, addresses, state):
        count, end = self.lives.pop(0)
        self.begun.append((addresses[0], state.timesteps))
        for timesteps in range(state.timesteps + 1, state.timesteps + 1 + count):
            yield RunState(timesteps)
        if end is not None:
            raise end("gone")

    def run(self, restarts: int) -> list[int]:
        names = iter("bcdefgh")
        states = recovering(self.proceed, RunState(), ["a"], lambda: [next(names)], restarts)
        return [state.timesteps for state in states]


@pytest.fixture
def pauses(monkeypatch) -> list[float]:
    seconds: list[float] = []
    monkeypatch.setattr(time, "sleep", seconds.append)
    return seconds


def test_it_goes_on_at_the_new_address_from_the_last_state(pauses):
    script = Script((3, SimulatorLost), (0, SimulatorLost), (2, None))
    assert script.run(restarts=2) == [1, 2, 3, 4, 5]
    assert script.begun == [("a", 0), ("b", 3), ("c", 3)]


def test_it_pauses_longer_each_time_it_does_not_get_on(pauses):
    script = Script(*[(0, SimulatorLost)] * 6, (1, SimulatorLost), (1, None))
    script.run(restarts=7)
    assert pauses == [1, 2, 4, 8, 16]
    pauses.clear()
    with pytest.raises(SimulatorLost):
        Script(*[(0, SimulatorLost)] * 8).run(restarts=7)
    assert pauses == [1, 2, 4, 8, 16, 30]


def test_announced_ends_without_any_progress_count(pauses):
    with pytest.raises(SimulatorShutDown):
        Script(*[(0, SimulatorShutDown)] * 5).run(restarts=3)
    assert Script((1, SimulatorShutDown), (1, SimulatorShutDown), (1, None)).run(restarts=0) == [1, 2, 3]


def test_what_the_run_does_itself_wrong_is_not_tried_again(pauses):
    script = Script((1, ValueError), (1, None))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="gone"):
        script.run(restarts=3)
