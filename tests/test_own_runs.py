"""Runs of strangers start nothing and call nobody; runs that this user has trained here play without an extra word."""

import json
import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from joybridge.client.own_runs import is_ours, key_file, sign
from joybridge.client.simulator_source import FILE, SimulatorSource, choose_simulators, last_simulators, remember
from joybridge.config.config import Config
from joybridge.config.errors import StorageError, UntrustedRunError
from tests.support.command_line import joybridge
from tests.support.games import PLACES
from tools.chaos.folders import new_run

TOKEN = "AKIAABCDEFGHIJKLMNOPQRSTUVWXYZ012345"
GAME = "stranger:Stranger"
PLACES_OF_STRANGERS = {
    "a program": "unity:player wait=2",
    "a module": GAME,
    "an environment of Gymnasium": "gym:stranger:Env-v0",
    "an environment of PettingZoo": "pettingzoo:stranger",
}
COMMANDS = {
    "evaluate": ("evaluate", "RUN", "--episodes", "1"),
    "record": ("record", "RUN", "play.gif", "--seconds", "1"),
    "export": ("export", "RUN", "policy.json"),
    "watch": ("watch", "RUN", "--no-browser"),
    "train --from": ("train", "orchard/hybrid", "--from", "RUN", "--run", "new", "total_timesteps=64"),
    "train --resume": ("train", "RUN/config.yaml", "--run", "RUN", "--resume"),
}

CLONE = {"clone --config": ("clone", "demos", "--config", "RUN/config.yaml")}


@pytest.fixture
def run(tmp_path, monkeypatch) -> Path:
    """Return a run in the current folder, which also has a program and a module that leave a file if they run."""
    monkeypatch.chdir(tmp_path)
    player = tmp_path / "player"
    player.write_text("#!/bin/sh\ntouch OWNED\n")
    player.chmod(0o700)
    (tmp_path / "stranger.py").write_text("open('OWNED', 'w').close()")
    new_run(tmp_path / "run")
    return Path("run")


