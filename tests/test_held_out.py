"""During training, policies are measured under other settings of the game; that is a curve of its own."""

import shutil

import pytest

from joybridge.client.client import describe
from joybridge.config.config import Config, make_config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.errors import JoybridgeError
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.held_out import OTHER_SEED, HeldOut
from joybridge.run.train import train
from joybridge.run.training import Audience

SMALL = PolicyConfig(frame_stack=1, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)


def short(simulator, run, said=None, resume=False, **settings):
    given = {"game": "hybrid", "arenas": 4, "total_timesteps": 512, "log_interval": 64, "policy": SMALL} | settings
    say = (lambda text: None) if said is None else said.append
    train(Config(**given), run, [simulator], resume=resume, audience=Audience(say=say))
    return {path.stem.removeprefix("metrics-"): read_rows(path) for path in run.glob("metrics-*.csv")}


@pytest.fixture(scope="module")
def measured(simulator, tmp_path_factory):
    run = tmp_path_factory.mktemp("held_out") / "run"
    during = {"every": 128, "episodes": 10, "parameters": {"drift": 0.0}}
    return run, short(simulator, run, evaluate_during=during)


def test_held_out_settings_have_columns_of_their_own_every_so_often(measured):
    _, rows = measured
    assert [row["timesteps"] for row in rows["player"] if "held_out_reward" in row] == [128, 256, 384, 512]
    last = rows["player"][-1]
    assert last["held_out_episodes"] == 10 and {"held_out_length", "held_out_presses"} <= set(last)
    assert last["held_out_length"] > last["length"]  # without drift nobody leaves


def test_without_every_the_last_row_is_measured_and_the_most_probable_actions_are_those_of_evaluate(
    simulator, tmp_path
):
    during = {"episodes": 10, "deterministic": True}
    rows = short(simulator, tmp_path / "run", total_timesteps=500, evaluate_during=during)["player"]
    assert [row["timesteps"] for row in rows if "held_out_reward" in row] == [512] == [rows[-1]["timesteps"]]
    rows = short(simulator, tmp_path / "whole", evaluate_during=during)["player"]
    plays = PlaySpec(tmp_path / "whole", simulator, seed=OTHER_SEED, deterministic=True)
    found = evaluate(plays, episodes=10, say=lambda text: None)["player"]
    assert rows[-1]["held_out_reward"] == pytest.approx(found.means["reward"], rel=1e-5)


def test_of_a_curriculum_the_last_lesson_is_played(simulator, tmp_path):
    lessons = [
        {"parameters": {"drift": 2.0}, "until": {"metric": "reward", "above": 100.0}},
        {"parameters": {"drift": 0}},
    ]
    during = {"episodes": 10, "deterministic": True}
    row = short(simulator, tmp_path / "run", evaluate_during=during, curriculum=lessons)["player"][-1]
    assert row["lesson"] == 1 and row["held_out_length"] > row["length"]  # without drift nobody leaves


@pytest.mark.parametrize(("log_interval", "every"), [(64, 192), (64, 5000), (100, 300), (100, None)])
def test_the_last_row_has_the_measure_of_the_policy_at_the_end_whatever_every_says(
    log_interval, every, simulator, tmp_path
):
    said: list[str] = []
    during = {"episodes": 10, "deterministic": True, "every": every}
    rows = short(simulator, tmp_path, said, log_interval=log_interval, evaluate_during=during)["player"]
    assert [line.endswith(", at the end") for line in said if "held out" in line] == [True]
    plays = PlaySpec(tmp_path, simulator, seed=OTHER_SEED, deterministic=True)
    found = evaluate(plays, episodes=10, say=lambda text: None)["player"]
    assert rows[-1]["held_out_reward"] == pytest.approx(found.means["reward"], rel=1e-5)
    measures = [row["timesteps"] for row in rows if "held_out_reward" in row]
    assert measures == ([192, 384] if every == 192 else [300] if every == 300 else []) + [rows[-1]["timesteps"]]


def test_a_policy_that_is_measured_at_the_end_is_not_measured_again(simulator, tmp_path):
    said: list[str] = []
    short(simulator, tmp_path, said, evaluate_during={"every": 256, "episodes": 2})
    assert not any("at the end" in line for line in said)


def test_measuring_changes_nothing_that_is_learned(measured, simulator, tmp_path):
    run, _ = measured
    short(simulator, tmp_path / "plain")
    arrays, plain = load_checkpoint(run)[0], load_checkpoint(tmp_path / "plain")[0]
    assert all((arrays[name] == plain[name]).all() for name in plain if "/network." in name)


def test_a_resumed_run_measures_when_one_does_that_never_stopped(measured, simulator, tmp_path):
    _, whole = measured
    during = {"every": 128, "episodes": 10, "parameters": {"drift": 0.0}}
    short(simulator, tmp_path / "run", evaluate_during=during, stop_at=192)
    rows = short(simulator, tmp_path / "run", evaluate_during=during, resume=True)
    measured_at = [[row["timesteps"] for row in one["player"] if "held_out_reward" in row] for one in (whole, rows)]
    assert measured_at[0] == measured_at[1]


def test_the_last_measure_is_that_of_evaluate_within_chance(measured, simulator, tmp_path):
    run, rows = measured
    run = shutil.copytree(run, tmp_path / "run")
    plays = PlaySpec(run, simulator, seed=3, overrides=["parameters.drift=0"])
    found = evaluate(plays, episodes=200, say=lambda text: None)["player"]
    half_width = found.half_widths["reward"] * (200 / 10) ** 0.5
    assert abs(rows["player"][-1]["held_out_reward"] - found.means["reward"]) < 3 * half_width


def test_every_behavior_is_measured_and_told(simulator, tmp_path):
    said: list[str] = []
    rows = short(simulator, tmp_path, said, game="duel", evaluate_during={"every": 64, "episodes": 3})
    assert all("held_out_reward" in row for one in rows.values() for row in one if "reward" in row)
    assert {name: one[-1]["held_out_episodes"] for name, one in rows.items()} == {"runner": 6, "judge": 3}
    told = [line for line in said if line.lstrip().startswith("judge: reward")]
    assert told and "held out" in told[-1]


@pytest.mark.parametrize(
    ("during", "message"),
    [
        (
            {"every": 64, "options": {"size": "large"}},
            "they change sensors, device or metrics of player, so its policy",
        ),
        ({"every": 64, "options": {"size": "huge"}}, "option 'size' got 'huge'"),
        ({"every": 64, "parameters": {"wind": 1.0}}, "evaluate_during.parameters.wind: "),
        ({"every": 64, "parameters": {"drift": 99.0}}, "evaluate_during.parameters.drift: "),
    ],
)
def test_settings_that_cannot_be_played_are_refused_before_anything_is_learned(during, message, simulator, tmp_path):
    with pytest.raises(JoybridgeError, match=message):
        short(simulator, tmp_path / "run", evaluate_during=during)
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_other_behaviors_than_in_training_are_named(simulator):
    spec = describe(simulator, "hybrid", {})
    spec.behaviors.add(name="another")
    config = make_config({"game": "hybrid", "evaluate_during": {"episodes": 3}})
    with pytest.raises(ConfigError, match=r"evaluate_during.options: they change which behaviors there are"):
        HeldOut(config, spec, simulator)
