"""Training games as strangers write them: nothing hangs, lies, or writes where it should not."""

import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.commands.replay import main as replay
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError, DivergedError
from joybridge.config.metrics import metrics_name, read_rows
from joybridge.contract.codec import ActArrays
from joybridge.play import record as recording
from joybridge.play.playing import PlaySpec
from joybridge.play.record import SLOWEST, record
from joybridge.policy.policy import Policy
from joybridge.policy.stratify import balanced_options
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.progress import Display
from joybridge.run.train import train
from joybridge.run.training import Audience
from joybridge.simulator.game_adapter import batched
from joybridge.v1 import bridge_pb2 as pb
from tests.support.awkward_games import LENGTH, Thrifty

pytestmark = pytest.mark.slow

SMALL = {"hidden_sizes": [8], "rollout_steps": 4, "time_horizon": 4, "minibatch_size": 8, "frame_stack": 2}


@pytest.fixture(scope="module")
def awkward() -> Iterator[str]:
    with simulator_process(
        ["tests.support.awkward_games:Talkative", "tests.support.awkward_games:Generous"]
    ) as address:
        yield address


def config(game: str, stop: int, **policy: object) -> Config:
    intervals = {"log_interval": 60, "checkpoint_interval": 36}
    return Config.model_validate({"game": game, "arenas": 3, "stop_at": stop, "policy": SMALL | policy, **intervals})


@pytest.fixture(scope="module")
def talked(awkward, tmp_path_factory) -> Path:
    """Return a run of a game without snapshots that was stopped in the middle of episodes."""
    run = tmp_path_factory.mktemp("talked") / "run"
    with Display("run talkative", "hybrid", 324, 0) as display:
        train(config("talkative", 324), run, [awkward], resume=False, audience=Audience(display.report))
    return run


def test_a_game_that_prints_is_heard_and_not_waited_for_for_ever(monkeypatch):
    # Not pytest's capture: what is written between its read and its truncation would be lost.
    heard = io.StringIO()
    monkeypatch.setattr(sys, "stderr", heard)
    with simulator_process(["tests.support.awkward_games:Talkative"]) as address:
        session = Session(address, "talkative", arenas=4, seed=0)
        for _ in range(40):  # 320 kB: more than a pipe holds
            session.step([ActArrays(np.zeros((4, 0), np.float32), np.zeros((4, 1), np.int32))])
        deadline = time.monotonic() + 30
        while "x" * 2000 not in heard.getvalue():  # while it plays, not only at the end
            assert time.monotonic() < deadline
        session.close()
    assert "a game may print before its simulator listens" in heard.getvalue()
    assert heard.getvalue().count("x" * 2000) == 160


def test_names_from_the_wire_are_neither_paths_nor_the_trainers_own_columns(talked):
    assert {path.name for path in talked.iterdir()} == {
        "config.yaml",
        "spec.json",
        "origin.json",
        "metrics-..%2Fred%2Fleft.csv",
        "tensorboard",
        "checkpoints",
    }
    assert [path.name for path in (talked / "tensorboard").iterdir()] == ["..%2Fred%2Fleft"]
    row = read_rows(talked / "metrics-..%2Fred%2Fleft.csv")[-1]
    assert (row["length"], row["game_length"], row["speed [/]"]) == (LENGTH, LENGTH, 1.0)


@pytest.mark.parametrize("name", ["..", ".", "...", "/", "a/../b", "\0"])
def test_no_name_of_a_policy_leads_out_of_its_folder(name):
    assert not {"/", "\0"} & set(metrics_name(name)) and metrics_name(name).strip(".")


def test_a_resumed_game_without_snapshots_begins_new_episodes(talked, awkward, monkeypatch):
    seen, act = [], Policy.act

    def spy(self, steps, acts, group=0):
        shown = self.actor.encoder.frames(steps[self.actor.behavior].observations)
        seen.append((self.rollout.present(group).numbers.copy(), shown.copy()))
        act(self, steps, acts, group)

    monkeypatch.setattr(Policy, "act", spy)
    train(config("talkative", 600), talked, [awkward], resume=True)
    stack, shown = seen[0]
    np.testing.assert_array_equal(stack, np.concatenate([np.zeros_like(shown), shown], axis=1))
    lengths = [row["length"] for row in read_rows(talked / "metrics-..%2Fred%2Fleft.csv")]
    assert len(lengths) == 10
    assert set(lengths) == {LENGTH}  # no two halves of episodes were taken for one


