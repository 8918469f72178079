"""The command `joybridge` lists its commands, runs them, and names the extra that a command needs."""

import os
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import joybridge
from joybridge import cli
from joybridge.client.errors import SimulatorLost
from joybridge.client.launch import simulator_process
from joybridge.commands import export
from joybridge.contract.address import READY
from tests.support.wire import SECONDS


@pytest.mark.parametrize("arguments", [[], ["-h"], ["--help"]])
def test_without_a_command_or_with_help_it_lists_the_commands(arguments, monkeypatch, capsys):
    assert cli.main(arguments) == 0
    given = capsys.readouterr().out
    assert all(f"  {name} " in given for name in cli.commands())
    monkeypatch.setattr(sys, "argv", ["joybridge", *arguments])
    assert cli.main() == 0
    assert capsys.readouterr().out == given


def test_the_version_is_that_of_the_package(capsys):
    assert cli.main(["--version"]) == 0 and capsys.readouterr().out == f"joybridge {version('joybridge')}\n"


def test_an_unknown_command_is_refused_with_the_known_ones(capsys):
    assert cli.main(["trian"]) == 2
    assert "unknown command 'trian'; expected one of serve, list" in capsys.readouterr().err


def test_an_export_without_its_extra_is_refused_before_anything_starts(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(export, "find_spec", lambda name: None)
    assert cli.main(["export", str(tmp_path / "none"), "policy.onnx"]) == 2
    assert "needs the module onnx; install it with `pip install 'joybridge[export]'`" in capsys.readouterr().err


def test_a_command_whose_extra_is_missing_names_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)  # which makes importing it fail
    rooms = ("joybridge.commands", "joybridge.run", "joybridge.policy", "joybridge.ppo", "joybridge.demonstrations")
    for name in [name for name in sys.modules if name.startswith(rooms)]:
        room, _, _ = name.removeprefix("joybridge.").partition(".")
        monkeypatch.setattr(joybridge, room, getattr(joybridge, room, None))  # importing it anew replaces it
        monkeypatch.delitem(sys.modules, name)
    assert cli.main(["train", "archer/hybrid"]) == 2
    assert "needs the module torch; install it with `pip install 'joybridge[train]'`" in capsys.readouterr().err


WITHOUT = """
import sys
sys.modules |= dict.fromkeys(sys.argv[1].split(","))  # which makes importing them fail
from joybridge.cli import commands, main
for name in commands():
    try:
        main([name, "--help"])
    except SystemExit as end:
        assert not end.code, name
"""


def test_every_command_describes_itself_without_what_only_its_work_needs():
    extras = (
        "matplotlib,scipy,markdown_it,optuna,onnx,onnxruntime,minari,h5py,ray,gymnasium,pettingzoo,pygame,websockets,"
        "torch,pandas,wandb,mlflow,stable_baselines3"
    )
    told = subprocess.run([sys.executable, "-c", WITHOUT, extras], capture_output=True, text=True)
    assert (told.returncode, told.stderr) == (0, "")
    texts = told.stdout.split("usage: joybridge ")[1:]
    assert [text.split()[0] for text in texts] == [*cli.commands()]
    for text in texts:
        about = text.split("\n\n")[1]
        assert about[0].isupper() and about.endswith("."), text  # a sentence before the options says what it is for


def test_a_tournament_without_what_its_page_needs_is_refused_before_anything_starts(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.delitem(sys.modules, "joybridge.compare.rating_page", raising=False)
    assert cli.main(["rate", str(tmp_path / "none")]) == 2
    assert "needs the module matplotlib.figure; install it with" in capsys.readouterr().err


def test_the_installed_command_finds_games_of_the_current_folder(tmp_path):
    command = Path(sys.executable).with_name("joybridge")
    subprocess.run([command, "new", "near_game"], cwd=tmp_path, check=True, capture_output=True)
    listed = subprocess.run(
        [command, "list", "--game", "near_game:NearGame"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (listed.returncode, listed.stderr) == (0, "")
    assert listed.stdout.startswith("near_game: ")
    assert listed.stdout.count("\n  behavior ") == 1  # the other games are only named
    assert "served beside it: beastly_rivals, " in listed.stdout


def test_a_simulator_whose_games_are_not_installed_is_not_started(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(SimulatorLost, match=r"pip install 'joybridge\[simulator\]'"), simulator_process():
        pass


def test_a_command_whose_output_nobody_reads_any_more_ends_quietly():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer) as output:
        command = [sys.executable, "-m", "joybridge", "check", "--list"]
        result = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, check=False)
    assert (result.returncode, result.stderr) == (-signal.SIGPIPE, "")


INTERRUPTED = """
import os, signal, sys
import joybridge
from joybridge import cli
from joybridge.commands import export
from joybridge.contract.address import READY

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "joybridge.simulator.catalog":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
cli.main(["list"])
"""


def test_an_interrupt_while_a_command_is_imported_ends_it_without_a_traceback():
    result = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (-signal.SIGINT, "", "")


def test_a_server_works_and_ends_with_standard_error_closed():
    command = [sys.executable, "-m", "joybridge", "serve", "--address", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=lambda: os.close(2)) as process:
        assert process.stdout is not None and process.stdout.readline().startswith(READY)
        process.terminate()
        try:
            assert process.wait(SECONDS) == 0
        finally:
            process.kill()
