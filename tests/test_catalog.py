"""Which games a server offers and what `joybridge list` shows; each game that cannot be loaded names the next move."""

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from joybridge.cli import main
from joybridge.contract.errors import JoybridgeError
from joybridge.games import BUILT_IN
from joybridge.simulator.catalog import CatalogError, load_game, load_games
from joybridge.simulator.new_game.write import TEMPLATE, NewGameError

SCRIPT = Path(sys.executable).parent / "joybridge"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return tmp_path


def test_a_missing_numba_names_the_extra_that_installs_it(folder, monkeypatch):
    (folder / "needs_numba.py").write_text("import numba")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(sys.modules, "numba", None)  # Python then raises what it raises where numba is not installed
    with pytest.raises(CatalogError) as caught:
        load_game("needs_numba:Game")
    wanted = "game 'needs_numba:Game' needs the module numba; install it with `pip install 'joybridge[simulator]'`"
    assert str(caught.value) == wanted


def test_a_missing_module_of_the_author_is_named(folder, monkeypatch):
    (folder / "needs_more.py").write_text("import what_nobody_has")
    monkeypatch.syspath_prepend(folder)
    with pytest.raises(CatalogError, match=r"one of its own imports failed \(No module named 'what_nobody_has'\)"):
        load_game("needs_more:Game")


def test_a_game_that_exits_when_it_is_described_is_named(folder, monkeypatch):
    source = "from joybridge.simulator import Game\nclass Exits(Game):\n    name = 'exits'\n    description = 'Exit.'\n"
    (folder / "exits.py").write_text(source + "    @classmethod\n    def describe(cls, options): raise SystemExit(3)\n")
    monkeypatch.syspath_prepend(folder)
    with pytest.raises(CatalogError, match="game 'exits:Exits' cannot be described: SystemExit: 3"):
        load_game("exits:Exits")


@pytest.mark.parametrize("place", ["nowhere", "nowhere:Game", "nowhere.at_all:Game"])
def test_a_place_without_a_module_says_where_modules_are_looked_for(place):
    with pytest.raises(CatalogError, match="expected MODULE:CLASS, importable from the current folder"):
        load_game(place)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import what_nobody_has", "one of its own imports failed"),
        ("raise RuntimeError('no card \\x1b[2J')", r"raises RuntimeError when it is imported \(no card \\x1b\[2J\)"),
        ("import sys; sys.exit(0)", "raises SystemExit when it is imported"),
        ("from joybridge.simulator import Game\nclass Installed(Game): pass", "cannot be described: AttributeError"),
        ("from joybridge.games.orchard.game import Orchard\nclass Installed(Orchard): pass", "already a game named"),
        ("Installed = 3", "is not a subclass of"),
    ],
)
@pytest.mark.promise("X7")
def test_an_installed_package_that_is_broken_takes_only_itself_away(source, reason, folder, monkeypatch, caplog):
    (folder / "broken_package.py").write_text(source)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "broken_package", raising=False)
    point = EntryPoint("installed", "broken_package:Installed", "joybridge.games")
    monkeypatch.setattr("joybridge.simulator.catalog.entry_points", lambda group: [point])
    assert list(load_games()) == list(BUILT_IN)
    (record,) = caplog.records
    assert re.search(f"a game of an installed package is left out: .*{reason}", record.getMessage())
    with pytest.raises(CatalogError, match=reason.replace(r"\x1b", "\x1b")):  # asked for by name, it is the error
        load_games(["broken_package:Installed"])


def test_a_place_without_a_class_names_the_module_s_own(folder, monkeypatch):
    (folder / "classless.py").write_text("from joybridge.simulator import Game\nclass Fitts(Game):\n    name = 'fitts'")
    monkeypatch.syspath_prepend(folder)
    with pytest.raises(CatalogError, match="'classless' names no class; expected MODULE:CLASS, as in classless:Fitts"):
        load_game("classless")


