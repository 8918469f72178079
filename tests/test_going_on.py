"""A run goes on from what another one has learned, keeps its best state, and says how long it has taken."""

import re
import shlex
import threading

import numpy as np
import pytest

import joybridge.run.train as training
from joybridge.cli import main
from joybridge.config.metrics import read_rows
from joybridge.run.checkpoint import checkpoints, has_checkpoint, load_checkpoint
from joybridge.run.folder import run_config

pytestmark = pytest.mark.usefixtures("signals")

SMALL = [
    "arenas=4",
    "total_timesteps=640",
    "log_interval=128",
    "policy.frame_stack=1",
    "policy.hidden_sizes=[8]",
    "policy.rollout_steps=16",
    "policy.time_horizon=16",
    "policy.minibatch_size=32",
]
WEIGHT = "player/policy/network.actor.hidden.0.weight"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("going_on") / "hybrid.yaml"
    path.write_text("game: hybrid")
    return path


@pytest.fixture(scope="module")
def trained(config, simulator):
    run = config.with_name("trained")
    assert main(["train", str(config), *SMALL, "--run", str(run), "--simulator", simulator]) == 0
    return run


def test_a_run_begins_with_the_weights_of_another_and_keeps_its_name(trained, config, simulator, tmp_path, capsys):
    run = tmp_path / "next"
    more = ["policy.learning_rate=1e-12", "parameters.drift=0.5", "total_timesteps=64"]
    new = ["--run", str(run), "--simulator", simulator]
    assert main(["train", str(config), *SMALL, *more, "--from", str(trained), *new]) == 0
    printed = capsys.readouterr()
    assert f"begins with the policies of {trained} after 640 timesteps\n" in printed.out
    assert printed.err.endswith(f"next: joybridge evaluate {run}\n")
    before, after = (load_checkpoint(one)[0] for one in (trained, run))
    np.testing.assert_allclose(after[WEIGHT], before[WEIGHT], atol=1e-6)
    assert (int(after["player/policy/updates"]), run_config(run).weights_from) == (1, str(trained))


def test_a_run_stops_after_some_minutes_and_goes_on(config, simulator, tmp_path, capsys, monkeypatch):
    run, places = tmp_path / "run", ["--simulator", simulator]

    class Soon(threading.Timer):
        """A timer that ends with the first checkpoint, however long that takes."""

        def __init__(self, seconds, function):
            assert seconds == 720
            super().__init__(0.0, function)

        def run(self):
            while not has_checkpoint(run):
                self.finished.wait(0.01)
            super().run()

    monkeypatch.setattr("joybridge.commands.train.Timer", Soon)
    more = ["total_timesteps=1000000000", "checkpoint_interval=64", "--minutes", "12", "--run", str(run)]
    assert main(["train", str(config), *SMALL, *more, *places]) == 0
    errors = capsys.readouterr().err
    (done,) = re.findall(r"saved at ([\d,]+) timesteps; continue with: joybridge train .* --resume", errors)
    assert "interrupted" not in errors and errors.endswith(f"next: joybridge evaluate {run}\n")
    end = int(done.replace(",", "")) + 64
    again = ["train", f"{run}/config.yaml", f"stop_at={end}", "--minutes", "720", "--run", str(run), "--resume"]
    monkeypatch.undo()
    assert main([*again, *places]) == 0 and int(checkpoints(run)[-1].name) == end


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["policy.hidden_sizes=[9]"], "player: the trained network does not fit: hidden_sizes was [8], now [9]"),
        (["policy.activation=relu"], "player: the trained network does not fit: activation was swish, now relu"),
        (["options.size=large"], "the sensors had 10 numbers, now 16 (place 2, count 1, image 10, lamps 3)"),
        (["layout=multiagent"], "trained has no policy 'axes'; it has player"),
    ],
)
def test_what_does_not_fit_is_named(more, message, trained, config, simulator, tmp_path, capsys):
    new = ["--run", str(tmp_path / "next"), "--simulator", simulator]
    assert main(["train", str(config), *SMALL, *more, "--from", str(trained), *new]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "was", "now"),
    [("image_encoder", "auto", "impala"), ("shared_encoder", "True", "False"), ("frame_differences", "False", "True")],
)
def test_a_network_with_other_convolutions_is_neither_resumed_nor_gone_on_from(
    key, was, now, simulator, tmp_path, capsys
):
    config, run = tmp_path / "kick.yaml", tmp_path / "run"
    config.write_text("game: kick")
    command = ["train", str(config), *SMALL, "policy.frame_stack=2", "--simulator", simulator]
    assert main([*command, "--run", str(run)]) == 0
    other = f"policy.{key}={now.lower()}"
    assert main([*command, other, "--from", str(run), "--run", str(tmp_path / "next")]) == 1
    message = f"kicker: the trained network does not fit: {key} was {was}, now {now}\n"
    assert message.lower() in capsys.readouterr().err.lower()
    assert main([*command, other, "--run", str(run), "--resume"]) == 1
    refusal = capsys.readouterr().err
    assert refusal.startswith(f"error: cannot resume {run}: policy.{key} was ") and "policy.gamma" not in refusal


def test_a_run_that_is_not_there_is_refused_before_a_simulator_is_waited_for(config, tmp_path, capsys):
    new = ["--run", str(tmp_path / "next"), "--simulator", "127.0.0.1:1"]
    assert main(["train", str(config), *SMALL, "--from", str(tmp_path / "gone"), *new]) == 1
    errors = capsys.readouterr().err
    assert "gone holds no checkpoint" in errors and "waiting" not in errors


