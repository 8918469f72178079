"""A game that fails after long play costs its episode: the arena begins anew, and the episode is no result."""

from collections import deque
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from joybridge.client.recording import load_recording
from joybridge.commands.replay import FaultFound, replay
from joybridge.config.config import Config
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, Codec, StepArrays, fill_step
from joybridge.contract.sharding import join, rows_of
from joybridge.contract.tensors import TensorError
from joybridge.policy.episodes import Episodes
from joybridge.policy.seats import Seats
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.progress import row_text
from joybridge.run.train import train
from joybridge.simulator.batched_game import ArenaError
from joybridge.simulator.catalog import load_games
from joybridge.simulator.game_adapter import TRUSTED, batched
from joybridge.simulator.workers.game import WorkerGame
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import Brittle, Duel

PLACE = "tests.support.games:Brittle"


def played(arenas: int, first_arena: int = 0, roof: str = "weak", workers: int = 0) -> list[StepArrays]:
    """Return 1,200 steps, in which each arena fails once."""
    game: Any = load_games([PLACE], workers)["brittle"]({"roof": roof}, {}, arenas, first_arena, 7)
    acts = [ActArrays(np.zeros((arenas, 0), np.float32), np.zeros((arenas, 1), np.int32))]
    with closing(game):
        return [*game.observe(), *(game.step(acts)[0] for _ in range(1200))]


def as_bytes(steps: list[StepArrays], lane: int) -> list[tuple[Any, ...]]:
    """Return what one lane sees, earns and ends in."""
    kept = [rows_of(step, np.array([lane])) for step in steps]
    return [
        (
            step.observations[0].tobytes(),
            step.rewards.tobytes(),
            step.truncated.tobytes(),
            step.terminated.tobytes(),
            b"" if step.metrics is None else step.metrics.tobytes(),
            step.interrupted is not None and step.interrupted.any(),
            *(column.tobytes() for column in step.final_observations or [np.empty(0)]),
        )
        for step in kept
    ]


@pytest.fixture(scope="module")
def three():
    return played(3)


@pytest.mark.promise("F3")
def test_a_game_that_fails_after_long_play_costs_its_episode_alone(three):
    undisturbed = played(3, roof="strong")
    for lane in range(3):
        failed = [number for number, step in enumerate(three) if step.interrupted is not None and step.truncated[lane]]
        (number,) = failed
        before, step = three[number - 1], three[number]
        row = step.ended.tolist().index(lane)
        assert step.interrupted is not None and step.final_observations is not None
        assert step.interrupted.tolist() == [one == lane for one in step.ended]
        assert step.final_observations[0][row].tobytes() == before.observations[0][lane].tobytes()
        assert step.rewards[lane] == 0.0 and not step.terminated[lane]
        assert step.observations[0][lane, 0] == 0.0  # a new episode
        assert as_bytes(three[:number], lane) == as_bytes(undisturbed[:number], lane)
        draws = [each.observations[0][lane, 1] for each in three]
        assert len(set(draws)) == len(draws)  # random numbers go on, so no episode comes twice


@pytest.mark.promise("F3")
def test_what_follows_a_failure_depends_on_the_seed_and_the_arena_alone(three):
    alone = played(1, first_arena=1)
    assert as_bytes(alone, 0) == as_bytes(three, 1)
    in_workers = played(3, workers=2)
    assert [as_bytes(in_workers, lane) for lane in range(3)] == [as_bytes(three, lane) for lane in range(3)]
    assert issubclass(load_games([PLACE], 2)["brittle"], WorkerGame)


def test_a_failure_is_said_with_arena_and_traceback(caplog):
    played(1, first_arena=5)
    (record,) = caplog.records
    assert record.message.startswith("brittle: the game failed in arena 5; ") and record.levelname == "ERROR"
    assert "RuntimeError: the roof fell in" in caplog.text and "Traceback" in caplog.text


class Together(Brittle):
    def decisions(self):
        return TRUSTED + 1


def test_a_mistake_that_strikes_in_many_arenas_at_once_is_said_once_with_their_numbers(caplog):
    acts = [ActArrays(np.zeros((3, 0), np.float32), np.zeros((3, 1), np.int32))]
    with closing(batched(Together)({"roof": "weak"}, {}, 3, 4, 7)) as game:
        deque((game.step(acts) for _ in range(TRUSTED + 1)), maxlen=0)
    (record,) = caplog.records
    assert record.message.startswith("brittle: the game failed in 3 arenas (4, 5, 6); ")
    assert caplog.text.count("Traceback") == 1


class Again(Brittle):
    made = 0

    def decisions(self):
        type(self).made += 1
        return TRUSTED + 1 if self.made == 1 else TRUSTED


class Closed(Brittle):
    def close(self):
        raise OSError("it is gone")


class Lies(Brittle):
    def step(self, action):
        return super().step(action) if self.lasts > 1 else [7]


class Once(Brittle):
    made = 0

    def __init__(self):
        super().__init__()
        type(self).made += 1
        if self.made > 1:
            raise MemoryError("no room for another")


@pytest.mark.parametrize(
    ("game", "steps", "text"),
    [
        (Again, 2 * TRUSTED + 1, "arena 0: RuntimeError: the roof fell in"),
        (Lies, 1200, r"arena 0: got \[7\], expected a TimeStep per agent"),
        (Once, 1200, "arena 0: MemoryError: no room for another"),
    ],
)
@pytest.mark.promise("F3")
def test_what_does_not_end_with_an_episode_ends_the_session(game, steps, text):
    arena = batched(game)({"roof": "weak"}, {}, 1, 0, 7)
    acts = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
    with pytest.raises(ArenaError, match=text):
        deque((arena.step(acts) for _ in range(steps)), maxlen=0)


