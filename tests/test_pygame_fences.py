"""What a program written with pygame may not do, what is refused, and what a failure costs."""

import sys
from typing import Any

import numpy as np
import pytest

from joybridge.adapters.pygame_programs.inside.program import ProgramError, find_program
from joybridge.client.own_games import choose_game
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.catalog import CatalogError, load_game
from tests.support.programs import HEAD, LOOP, SHOW, opened, program, steps
from tools.chaos.process import wait_until
from tools.chaos.programs import MARK, marked


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("open('/nowhere', 'w')", "may write in its home, its working directory and beside itself only, not /nowhere"),
        ("pygame.image.save(screen, '/nowhere.png')", "not /nowhere.png"),
        ("import subprocess; subprocess.run(['true'])", "may not start or end processes"),
        ("import socket; socket.create_connection(('127.0.0.1', 9))", "may not use the network"),
        ("input()", "may not read standard input"),
        ("pygame.display.set_mode((64, 48), pygame.OPENGL)", "draws with OpenGL"),
        ("import moderngl", "moderngl needs OpenGL"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("raise ValueError('\\x1b]0;owned')", r"ValueError: \\x1b\]0;owned"),
    ],
)
def test_what_a_program_may_not_do_is_said_in_a_sentence(tmp_path, line, what):
    with pytest.raises(CatalogError, match=what):
        program(tmp_path, HEAD + line + "\n" + LOOP + SHOW)


def test_a_program_writes_below_its_home_and_beside_itself_without_a_trace(tmp_path):
    write = "pathlib.Path('score.txt').write_text('9')\n(pathlib.Path.home() / 'high.txt').write_text('9')\n"
    write += "(pathlib.Path.home() / 'a/b').mkdir(parents=True)\nshutil.rmtree(pathlib.Path.home() / 'a')\n"
    game: Any = program(tmp_path, "import pathlib, shutil\n" + HEAD + write + LOOP + SHOW)
    assert len(steps(game, 1)) == 1
    folder = game.processes.folder
    assert folder.exists()
    game.processes.end()
    assert not folder.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["program.py"]


SAVES = """
import os, pathlib, shutil
os.makedirs('saves/deep/new')
for path in ('saves/best.txt', 'saves/large.bin', 'saves/deep/a.txt', 'saves/deep/new/b.txt'):
    with open(path, 'a') as file: file.write('9')
assert open('saves/best.txt').read() == '79' and open('saves/other.txt').read() == '7'
os.rename('saves/best.txt', 'saves/old.txt')
up = '/..' * 4
for path in (f'saves{up}/x', 'elsewhere/x', 'saves/elsewhere/x', f'saves/deep/..{up}/x', 'saves/deep/link.txt'):
    try:
        open(path, 'w')
    except PermissionError:
        continue
    raise AssertionError(path)
"""


def test_a_program_writes_into_folders_beside_it_without_a_trace(tmp_path):
    (tmp_path / "saves/deep").mkdir(parents=True)
    outside = tmp_path.with_name(f"{tmp_path.name}-outside")
    outside.mkdir()
    for name, size in (("best.txt", 1), ("other.txt", 1), ("large.bin", 200_000), ("deep/a.txt", 1)):
        (tmp_path / "saves" / name).write_text("7" * size)
    (outside / "file").write_text("7")
    for link in (tmp_path / "elsewhere", tmp_path / "saves/elsewhere"):
        link.symlink_to(outside)
    (tmp_path / "saves/deep/link.txt").symlink_to(outside / "file")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    game: Any = program(tmp_path, HEAD + SAVES + LOOP + SHOW)
    assert len(steps(game, 1)) == 1
    game.processes.end()
    (tmp_path / "program.py").unlink()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert [path.name for path in outside.iterdir()] == ["file"] and (outside / "file").read_text() == "7"