def test_a_run_whose_last_checkpoint_is_damaged_says_from_where_it_goes_on(config, simulator, tmp_path, capsys):
    command = ["train", str(config), *SMALL, "checkpoint_interval=128", "--run", str(tmp_path / "run")]
    assert main([*command, "--simulator", simulator, "stop_at=256"]) == 0
    (checkpoints(tmp_path / "run")[-1] / "arrays.safetensors").write_bytes(b"")
    capsys.readouterr()
    assert main([*command, "--simulator", simulator, "stop_at=384", "--resume"]) == 0
    assert "128 of 384 timesteps done" in capsys.readouterr().out


def test_the_best_checkpoint_is_that_of_the_best_row_and_can_be_played(trained, simulator, capsys):
    rows = read_rows(trained / "metrics-player.csv")
    best = max(rows, key=lambda row: row["reward"])
    manifest = load_checkpoint(trained, "best")[1]
    assert manifest.score == pytest.approx(best["reward"], rel=1e-4)
    assert manifest.timesteps == best["timesteps"]
    for which, timesteps in (("best", best["timesteps"]), ("640", 640)):
        assert main(["evaluate", str(trained), "--checkpoint", which, "--episodes", "4", "--simulator", simulator]) == 0
        assert f"episodes after {timesteps:,.0f} timesteps" in capsys.readouterr().out
    assert main(["record", str(trained), "play.mp4", "--checkpoint", "9", "--simulator", simulator]) == 1
    assert re.search(r"has no checkpoint '9'; it has .*640, best\n", capsys.readouterr().err)


def test_a_lengthened_run_goes_on_counting_and_gives_up_its_best_only_for_a_better_one(trained, simulator, capsys):
    before, best = read_rows(trained / "metrics-player.csv"), load_checkpoint(trained, "best")[1]
    again = ["--run", str(trained), "--resume", "--simulator", simulator]
    assert main(["train", str(trained / "config.yaml"), "total_timesteps=896", *again]) == 0
    assert "is lengthened from 640 to 896 timesteps: learning rate" in capsys.readouterr().err
    rows = read_rows(trained / "metrics-player.csv")
    assert [row["timesteps"] for row in rows] == [128 * number for number in range(1, 8)]
    assert rows[: len(before)] == before
    seconds = [row["seconds"] for row in rows]
    assert seconds == sorted(seconds) and seconds[0] > 0
    later = load_checkpoint(trained, "best")[1]
    assert later.score is not None and best.score is not None
    assert later == best if max(row["reward"] for row in rows[5:]) < best.score else later.score > best.score


def test_the_lowest_value_may_be_the_best_and_an_unknown_metric_is_refused(config, simulator, tmp_path, capsys):
    run = ["--run", str(tmp_path / "run"), "--simulator", simulator]
    assert main(["train", str(config), *SMALL, "best_metric=pressed", *run]) == 1
    wanted = "best_metric: there is no metric 'pressed'; player has reward, length, game_length, presses"
    assert wanted in capsys.readouterr().err
    for wrong in ("held_out_reward", "entropy_nothing", "loss_mine"):
        assert main(["train", str(config), *SMALL, f"best_metric={wrong}", *run]) == 1
        assert f"there is no metric '{wrong}'" in capsys.readouterr().err
    assert main(["train", str(config), *SMALL, "best_metric=-presses", *run]) == 0
    rows = read_rows(tmp_path / "run/metrics-player.csv")
    score = load_checkpoint(tmp_path / "run", "best")[1].score
    assert score == pytest.approx(-min(row["presses"] for row in rows), rel=1e-4)


def test_a_run_that_ended_before_its_first_checkpoint_begins_anew_with_its_game_and_says_so(
    config, tmp_path, monkeypatch, capsys
):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    config = config.with_name("own.yaml")
    config.write_text("game: hybrid")
    run = ["--run", str(tmp_path / "run"), "--game", "tests.support.games:Hybrid"]
    with monkeypatch.context() as patch:
        patch.setattr(training, "collect", interrupted)
        assert main(["train", str(config), *SMALL, *run]) == 130
    command = capsys.readouterr().err.partition("nothing is saved yet; begin again with: joybridge ")[2].splitlines()[0]
    assert "--resume" in command and "--game" not in command
    assert main([*shlex.split(command), "stop_at=64"]) == 0
    assert f"{tmp_path / 'run'} ended before anything was saved, so it starts over\n" in capsys.readouterr().err
    assert load_checkpoint(tmp_path / "run")[1].timesteps == 64
    new = ["--run", str(tmp_path / "next"), "--from", str(tmp_path / "run")]  # which knows where its game is
    assert main(["train", str(config), *SMALL, "stop_at=64", *new]) == 0


def test_what_is_odd_in_the_first_rollouts_is_said_once(config, simulator, tmp_path, capsys):
    more = ["policy.reward_weights.gain=1e4", "total_timesteps=192"]
    assert main(["train", str(config), *SMALL, *more, "--run", str(tmp_path / "run"), "--simulator", simulator]) == 0
    assert capsys.readouterr().out.count("player: a decision is rewarded with up to ±") == 1


def test_the_time_to_wait_for_an_answer_may_differ_from_the_training(trained, simulator, capsys):
    assert main(["evaluate", str(trained), "--simulator", simulator, "--timeout", "1e-6"]) == 1
    assert "has not answered for 4e-06 s" in capsys.readouterr().err
    assert main(["evaluate", str(trained), "--simulator", simulator, "--timeout", "60", "--episodes", "2"]) == 0