@pytest.mark.parametrize(("inputs", "height"), [(False, 74), (True, 134)])
def test_an_odd_picture_can_be_recorded(inputs, height, talked, awkward, tmp_path):
    output = tmp_path / "play.mp4"
    frames = record(PlaySpec(talked, awkward, seed=0), output, seconds=1.0, say=lambda _: None, inputs=inputs)
    with av.open(str(output)) as video:
        assert [picture.to_ndarray(format="rgb24").shape for picture in video.decode(video=0)] == [
            (height, 100, 3)
        ] * frames


def test_an_episode_whose_last_decision_has_no_frame_is_recorded_to_its_end(talked, awkward, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "FASTEST", SLOWEST / 2)  # every other decision, of five
    said: list[str] = []
    plays = PlaySpec(talked, awkward, seed=0)
    assert record(plays, tmp_path / "play.mp4", episodes=1, say=said.append) == LENGTH // 2
    assert not any("no episode has ended" in text for text in said)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_network_that_is_no_longer_finite_ends_the_run_before_it_is_saved_and_can_be_replayed(
    awkward, tmp_path, capsys
):
    text = (
        r"after update 15, the network of player is no longer finite \(.*value_loss nan, .*"
        r"parameters .*actor\.head\.weight.*smaller learning_rate"
    )
    with pytest.raises(DivergedError, match=text) as caught:
        train(config("generous", 600), tmp_path, [awkward], resume=False, record_faults=True)
    arrays, manifest = load_checkpoint(tmp_path)
    assert 150 < manifest.timesteps < 200
    assert all(np.isfinite(array).all() for name, array in arrays.items() if "/network." in name)
    assert replay(["replay", str(tmp_path / "faults/generous-0-1.fault"), "--simulator", awkward]) == 0
    said = capsys.readouterr()
    assert f"the fault was: {caught.value}\n" in said.err
    assert "60 steps are as they were recorded, and none fails" in said.out


def test_the_end_of_an_episode_is_seen_though_the_next_one_is_written_into_the_same_arrays():
    game = batched(Thrifty)({}, {}, 2, 0, 0)
    press = [ActArrays(np.zeros((2, 0), np.float32), np.zeros((2, 1), np.int32))]
    *_, (step,) = [game.step(press) for _ in range(3)]
    assert step.final_observations is not None and step.metrics is not None
    assert step.final_observations[0].tolist() == [[3.0, 3.0]] * 2 and step.metrics.tolist() == [[3.0]] * 2
    assert step.observations[0].tolist() == [[0.0, 0.0]] * 2


def test_a_rollout_in_which_all_wait_teaches_nothing_and_ends_nothing(simulator, tmp_path):
    train(config("duel", 240), tmp_path, [simulator], resume=False)
    rows = read_rows(tmp_path / "metrics-judge.csv")
    assert len(rows) == 4
    assert all(np.isfinite(value) for row in rows for value in row.values())
    assert any("policy_loss" in row for row in rows)


def test_what_evaluation_cannot_balance_is_refused_before_training(simulator, tmp_path):
    chosen = config("hybrid", 60).model_copy(update={"stratify_by": "levle"})
    with pytest.raises(ConfigError, match="stratify_by: hybrid has no option 'levle'"):
        train(chosen, tmp_path, [simulator], resume=False)


def test_an_option_without_alternatives_cannot_be_balanced():
    spec = pb.GameSpec(name="one", options=[pb.Option(name="rules", choices=["all"], default_choice="all")])
    with pytest.raises(ConfigError, match="option 'rules' of one has no choice but its default"):
        balanced_options(config("one", 60).model_copy(update={"stratify_by": "rules"}), spec)