def test_a_program_that_fails_after_an_episode_costs_the_running_one(tmp_path, caplog):
    switch = tmp_path.with_name(f"{tmp_path.name}-switch")  # on after the first play, which is at random
    line = f"    if pygame.key.get_pressed()[pygame.K_UP] and pathlib.Path('{switch}').exists(): 1 / 0\n"
    game = program(tmp_path, "import pathlib\n" + HEAD + LOOP + line + SHOW, "keys=UP mouse=false max_decisions=3")
    switch.touch()
    still, up = ([ActArrays(np.zeros((2, 0), np.float32), np.array([[0], [one]], np.int32))] for one in (0, 1))
    once = "arena 1: the program has failed: ZeroDivisionError"
    with opened(game, 2, decision_interval="1") as playing, pytest.raises(GameError, match=once):
        playing.step(up)  # in its first episode
    with opened(game, 2, decision_interval="1") as playing:
        for _ in range(3):
            playing.step(still)
        state = playing.save()
        (cut,) = playing.step(up)
        assert cut.ended.tolist() == [1] and cut.truncated.tolist() == [False, True]
        assert cut.interrupted is not None and cut.interrupted.tolist() == [True]
        assert "the program failed in arena 1 after" in caplog.text and "ZeroDivisionError" in caplog.text
        (after,) = playing.step(still)  # the other goes on, and the arena has begun anew
        assert after.ended.tolist() == [] and after.interrupted is None
        with pytest.raises(GameError, match=once):  # a second time without an end between
            playing.step(up)
    with opened(game, 2, decision_interval="1") as resumed:  # a resumed training does not end there for ever
        resumed.restore(state)
        assert resumed.step(up)[0].ended.tolist() == [1]


SAVES_BY_PLACE = """
import json, os, pathlib, shutil, sqlite3
from contextlib import closing
HERE = pathlib.Path(__file__).resolve().parent
for path in (HERE / 'scores.json', HERE / 'saves' / 'new.json', pathlib.Path(os.path.dirname(__file__), 'large.bin')):
    path.parent.mkdir(exist_ok=True)
    before = path.exists()
    path.open('a').write('9')
    assert before == (path.name == 'large.bin') and path.exists() and path.read_text().endswith('9')
    os.remove(path)
    assert not os.path.exists(path)
    open(file=path, mode='w').write('8')
(HERE / 'scores.tmp').write_text('7')
os.replace(HERE / 'scores.tmp', HERE / 'scores.json')
assert json.loads((HERE / 'scores.json').read_text()) == 7 and 'scores.json' in os.listdir(HERE)
pygame.image.save(pygame.Surface((2, 1)), HERE / 'shot.png')
assert pygame.image.load(HERE / 'shot.png').get_size() == (2, 1)
with closing(sqlite3.connect(HERE / 'scores.db')) as scores:
    scores.execute('create table scores (points)')
assert (HERE / 'scores.db').exists()
shutil.copy2(HERE / 'scores.json', HERE / 'scores.bak')
try:
    open(HERE / '..' / 'x', 'w')
except PermissionError:
    pass
else:
    raise AssertionError
"""


def test_a_program_saves_by_its_own_place_without_a_trace(tmp_path, monkeypatch):
    package = tmp_path / "packed"
    package.mkdir()
    (package / "__init__.py").touch()
    for folder, name in ((tmp_path, "program.py"), (package, "__main__.py")):
        (folder / name).write_text(HEAD + SAVES_BY_PLACE + LOOP + SHOW)
        (folder / "large.bin").write_text("7" * 200_000)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.syspath_prepend(tmp_path)
    for place in (tmp_path / "program.py", "packed"):
        game: Any = load_game(f"pygame:{place}")
        assert len(steps(game, 1)) == 1
        game.processes.end()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("exec('while True: pass')", "drew no frame in 0.3 s, at line 11 of .*program.py; seconds=1.8 allows it more"),
        ("os.kill", "the process of the program has crashed, at line 11 of .*program.py"),
        ("1 / 0", "arena 0: the program has failed: ZeroDivisionError: division by zero .line 11 of .*program.py"),
    ],
)
def test_a_program_that_hangs_or_fails_costs_its_session_a_sentence(tmp_path, line, what):
    line = "ctypes.string_at(0)" if line == "os.kill" else line
    body = "n = 0\n" + LOOP + f"    n += 1\n    if n > 200: {line}\n" + SHOW
    game = program(tmp_path, "import ctypes\n" + HEAD + body, "seconds=0.3")
    with pytest.raises(GameError, match=what):
        steps(game, 100)
    assert len(steps(game, 1)) == 1  # the program itself goes on


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("while True: pass", "no frame in 60 s, at line 7 of .*program.py: .*; start=180 allows it more"),
        ("ctypes.string_at(0)", "the process has ended with SIGSEGV, at line 7 of .*program.py"),
    ],
)
def test_a_program_that_never_begins_is_told_where_it_stands(tmp_path, line, what):
    soon = "signal.setitimer(signal.ITIMER_REAL, 0.1)\n"  # the alarm of the first frame, without the wait
    with pytest.raises(CatalogError, match=what):
        program(tmp_path, "import ctypes, signal\n" + HEAD + soon + line + "\n", "start=60")