def test_a_failed_game_that_cannot_be_closed_is_replaced(caplog):
    arena = batched(Closed)({"roof": "weak"}, {}, 1, 0, 7)
    acts = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
    assert sum(arena.step(acts)[0].interrupted is not None for _ in range(1200)) == 1
    assert "the failed game of arena 0 could not be closed" in caplog.text


# ------------------------------------------------------------------------------------------------------ over the wire


def cut_step(lanes: int, ended: list[int], interrupted: list[bool] | None) -> StepArrays:
    """Return a step of brittle in which some lanes were truncated."""
    flags = np.zeros(lanes, bool)
    flags[ended] = True
    step = StepArrays([np.zeros((lanes, 2), np.float32)], np.ones((lanes, 1), np.float32), np.zeros(lanes, bool), flags)
    step.ended = np.array(ended, np.int32)
    step.final_observations = [np.zeros((len(ended), 2), np.float32)]
    step.metrics = np.full((len(ended), 1), 60.0, np.float32)
    step.interrupted = None if interrupted is None else np.array(interrupted)
    return step


def test_who_was_interrupted_travels_and_only_what_is_truncated_can_be():
    codec = Codec(Brittle.describe({}).behaviors[0], 3, 0)
    message = pb.BehaviorStep()
    fill_step(message, cut_step(3, [0, 2], [False, True]))
    came = codec.unpack_step(message)
    assert came.interrupted is not None and came.interrupted.tolist() == [False, True]
    message.terminated.data, message.truncated.data = message.truncated.data, message.terminated.data
    with pytest.raises(TensorError, match=r"player\.ended\.interrupted: lane 2 is interrupted, but not truncated"):
        codec.unpack_step(message)


def test_who_was_interrupted_is_kept_when_sessions_are_joined_and_parted():
    (joined,) = join([[cut_step(2, [1], None)], [cut_step(2, [], None)], [cut_step(3, [0, 2], [True, False])]])
    assert joined.ended.tolist() == [1, 4, 6]
    assert joined.interrupted is not None and joined.interrupted.tolist() == [False, True, False]
    part = rows_of(joined, np.array([4, 5, 6]))
    assert part.interrupted is not None and part.interrupted.tolist() == [True, False]


# ------------------------------------------------------------------------------------------------------- to the learner


def test_an_interrupted_episode_is_counted_and_no_result():
    episodes = Episodes(3, ["depth"])
    step = cut_step(3, [0, 2], [False, True])
    episodes.add(step, step.rewards[:, 0])
    resumed = Episodes(3, ["depth"])
    resumed.load(episodes.state())
    row = resumed.summarize()
    assert (row["episodes"], row["interrupted"], row["depth"]) == (1, 1, 60.0)
    assert "1 episodes cut by errors of the game" in row_text(row)
    assert "  ahead 62%  " in row_text({**row, "ahead": 0.62})
    assert "interrupted" not in resumed.summarize()
    assert resumed.length.tolist() == [0, 1, 0]


def test_a_match_that_was_interrupted_is_played_again_by_the_same():
    spec = Duel.describe({})
    seats = Seats(spec, 2)
    for arena in range(2):
        seats.begin(arena, [arena] * seats.count)
    lanes = [behavior.agents_per_arena for behavior in spec.behaviors]
    steps = []
    for agents, behavior in zip(lanes, spec.behaviors, strict=True):
        step = cut_step(2 * agents, [*range(2 * agents)], [True] * agents + [False] * agents)
        step.rewards = np.zeros((2 * agents, len(behavior.channels)), np.float32)
        step.metrics = np.zeros((2 * agents, len(behavior.metrics)), np.float32)
        steps.append(step)
    assert [result.arena for result in seats.finish(steps)] == [1]
    seats.sit(steps)
    assert {*seats.holders(0)[: lanes[0]].tolist()} == {0}


@pytest.mark.promise("F3", "D2")
def test_a_training_goes_on_says_how_many_episodes_were_cut_and_ends_in_the_same_bits(simulator, tmp_path, caplog):
    arenas, decisions = 4, 1200
    config = Config(
        game="brittle",
        layout="hybrid",
        arenas=arenas,
        total_timesteps=arenas * decisions,
        log_interval=arenas * decisions // 4,
        policy=PolicyConfig(rollout_steps=100, time_horizon=100, minibatch_size=400, hidden_sizes=[8]),
    )
    for name in ("one", "other"):
        train(config, tmp_path / name, [simulator], resume=False, record_faults=name == "other")
    assert "whose episodes are cut and count as no results; see the simulator's log" in caplog.text
    rows = [read_rows(tmp_path / name / "metrics-player.csv") for name in ("one", "other")]
    counts = [[row.get("interrupted", 0) for row in each] for each in rows]
    assert counts[0] == counts[1] == [0, 0, 0, arenas]
    assert all(row["depth"] == 60.0 and row["length"] == 60.0 for row in rows[0])
    one, other = (load_checkpoint(tmp_path / name)[0] for name in ("one", "other"))
    assert all(array.tobytes() == other[name].tobytes() for name, array in one.items())
    fault = tmp_path / "other" / "faults" / "brittle-0-1.fault"
    with pytest.raises(FaultFound, match=r"step 1\d\d\d fails: the game failed in arenas \[[01]\]"):
        replay(simulator, load_recording(fault))
