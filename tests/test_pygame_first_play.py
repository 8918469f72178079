"""A program is played before it is first served; what was found out is kept for the next start."""

import os
from pathlib import Path
from typing import Any

import pytest

from joybridge.adapters.pygame_programs import first_play, remembered
from joybridge.adapters.pygame_programs.inside import scan
from joybridge.simulator.catalog import load_game
from tests.support.servers import ROOT

CATCHING = ROOT / "tests/support/pygame_programs/catch.py"
SHORT = r"snapshots=false keys=LEFT 'reward=Score: (\d+)'"  # of which little is to be found out


@pytest.fixture
def plays(tmp_path, monkeypatch):
    """Return a list with an entry per first play, of programs that nobody has served before."""
    found: list[object] = []

    def noted(*arguments):
        found.append(arguments)
        return first_play.first_play(*arguments)

    monkeypatch.setattr(remembered, "first_play", noted)
    monkeypatch.setattr(first_play, "TEXT_SECONDS", 600.0)  # also on a slow machine
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return found


def served(path, settings=""):
    """Serve a program and return what was found out about it."""
    game: Any = load_game(f"pygame:{path} {settings}")
    game.processes.end()
    return game.description, game.look, game.frame_seconds, game.exact


def kept():
    return list((Path(os.environ["XDG_CACHE_HOME"]) / "joybridge/first_plays").iterdir())


def test_a_program_is_played_before_it_is_first_served_and_again_when_it_has_changed(tmp_path, plays):
    program = tmp_path / "catch.py"
    program.write_text(CATCHING.read_text())
    first = served(program)
    assert first[2] == pytest.approx(0.02) and first[3]
    assert served(program) == first
    assert len(plays) == len(kept()) == 1
    program.write_text(CATCHING.read_text().replace("clock.tick(50)", "clock.tick(25)"))
    assert served(program)[2] == pytest.approx(0.04)
    assert len(plays) == len(kept()) == 2


def test_other_settings_and_hooks_are_played_for_themselves(tmp_path, plays):
    hook = tmp_path / "hook.py"
    for text in ("def state(program): return [1.0]\n", "def state(program): return [1.0, 2.0]\n"):
        hook.write_text(text)
        served(CATCHING, f"snapshots=false keys=LEFT hook={hook}")
    assert not served(CATCHING, f"snapshots=false keys=RIGHT hook={hook}")[3]
    assert len(plays) == 3


def test_a_damaged_memory_of_a_first_play_is_written_anew(plays):
    first = served(CATCHING, SHORT)
    (path,) = kept()
    whole = path.read_bytes()
    for content in (b"", b"[1]", b'{"read": 1, "frame_seconds": 1, "exact": true, "numbers": []}'):
        path.write_bytes(content)
        assert served(CATCHING, SHORT) == first
        assert path.read_bytes() == whole
    assert len(plays) == 4


def test_without_a_place_for_it_nothing_is_kept(tmp_path, plays, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert served(CATCHING, SHORT) == served(CATCHING, SHORT)
    assert len(plays) == 2


def test_rewards_and_ends_that_match_nothing_are_named_with_the_texts_that_were_seen(plays, caplog):
    wrong = r"'reward=score: (\d+)' reward=attr:main.none reward=sound:none.wav 'done=Game over'"
    settings = f"snapshots=false keys=LEFT 'reward=Score: (\\d+)' {wrong}"
    for ends in (1, 0):  # the second time from what is kept
        caplog.clear()
        served(CATCHING, settings)
        said = [text for *_, text in caplog.record_tuples]
        nothing = "matched nothing in 200 decisions of random play; texts seen (case counts): 'Score: 0'"
        assert said == [
            rf"catch: reward 'score: (\d+)', reward 'attr:main.none', reward 'sound:none.wav' {nothing}",
            *[f"catch: done 'Game over' {nothing.replace('; texts', ', and may come later; texts')}"] * ends,
        ]
    assert len(plays) == 1


def test_an_end_that_was_rendered_before_the_first_frame_alone_is_explained(tmp_path, plays, caplog):
    program = tmp_path / "catch.py"
    once = "over = font.render('Game over', True, 'white')"
    program.write_text(CATCHING.read_text().replace("while lives > 0:", f"{once}\n    while lives > 0:"))
    served(program, "snapshots=false keys=LEFT 'done=Game over'")
    ((*_, said),) = caplog.record_tuples
    assert "catch: done 'Game over' (rendered before the first frame; a text that is shown again and not" in said
    assert "matched nothing in 200 decisions" in said


def test_a_program_that_fails_when_it_is_played_keeps_its_numbers_and_is_named(tmp_path, plays, caplog):
    program = tmp_path / "catch.py"
    program.write_text(CATCHING.read_text().replace("score += 10", "score += 10 // (score < 20)"))
    description = served(program, "snapshots=false keys=LEFT")[0]
    assert "Numbers in its texts that may be rewards: 'reward=^Score: (-?\\d+)' (0 to 20)." in description
    ((*_, said),) = caplog.record_tuples
    assert "decisions of random play, arena 0: the program has failed: ZeroDivisionError" in said


def test_the_sources_of_joybridge_are_not_those_of_a_program_in_a_folder_above():
    found = scan._files(ROOT / "game.py")
    assert ROOT / "game.py" in found and not [path for path in found if "joybridge" in path.parts]