def test_errors_of_the_simulator_side_are_joybridge_errors():
    assert issubclass(CatalogError, JoybridgeError) and issubclass(NewGameError, JoybridgeError)


def test_the_script_finds_games_in_the_current_folder(folder):
    (folder / "my_game.py").write_text((TEMPLATE / "my_game.py").read_text())
    result = subprocess.run(
        [SCRIPT, "list", "--game", "my_game:MyGame"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("my_game: Sail over the fish, then cast the net.\n")


def test_the_current_folder_is_not_searched_without_a_game_option(folder):
    (folder / "numba.py").write_text("raise SystemExit('a file of the user was imported')")
    result = subprocess.run([SCRIPT, "list"], cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_list_shows_options_parameters_sensors_actions_rewards_and_metrics(capsys):
    assert main(["list", "--game", "tests.support.games:Hybrid"]) == 0
    games = capsys.readouterr().out.split("\n\n")
    others = " ".join(games[1].split()).removeprefix("served beside it: ").partition(";")[0]
    assert len(games) == 2 and others.split(", ") == [*BUILT_IN]
    assert games[0].splitlines()[1:] == [
        "  time: a decision every 100 ms, episodes of at most 9 decisions",
        "  option size: small | large (default small)",
        "  option masks: on | off (default on)",
        "  parameter drift: 0 .. 2 (default 1)",
        "  behavior player: 1 agent per arena",
        "    sensors: place [2], count [1] int32, image [2, 2] uint8, lamps [3] bool",
        "    axes: x -1..1, force 0.5..2",
        "    branches: gear (low | middle | high), press (released | pressed)",
        "    rewards: gain (weight 1), cost (weight 0.5)",
        "    metrics: length, presses",
    ]


def test_list_alone_describes_every_game_within_the_width_of_a_terminal(capsys):
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert [game.split(":")[0] for game in printed.split("\n\n")] == [*BUILT_IN]
    assert max(map(len, printed.splitlines())) <= 120


def test_list_describes_the_games_that_are_named_and_says_which_there_are(capsys):
    assert main(["list", "ferry", "archer"]) == 0
    assert [game.split(":")[0] for game in capsys.readouterr().out.split("\n\n")] == ["ferry", "archer"]
    assert main(["list", "archer/hybrid"]) == 2
    assert (
        "`joybridge look` and `joybridge train` take configurations; games: beastly_rivals, " in capsys.readouterr().err
    )


def test_an_error_is_one_line_without_a_traceback(capsys):
    assert main(["list", "--game", "nowhere:Game"]) == 2
    assert re.fullmatch(r"error: game 'nowhere:Game' cannot be imported .*\n", capsys.readouterr().err)


def test_every_built_in_game_is_loaded_under_its_own_name():
    assert [game.name for game in load_games().values()] == list(BUILT_IN)


def test_games_that_are_given_come_first_so_doctor_looks_at_them():
    assert next(iter(load_games(["tests.support.games:Hybrid"]))) == "hybrid"


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        ([], "127.0.0.1:5005"),
        (["--port", "7"], "127.0.0.1:7"),
        (["--host", "::1"], "::1:5005"),
        (["--address", "unix:/tmp/one"], "unix:/tmp/one"),
    ],
)
def test_serve_takes_a_host_and_a_port(monkeypatch, arguments, place):
    served = []
    monkeypatch.setattr("joybridge.simulator.__main__._serve", lambda options: served.append(options.address))
    assert main(["serve", *arguments]) == 0 and served == [place]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--port", "99999"], "--host and --port: got '127.0.0.1:99999', expected HOST:PORT"),
        (["--address", "127.0.0.1:1", "--port", "7"], "--address already has a host and a port"),
    ],
)
def test_a_wrong_host_and_port_are_refused(capsys, arguments, text):
    with pytest.raises(SystemExit):
        main(["serve", *arguments])
    assert text in capsys.readouterr().err