@pytest.mark.promise("X7")
def test_nothing_of_a_program_that_stops_itself_or_has_forked_is_left(tmp_path, monkeypatch):
    monkeypatch.setenv(MARK, str(tmp_path))
    # The other process only waits: it must not read what the server says to this one.
    deeds = (
        "import ctypes, signal\nlibrary = ctypes.CDLL(None)\nif library.fork() == 0:\n    while True: library.pause()\n"
    )
    body = "n = 0\n" + LOOP + "    n += 1\n    if n > 200: signal.raise_signal(signal.SIGSTOP)\n" + SHOW
    game: Any = program(tmp_path, deeds + HEAD + body, "seconds=0.3")
    with pytest.raises(GameError, match=r"drew no frame in 0\.3 s"):
        steps(game, 100)
    assert marked(str(tmp_path))
    game.processes.end()
    assert wait_until(lambda: not marked(str(tmp_path)))


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ("keys=nothing", "got the key 'nothing'"),
        ("buttons=fourth", "got the button 'fourth'"),
        ("'reward=Score'", "has 0 groups"),
        ("'done=('", "no regular expression"),
        ("colour=red", "got colour=red, expected one of"),
        ("seconds=never", "got seconds=never, expected a number"),
    ],
)
def test_wrong_settings_are_refused(tmp_path, settings, what):
    with pytest.raises(CatalogError, match=what):
        program(tmp_path, HEAD + LOOP + SHOW, settings)


def test_a_program_that_is_not_there_is_refused():
    for place in ("nothing.py", "no_such_package"):
        with pytest.raises(CatalogError, match=f"there is no file.*{place}"):
            load_game(f"pygame:{place}")


def test_a_hook_that_is_not_there_is_named(tmp_path):
    with pytest.raises(CatalogError, match=r"there is no hook .*none\.py; its path is relative to the current folder"):
        program(tmp_path, HEAD + LOOP + SHOW, f"hook={tmp_path}/none.py")


def test_a_file_is_no_name_of_a_game():
    with pytest.raises(ConfigError, match=r"my\.py is a file: name a pygame program pygame:my\.py, and a game"):
        choose_game("my.py", (), None)


def test_a_program_that_draws_in_a_thread_is_refused(tmp_path):
    draw = "import threading\nthread = threading.Thread(target=pygame.display.flip)\nthread.start()\nthread.join()\n"
    with pytest.raises(CatalogError, match="the program draws in a thread"):
        program(tmp_path, HEAD + draw + LOOP + SHOW)


def test_a_package_without_scripts_is_refused_with_the_names_of_its_modules():
    with pytest.raises(CatalogError, match=r"'pillow' has no script; these modules run: PIL\..*; name one of them"):
        load_game("pygame:pillow")


def test_the_only_module_of_a_package_that_runs_is_its_program(tmp_path, monkeypatch):
    guard = "if __name__ == '__main__':\n    print('runs')\n"
    files = {"lonely/__init__.py": "", "lonely/play.py": guard, "lonely/parts.py": "", "test_lonely.py": guard}
    for name, text in {**files, "lonely-1.dist-info/METADATA": "Metadata-Version: 2.1\nName: lonely\n"}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    record = tmp_path / "lonely-1.dist-info" / "RECORD"
    record.write_text("".join(f"{name},,\n" for name in files))
    monkeypatch.setattr(sys, "argv", [])
    monkeypatch.syspath_prepend(tmp_path)
    found = find_program("lonely", [])
    assert (found.name, found.root) == ("lonely.play", tmp_path / "lonely" / "play.py")
    (tmp_path / "lonely" / "play.py").write_text("")
    with pytest.raises(ProgramError, match=r"has no script; its modules are: lonely\.parts, lonely\.play; name one of"):
        find_program("lonely", [])
