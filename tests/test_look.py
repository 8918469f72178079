"""`joybridge look`: pictures of random play beside what was pressed."""

import re
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.commands.contact_sheet import MARGIN, PANEL, PICTURE, Line, Tile, write_sheet
from joybridge.commands.look import random_play

RED = (208, 80, 32)  # a marker


def pixels(path):
    with Image.open(path) as image:
        return np.asarray(image)


def test_a_game_of_ones_own_is_drawn_without_a_server_and_with_the_extra_simulator_alone(tmp_path):
    script = """
import sys
from joybridge.cli import main
assert main(["look", "my_pond:MyPond", "out/look.png", "--pictures", "4"]) == 0
assert not {"torch", "pydantic", "ruamel"} & set(sys.modules)
"""
    assert main(["new", "my_pond", "--folder", str(tmp_path)]) == 0
    done = subprocess.run(
        [sys.executable, "-P", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (
        done.stdout
        == "out/look.png: 4 pictures of my_pond, one every 3 decisions\nSail over the fish, then cast the net.\n"
    )
    sheet = pixels(tmp_path / "out/look.png")
    assert sheet.shape[1] == 3 * (PICTURE + PANEL + 3 * MARGIN)
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 100


@pytest.mark.usefixtures("signals")
def test_the_game_of_a_configuration_is_shown_with_its_settings(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program = "import pygame\npygame.init()\nscreen = pygame.display.set_mode((80, 60))\nwhile True:\n"
    program += "    pygame.event.get()\n    screen.fill('red')\n    pygame.display.flip()\n"
    Path("red.py").write_text(program)
    Path("red.yaml").write_text("game: {pygame: red.py, keys: UP}\noptions: {screen: '48', decision_interval: '2'}\n")
    assert main(["look", "red.yaml", "look.png", "--pictures", "1"]) == 0
    assert capsys.readouterr().out.startswith("look.png: 1 pictures of red, one every ")
    Path("two.yaml").write_text("games: {archer: {}, marble: {}}\n")
    assert main(["look", "two.yaml", "look.png"]) == 1
    assert "expected the name of one game" in capsys.readouterr().err


@pytest.mark.parametrize(("game", "every"), [("archer", 3), ("noughts", 1), ("ferry", 1), ("hybrid", 2)])
def test_random_play_obeys_masks_and_shows_what_was_pressed(simulator, game, every):
    with Session(simulator, game, arenas=1, seed=3) as session:
        tiles = list(islice(random_play(session, every, seed=1), 40))
        again = Session(simulator, game, arenas=1, seed=3)
        assert [tile.lines for tile in islice(random_play(again, every, seed=1), 5)] == [t.lines for t in tiles[:5]]
        again.close()
    assert len({tile.picture.tobytes() for tile in tiles}) > 5
    for behavior in session.spec.behaviors:
        names = [axis.name for axis in behavior.device.axes] + [branch.name for branch in behavior.device.branches]
        assert all(any(line.text.startswith(name) for tile in tiles for line in tile.lines) for name in names)
    assert [tile.lines[0].text for tile in tiles[:2]] == [f"decision {every}", f"decision {2 * every}"]


def test_what_stands_beside_a_picture_is_what_the_game_got(simulator, monkeypatch):
    sent = []
    step_and_draw = Session.step_and_draw

    def recorded(session, acts, draw):
        sent.append(acts[0].axes[0].tolist())
        return step_and_draw(session, acts, draw)

    monkeypatch.setattr(Session, "step_and_draw", recorded)
    with Session(simulator, "hybrid", arenas=1, seed=0) as session:
        (tile,) = islice(random_play(session, 1, seed=5), 1)
    (x, force) = sent[0]
    assert (
        Line(f"x {x:+.2f}", (x + 1) / 2) in tile.lines
        and Line(f"force {force:+.2f}", (force - 0.5) / 1.5) in tile.lines
    )


def test_a_sheet_shows_pictures_and_scales(tmp_path):
    pictures = [np.full((10, 20, 3), 40 * number, np.uint8) for number in range(4)]
    write_sheet([Tile(picture, [Line("stick", 0.25)]) for picture in pictures], tmp_path / "sheet.png")
    sheet = pixels(tmp_path / "sheet.png")
    width, height = PICTURE + PANEL + 3 * MARGIN, 160 + 2 * MARGIN
    assert sheet.shape == (2 * height, 3 * width, 3)
    corners = [(0, 0), (0, width), (0, 2 * width), (height, 0)]
    assert [sheet[y + MARGIN + 80, x + MARGIN + 160].tolist() for y, x in corners] == [[40 * n] * 3 for n in range(4)]
    marked = np.argwhere((sheet[:height, :width] == RED).all(axis=2))
    assert abs(marked[:, 1].mean() - (PICTURE + 2 * MARGIN + PANEL / 4)) < 1


def test_at_an_address_the_game_is_chosen_by_name(simulator, tmp_path, capsys):
    path = tmp_path / "look.png"
    assert main(["look", simulator, str(path)]) == 1
    assert "archer" in (error := capsys.readouterr().err) and error.endswith("; choose one with --game\n")
    assert main(["look", simulator, str(path), "--game", "hybrid", "--pictures", "1"]) == 0
    assert pixels(path).shape[1] == PICTURE + PANEL + 3 * MARGIN


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ["--game", "duel", "look.png"],
            "error: duel cannot be drawn: its spec has no picture; if the game is yours, give it",
        ),
        (["--game", "archer", "look.what"], "cannot write look.what: .*; choose a path that ends in .png"),
        (["--game", "chess", "look.png"], "no game named 'chess'"),
        (["--game", "hybrid", "look.png", "options.size=huge"], "option 'size' got 'huge', expected one of "),
        (
            ["--game", "hybrid", "look.png", "options.drift=1"],
            "it is a parameter of hybrid; write parameters.drift=VALUE",
        ),
        (["--game", "hybrid", "look.png", "layout=hybrid"], "layout cannot be set here; what can is written options"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(simulator, tmp_path, monkeypatch, capsys, arguments, text):
    monkeypatch.chdir(tmp_path)
    assert main(["look", simulator, *arguments]) == 1
    (error,) = capsys.readouterr().err.splitlines()
    assert re.search(text, error)


def test_a_game_is_drawn_under_options_and_parameters(simulator, tmp_path):
    paths = [tmp_path / f"{name}.png" for name in ("usual", "same", "other")]
    settings = ["parameters.drift=1", "options.masks=on"], ["parameters.drift=1", "options.masks=off"]
    for path, more in zip(paths, ([], *settings), strict=True):
        assert main(["look", simulator, "--game", "hybrid", str(path), "--seed", "5", *more]) == 0
    usual, same, other = (path.read_bytes() for path in paths)
    assert usual == same != other


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["archer", "look.png", "--game", "archer"], "--game belongs to the address of a running simulator"),
        (["archer", "look.png", "--pictures", "0"], "argument --pictures: got '0', expected an integer of at least 1"),
        (["archer", "look.png", "--seed", "-1"], "argument --seed: got '-1', expected an integer in 0.."),
    ],
)
def test_wrong_arguments_are_named(capsys, arguments, text):
    with pytest.raises(SystemExit):
        main(["look", *arguments])
    assert text in capsys.readouterr().err