@pytest.fixture
def spy() -> Iterator[tuple[str, socket.socket]]:
    """Yield an address at which nobody has called yet, and its socket."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.setblocking(False)
        yield f"127.0.0.1:{listening.getsockname()[1]}", listening


def noted(run: Path, **fields: object) -> None:
    """Write what a run says about its training, as anybody could."""
    (run / FILE).write_text(json.dumps(fields))


def chosen(run: Path, trust: bool = False) -> SimulatorSource:
    return choose_simulators(SimulatorSource(), last_simulators(run), Config(game="orchard"), print, trust=trust)


# ------------------------------------------------------------------------------------------- runs of strangers


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", PLACES_OF_STRANGERS)
def test_no_command_starts_what_a_run_of_a_stranger_names(command, kind, run):
    place = PLACES_OF_STRANGERS[kind]
    noted(run, games=[place])
    status, _, errors = joybridge(*(word.replace("RUN", "run") for word in COMMANDS[command]))
    assert status == 2
    assert f"error: run wants to start {place}, and you have not trained it on this machine" in errors
    assert errors.endswith("repeat the command with --trust-run\n") and "Traceback" not in errors
    assert {path.name for path in Path().iterdir()} == {"run", "player", "stranger.py"}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.promise("X3")
def test_no_command_calls_an_address_or_reads_a_file_that_a_run_of_a_stranger_names(command, run, spy):
    place, listening = spy
    Path("secret").write_text(TOKEN)
    Path("secret").chmod(0o600)
    noted(run, addresses=[place], token_file="secret")
    status, output, errors = joybridge(*(word.replace("RUN", "run") for word in COMMANDS[command]))
    assert status == 2 and f"run wants to connect to {place}, read secret, and you have not" in errors
    assert TOKEN not in output + errors
    with pytest.raises(BlockingIOError):
        listening.accept()


def test_the_configuration_of_a_run_of_a_stranger_names_no_module(run):
    (run / "config.yaml").write_text("game: stranger:Stranger\nlayout: hybrid\n")
    for command in ("train --resume", "clone --config"):
        status, _, errors = joybridge(*(word.replace("RUN", "run") for word in (COMMANDS | CLONE)[command]))
        assert status == 2 and "run wants to start stranger:Stranger, and you have not trained it" in errors
    assert not Path("OWNED").exists()


def test_what_a_run_of_a_stranger_names_cannot_write_to_the_terminal(run):
    noted(run, games=["\x1b]0;owned\x07:X"])
    assert r"start \x1b]0;owned\x07:X" in joybridge("evaluate", "run").errors


@pytest.mark.parametrize("signature", [None, "", "0" * 64, 7, ["x"], {"a": 1}, "ü", "\ud800"])
def test_no_signature_of_somebody_else_is_believed(signature, run):
    noted(run, games=[GAME], signature=signature)
    with pytest.raises(UntrustedRunError):
        chosen(run)


def test_a_trusted_run_may_start_what_it_names(run):
    noted(run, games=[GAME])
    assert chosen(run, trust=True) == SimulatorSource(games=(GAME,))
    status, _, errors = joybridge("evaluate", "run", "--trust-run")
    assert status == 1 and f"game {GAME!r}" in errors and Path("OWNED").exists()


def test_what_the_command_line_names_needs_no_trust(run, simulator):
    noted(run, games=[GAME])
    wanted = SimulatorSource((simulator,))
    assert choose_simulators(wanted, last_simulators(run), Config(game="orchard"), print) == wanted


@pytest.mark.parametrize(
    "fields", [{"addresses": ["nowhere"]}, {"addresses": ["h:99999"]}, {"games": [1]}, {"games": "a:B"}]
)
def test_notes_that_cannot_be_right_are_named(fields, run):
    noted(run, **fields)
    status, _, errors = joybridge("evaluate", "run")
    assert status == 1 and f"{run / FILE} cannot be read" in errors


# ------------------------------------------------------------------------------------------------- runs of one's own


def test_a_run_with_a_game_of_ones_own_plays_without_an_extra_word(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["arenas=4", "total_timesteps=64", "log_interval=64", "policy.hidden_sizes=[8]", "policy.frame_stack=1"]
    small += ["policy.rollout_steps=16", "policy.time_horizon=16", "policy.minibatch_size=32"]
    Path("hybrid.yaml").write_text("game: hybrid")
    trained = joybridge("train", "hybrid.yaml", *small, "--run", "run", *(f"--game={place}" for place in PLACES))
    assert trained.status == 0, trained.errors
    Path("run").rename("moved")
    again = joybridge("evaluate", "moved", "--episodes", "1")
    assert again.status == 0, again.errors


def moved(run: Path) -> Path:
    return run.rename("elsewhere")


def copied(run: Path) -> Path:
    return Path(shutil.copytree(run, "copy"))


def linked(run: Path) -> Path:
    Path("link").symlink_to(run)
    return Path("link")


def read_only(run: Path) -> Path:
    (run / FILE).chmod(0o400)
    run.chmod(0o500)
    return run


def named_absolutely(run: Path) -> Path:
    return run.resolve()


@pytest.mark.parametrize("change", [moved, copied, linked, read_only, named_absolutely])
def test_a_run_of_ones_own_is_believed_wherever_it_is(change, run):
    remember(run, SimulatorSource(games=(GAME,)), print)
    assert chosen(change(run)) == SimulatorSource(games=(GAME,))


def edited(run: Path) -> Path:
    (run / FILE).write_text((run / FILE).read_text().replace(GAME, "worse:Game"))
    return run


def with_an_address_more(run: Path) -> Path:
    notes = json.loads((run / FILE).read_text())
    (run / FILE).write_text(json.dumps(notes | {"addresses": ["127.0.0.1:1"]}))
    return run


def of_an_older_version(run: Path) -> Path:
    notes = json.loads((run / FILE).read_text())
    del notes["signature"]
    (run / FILE).write_text(json.dumps(notes))
    return run


def beside_another_module(run: Path) -> Path:
    download = Path("download")
    download.mkdir()
    shutil.copytree(run, download / "run")
    os.chdir(download)
    return run


def with_the_key_of_another_user(run: Path) -> Path:
    key_file().unlink()
    sign(b"a run of the other user")
    return run


def after_the_key_was_lost(run: Path) -> Path:
    key_file().unlink()
    return run


CHANGES = [edited, with_an_address_more, of_an_older_version, beside_another_module, with_the_key_of_another_user]


@pytest.mark.parametrize("change", [*CHANGES, after_the_key_was_lost])
def test_a_run_that_others_can_have_made_is_not_believed(change, run, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    remember(run, SimulatorSource(games=(GAME,)), print)
    assert chosen(run) == SimulatorSource(games=(GAME,))
    with pytest.raises(UntrustedRunError, match="--trust-run"):
        chosen(change(run))


def test_what_does_not_lie_in_the_current_folder_is_believed_from_any_folder(run, monkeypatch, tmp_path):
    simulators = SimulatorSource(games=("gym:CartPole-v1 sutton_barto_reward=True", f"unity:{tmp_path}/player"))
    remember(run, simulators, print)
    run = run.resolve()
    monkeypatch.chdir("/")
    assert chosen(run) == simulators


# --------------------------------------------------------------------------------------------------------- the key


@pytest.fixture
def key(monkeypatch, tmp_path) -> Path:
    """Return where a key will be made."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return key_file()


def test_the_key_is_made_once_and_for_this_user_alone(key):
    signature = sign(b"content")
    assert key.stat().st_mode & 0o777 == 0o600 and key.parent.stat().st_mode & 0o777 == 0o700
    assert sign(b"content") == signature and is_ours(b"content", signature)
    assert not is_ours(b"another", signature) and [path.name for path in key.parent.iterdir()] == ["key"]


def test_a_question_makes_no_key(key):
    assert not is_ours(b"content", "0" * 64) and not key.parent.exists()


def readable_by_others(key: Path) -> None:
    key.chmod(0o644)


def a_link(key: Path) -> None:
    key.rename(key.with_name("other"))
    key.symlink_to("other")


def a_pipe(key: Path) -> None:
    key.unlink()
    os.mkfifo(key, 0o600)


def too_short(key: Path) -> None:
    key.write_bytes(b"0" * 31)


@pytest.mark.parametrize("change", [readable_by_others, a_link, a_pipe, too_short])
def test_a_key_that_others_may_know_is_refused_by_name(change, key):
    sign(b"content")
    change(key)
    for use in (lambda: sign(b"content"), lambda: is_ours(b"content", "0" * 64)):
        with pytest.raises(StorageError, match=f"{key}.*delete it"):
            use()


def test_without_a_place_for_the_key_a_run_is_remembered_as_nobodys(run, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    said: list[str] = []
    remember(run, SimulatorSource(games=(GAME,)), said.append)
    assert "cannot write" in said[0] and "--trust-run only" in said[0]
