"""Rows of metrics go where `log_to` says; the real packages are tried by `python -m tools.check_sinks`."""

import logging
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from joybridge.cli import main
from joybridge.config.config import Config
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.run.sinks import SINKS
from joybridge.run.train import train
from joybridge.run.training import Audience
from tools.check_sinks import main as check

SMALL = PolicyConfig(frame_stack=1, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)


def short(simulator, run, **settings):
    config = Config(game="hybrid", arenas=4, total_timesteps=128, log_interval=64, policy=SMALL, **settings)
    train(config, run, [simulator], resume=False, audience=Audience(say=lambda text: None))
    return read_rows(run / "metrics-player.csv")


def test_without_sinks_a_run_has_its_csv_alone(simulator, tmp_path):
    assert len(short(simulator, tmp_path, log_to=[])) == 2
    assert not (tmp_path / "tensorboard").exists()


@pytest.mark.parametrize("broken", ["__init__", "write", "close"])
def test_a_sink_that_fails_is_given_up_with_a_warning_and_the_run_goes_on(
    broken, simulator, tmp_path, monkeypatch, caplog
):
    told = []

    class Far:
        def __init__(self, *_):
            fail("__init__")

        def write(self, *_):
            fail("write")

        def close(self):
            fail("close")

    def fail(where):
        told.append(where)
        if where == broken:
            raise ConnectionError("nobody answers\nfor long")

    monkeypatch.setitem(SINKS, "wandb", Far)
    with caplog.at_level(logging.WARNING, "joybridge.trainer"):
        assert len(short(simulator, tmp_path, log_to=["wandb", "tensorboard"])) == 2
    wanted = "log_to: wandb failed and gets no more rows (ConnectionError: nobody answers)"
    assert [record.getMessage() for record in caplog.records] == [wanted]
    assert told[-1] == broken and told.count(broken) == 1
    assert list((tmp_path / "tensorboard" / "player").glob("events*"))


def test_a_tensorboard_that_does_not_fit_the_other_packages_is_given_up_with_a_warning(
    simulator, tmp_path, monkeypatch, caplog
):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)  # importing it raises an ImportError
    with caplog.at_level(logging.WARNING, "joybridge.trainer"):
        assert len(short(simulator, tmp_path)) == 2
    (record,) = caplog.records
    assert record.getMessage().startswith("log_to: tensorboard failed and gets no more rows (ModuleNotFoundError: ")


@pytest.mark.usefixtures("signals")
def test_a_sink_that_is_not_installed_names_its_extra(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "mlflow", None)
    command = ["train", "archer/hybrid", "log_to=[mlflow]", "--run", str(tmp_path), "--simulator", "127.0.0.1:1"]
    assert main(command) == 1
    assert (
        "log_to: mlflow is not installed; install it with `pip install 'joybridge[mlflow]'`" in capsys.readouterr().err
    )


def test_mlflow_gets_names_that_it_takes(tmp_path, monkeypatch):
    client = MagicMock()
    client.create_run.return_value.info.run_id = "abc"
    monkeypatch.setitem(sys.modules, "mlflow", SimpleNamespace(MlflowClient=lambda **_: client))
    sink = SINKS["mlflow"](tmp_path, "player", 0, Config(game="hybrid"))
    sink.write(64, {"reward": 1.0, "entropy_action[0]": 2.0, "50%": 3.0})
    assert [call.args[1:] for call in client.log_metric.call_args_list] == [
        ("reward", 1.0),
        ("entropy_action_0_", 2.0),
        ("50_", 3.0),
    ]


def test_a_resumed_run_is_the_same_one_to_weights_and_biases_and_a_new_one_is_not(tmp_path, monkeypatch):
    package = MagicMock()
    monkeypatch.setitem(sys.modules, "wandb", package)
    for name in ("WANDB_MODE", "WANDB_API_KEY", "WANDB_BASE_URL"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "netrc").write_text("machine api.wandb.ai login user password secret")
    (tmp_path / "netrc").chmod(0o600)
    for login, mode in (("none", "offline"), ("netrc", "online")):
        monkeypatch.setenv("NETRC", str(tmp_path / login))
        for after in (0, 64, 0):
            SINKS["wandb"](tmp_path, "player", after, Config(game="hybrid"))
        calls = [call.kwargs for call in package.init.call_args_list[-3:]]
        assert {call["mode"] for call in calls} == {mode}
        first, resumed, new = [call["id"] for call in calls]
        assert (first == resumed) == (mode == "online") and new not in (first, resumed)


@pytest.mark.nightly
def test_the_real_packages_get_every_row_offline():
    assert check([]) == 0
