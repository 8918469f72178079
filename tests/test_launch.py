"""A simulator as a child process: it starts in any folder, and ends with the block."""

import pytest

from joybridge.client import launch
from joybridge.client.client import SimulatorLost, describe, list_games, wait_for
from joybridge.client.launch import simulator_process
from tests.support.command_line import joybridge

GAME = """
from joybridge.games.marble.game import Marble as BuiltIn
class MyGame(BuiltIn):
    name = "mine"
"""


def test_a_configuration_names_the_class_of_its_game(tmp_path):
    config, run = tmp_path / "hybrid.yaml", tmp_path / "run"
    config.write_text("game: tests.support.games:Hybrid\ntotal_timesteps: 64\narenas: 2\npolicy: {rollout_steps: 16}\n")
    trained = joybridge("train", str(config), "--run", str(run))
    assert trained.status == 0, trained.errors
    assert "game: hybrid\n" in (run / "config.yaml").read_text()
    assert joybridge("evaluate", str(run), "--episodes", "2").status == 0
    refused = joybridge("train", str(config), "game=tests.support.games:Chess")
    assert refused.status == 1 and "'tests.support.games:Chess' cannot be imported" in refused.errors


def test_files_of_the_current_folder_do_not_take_the_place_of_installed_modules(tmp_path, monkeypatch):
    for name in ("joybridge", "tests"):
        (tmp_path / name).mkdir()
    for name in ("joybridge/__init__", "tests/__init__", "trainer", "simulator", "tools", "random", "asyncio", "grpc"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported from the current folder')")
    monkeypatch.chdir(tmp_path)
    with simulator_process() as address:
        assert describe(address, "marble", {}).name == "marble"


def test_games_are_found_in_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "my_games.py").write_text(GAME)
    monkeypatch.chdir(tmp_path)
    with simulator_process(["my_games:MyGame"]) as address:
        assert describe(address, "mine", {}).name == "mine"


def test_the_simulator_ends_with_the_block():
    with pytest.raises(LookupError), simulator_process() as address:
        raise LookupError(list_games(address))
    with pytest.raises(SimulatorLost, match="nothing listens there"):
        wait_for(address, 0.0, lambda text: None)


def test_a_simulator_that_takes_long_to_start_is_announced_once(monkeypatch, capsys):
    monkeypatch.setattr(launch, "SILENCE_SECONDS", 0.0)
    with simulator_process() as address:
        assert address
    assert capsys.readouterr().err.count(launch.WAITING) == 1


def test_a_simulator_that_does_not_start_raises_its_own_message(capfd):
    expected = "the simulator did not start: game 'nowhere:Nothing' cannot be imported"
    with pytest.raises(SimulatorLost, match=expected), simulator_process(["nowhere:Nothing"]):
        pass
    assert "nowhere:Nothing" not in capfd.readouterr().err  # it is said once, by the exception
