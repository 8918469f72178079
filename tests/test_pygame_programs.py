"""Programs written with pygame as games: they run as they are, with exact seeds, snapshots, rewards and fences."""

import hashlib
import io
import json
import re
import shlex
import shutil
from argparse import Namespace
from contextlib import closing, redirect_stderr
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from joybridge.client.client import Session
from joybridge.client.command_line import add_own_game
from joybridge.client.errors import SimulatorLost
from joybridge.client.own_games import choose_game
from joybridge.commands import drive
from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from joybridge.config.programs import programs_of
from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.layouts import make_acts
from joybridge.policy.config_fit import find_and_load
from joybridge.progress import Progress
from joybridge.simulator.__main__ import main
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.catalog import CatalogError, load_game
from joybridge.simulator.listing import listing
from tests.support.command_line import joybridge
from tests.support.servers import ROOT, server
from tools.chaos.process import wait_until
from tools.chaos.programs import MARK, marked

CATCHING = ROOT / "tests/support/pygame_programs/catch.py"
CATCH = f"{CATCHING} 'reward=Score: (\\d+)'"
KEYS = "written with pygame. Keys in its sources: LEFT, RIGHT; that it was seen to read: LEFT, RIGHT."
SPEC = r"""catch: .*
  option decision_interval: 4 | 1 | 2 | 8 | 12 | 16 (default 4)
  option screen: 64 | 48 | 84 | 128 (default 64)
  option colors: rgb | gray (default rgb)
  option pointer: position | velocity (default position)
  option fovea: none | 32 | 64 (default none)
  behavior player: 1 agent per arena
    sensors: screen [55, 74, 3] RGB
    axes: pointer_x -1..1 (position, to the right), pointer_y -1..1 (position, up)
    branches: mouse_left (released | pressed [Mouse0]), key_LEFT (released | pressed [ArrowLeft]), key_RIGHT (released |
        pressed [ArrowRight])
    rewards: score (weight 1)"""


@pytest.fixture(scope="module")
def catch():
    game: Any = load_game(f"pygame:{CATCH}")
    yield game
    game.processes.end()


def opened(game, arenas=1, seed=0, **options):
    chosen = choose_options(game.options, options, game.name)
    return closing(game(chosen, {}, arenas, 0, seed))


def program(tmp_path, source, settings=""):
    """Return the game of a program with this source."""
    path = tmp_path / "program.py"
    path.write_text(source)
    return load_game(f"pygame:{path} {settings}")


def random_act(game, rng, arenas=1):
    device = game.describe(choose_options(game.options, {}, game.name)).behaviors[0].device
    choices = [[rng.integers(len(branch.choices)) for branch in device.branches] for _ in range(arenas)]
    axes = rng.uniform(-1, 1, (arenas, len(device.axes)))
    return [ActArrays(axes.astype(np.float32), np.array(choices, np.int32).reshape(arenas, -1))]


def played(playing, game, decisions, rng, arenas=1):
    """Return a hash of everything that some random decisions give, and the reward."""
    digest, reward = hashlib.sha256(), 0.0
    for _ in range(decisions):
        (step,) = playing.step(random_act(game, rng, arenas))
        for array in (*step.observations, step.rewards, step.terminated, step.truncated):
            digest.update(array.tobytes())
        reward += step.rewards.sum()
    digest.update(playing.draw(arenas - 1).tobytes())
    return digest.hexdigest(), reward


def test_the_spec_says_what_the_program_reads_and_shows(catch):
    spec = catch.describe(choose_options(catch.options, {}, catch.name))
    first, *rest = listing([spec]).splitlines()
    assert first.startswith("catch: ") and rest == SPEC.splitlines()[1:]
    assert spec.tick_seconds == pytest.approx(1 / 50)
    assert (spec.picture.width, spec.picture.height) == (320, 240)


def test_the_same_seed_and_decisions_give_the_same_bytes(catch):
    hashes = []
    for seed in (1, 1, 2):
        with opened(catch, 2, seed) as playing:
            hashes.append(played(playing, catch, 60, np.random.default_rng(0), 2))
    assert hashes[0] == hashes[1] != hashes[2]
    assert hashes[0][1] > 0  # something was caught, and its text was read


def test_the_frames_of_a_decision_are_those_of_decisions_of_a_frame_each(catch):
    acts = [random_act(catch, np.random.default_rng(seed)) for seed in range(5)]
    shown: dict[int, list[Any]] = {}
    for interval in (4, 1):
        shown[interval] = frames = []
        with opened(catch, seed=3, decision_interval=str(interval)) as playing:
            playing.drawn_by_tick = 0
            for act in (act for act in acts for _ in range(4 // interval)):
                playing.step(act)
                frames += [*playing.tick_pictures, playing.draw(0)]
    assert np.array_equal(shown[4], shown[1]) and len(shown[4]) == 20
    assert all((one != next_one).any() for one, next_one in pairwise(shown[4]))


def test_an_arena_is_the_same_alone_and_among_others(catch):
    act = random_act(catch, np.random.default_rng(3))
    with opened(catch, 3) as three:
        (among,) = three.step([ActArrays(*(np.repeat(part, 3, 0) for part in (act[0].axes, act[0].choices)))])
    for arena in range(3):
        options = choose_options(catch.options, {}, catch.name)
        with closing(catch(options, {}, 1, arena, 0)) as alone:
            (step,) = alone.step(act)
        assert np.array_equal(step.observations[0][0], among.observations[0][arena])


def test_a_snapshot_continues_like_the_original_over_2000_frames(catch):
    rng = np.random.default_rng(5)
    with opened(catch) as original, opened(catch) as forked, opened(catch) as repeated:
        played(original, catch, 40, rng)
        state = original.save()
        forked.restore(state)
        catch.processes.forget_branches()
        repeated.restore(state)
        results = {played(one, catch, 500, np.random.default_rng(6)) for one in (original, forked, repeated)}
    assert len(results) == 1


HEAD = "import pygame\npygame.init()\nscreen = pygame.display.set_mode((64, 48))\nclock = pygame.time.Clock()\n"
LOOP = "while True:\n    events = pygame.event.get()\n    pygame.mouse.get_pos()\n"
SHOW = "    pygame.display.flip()\n    clock.tick(60)\n"


def still(game):
    """Return an act in which nothing is pressed and the pointer stays in the middle."""
    device = game.describe(choose_options(game.options, {}, game.name)).behaviors[0].device
    return [ActArrays(np.zeros((1, len(device.axes)), np.float32), np.zeros((1, len(device.branches)), np.int32))]


def steps(game, count, **options):
    with opened(game, **options) as playing:
        return [playing.step(still(game))[0] for _ in range(count)]


def test_sounds_variables_and_text_pay_each_in_its_own_channel(tmp_path):
    body = "n = 0\ntone = pygame.mixer.Sound('tone.wav')\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    font.render(f'gold {2 * n}', True, 'white')\n    tone.play() if n % 2 else None\n"
    (tmp_path / "tone.wav").write_bytes(bytes(1000))
    game = program(
        tmp_path, HEAD + body + SHOW, r"reward=sound:tone reward=attr:n 'reward=gold (\d+)' max_decisions=50"
    )
    first, second = steps(game, 2)
    assert first.rewards.tolist() == second.rewards.tolist() == [[2.0, 4.0, 8.0]]


def test_several_channels_are_metrics_too_each_with_what_it_paid_in_the_episode(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    for score in (n, -n): font.render(f'score {score}', True, 'white')\n"
    rewards = r"'reward=score (\d+)' 'reward=score (-\d+)' max_decisions=3"
    game = program(tmp_path, HEAD + body + SHOW, rewards)
    names = game.look.metrics
    _, second, third = steps(game, 3)
    assert names == ["score_total", "score_2_total"]
    assert second.metrics is None and third.metrics.tolist() == [[12.0, -12.0]]


def test_two_scores_that_look_alike_are_told_apart_by_their_place_in_the_frame(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    for score in (n, 10 * n): font.render(f'{score:>4}', True, 'white')\n"
    rewards = r"""'reward=text1:^ *(\d+)$' 'reward=text2:^ *(\d+)$'"""
    game = program(tmp_path, HEAD + body + SHOW, rewards)
    assert [step.rewards.tolist() for step in steps(game, 2)] == [[[4.0, 40.0]]] * 2
    assert game.look.channels == ["reward", "reward_2"]
    unasked = program(tmp_path, HEAD + body + SHOW)
    for reward in rewards.strip("'").split("' '"):
        assert f"'{reward}' (" in unasked.description


def test_buttons_are_found_where_the_program_passes_them_on(tmp_path):
    body = "def pressed(pos, button):\n    return button == 1 or button == 3\n" + LOOP
    body += "    for e in events:\n        if e.type == pygame.MOUSEBUTTONDOWN: pressed(e.pos, e.button)\n"
    assert program(tmp_path, HEAD + body + SHOW, "snapshots=false").look.buttons == ["left", "right"]


def test_a_rendered_text_or_the_end_of_the_program_ends_the_episode(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    for line, settings in (
        ("    if n == 6: font.render('Game over', True, 'white')\n", "'done=Game over'"),
        ("    if n == 6: break\n", ""),
        ("    if n == 6: pygame.quit(); raise SystemExit\n", ""),
    ):
        game = program(tmp_path, HEAD + body + "    n += 1\n" + line + SHOW, settings)
        ends = [(step.terminated[0], step.truncated[0]) for step in steps(game, 3)]
        assert ends == [(False, False), (True, False), (False, False)]


def test_an_episode_is_truncated_at_its_longest(tmp_path):
    ends = [bool(step.truncated[0]) for step in steps(program(tmp_path, HEAD + LOOP + SHOW, "max_decisions=2"), 4)]
    assert ends == [False, True, False, True]


def test_a_hook_of_the_page_presses_the_key_of_a_menu_in_each_episode(tmp_path):
    page = (ROOT / "docs/pygame-programs.md").read_text()
    hook = page.partition("**A menu before the game**")[2].partition("```python\n")[2].partition("```")[0]
    (tmp_path / "menu_hook.py").write_text(hook)
    menu = "pygame.font.init()\nshown = 'menu'\n" + LOOP
    menu += "    shown = 'game' if any(e.type == pygame.KEYDOWN for e in events) else shown\n"
    menu += "    pygame.font.Font(None, 12).render(f'{shown} {int(shown == \"game\")}', True, 'red')\n"
    settings = f"hook={tmp_path}/menu_hook.py 'reward=^\\w+ (\\d+)' keys=LEFT mouse=false max_decisions=3"
    game = program(tmp_path, HEAD + menu + SHOW, settings)
    with opened(game) as playing:
        still = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
        assert [playing.step(still)[0].rewards.sum() for _ in range(6)] == [1, 0, 0, 1, 0, 0]


def test_a_hook_finds_what_only_a_running_function_has(tmp_path):
    hook = tmp_path / "lives_hook.py"
    hook.write_text(
        "from joybridge.adapters.hooks import look_up\n"
        "def state(program):\n"
        "    return [look_up('main.lives') or 0, look_up('main.nobody') is None]\n"
        "def done(program):\n"
        "    return look_up('main.lives') == 18\n"
    )
    with opened(load_game(f"pygame:{CATCHING} hook={hook} keys=LEFT mouse=false")) as playing:
        still = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
        steps = [playing.step(still)[0] for _ in range(400)]
    seen = {tuple(step.observations[1][0].tolist()) for step in steps}
    assert seen == {(20.0, 1.0), (19.0, 1.0)} and any(len(step.ended) for step in steps)


def test_a_hook_adds_a_sensor_rewards_an_end_and_metrics(tmp_path):
    hook = tmp_path / "hook.py"
    hook.write_text(
        "def state(program): return [program.n, 0.5]\ndef reward(program): return {'frames': 1.0}\n"
        "def done(program): return program.n >= 8\ndef metrics(program): return {'last': program.n}\n"
    )
    game = program(tmp_path, HEAD + "n = 0\n" + LOOP + "    n += 1\n" + SHOW, f"hook={hook}")
    first, second = steps(game, 2)
    assert first.observations[1].tolist() == [[5.0, 0.5]] and first.rewards.tolist() == [[4.0]]
    assert second.terminated[0] and second.metrics.tolist() == [[8.0]]


def test_pointer_buttons_and_keys_come_as_events_and_as_states(tmp_path):
    body = LOOP + (
        "    for event in events:\n"
        "        if event.type == pygame.MOUSEBUTTONDOWN: print(event.pos)\n"
        "        if event.type == pygame.KEYDOWN and event.key == pygame.K_a: text = event.unicode\n"
        "    held = pygame.key.get_pressed()[pygame.K_a], pygame.mouse.get_pressed()[0]\n"
        "    seen = [*pygame.mouse.get_pos(), *held, len(text)]\n"
    )
    hook = tmp_path / "hook.py"
    hook.write_text("def state(program): return program.seen\n")
    game = program(tmp_path, HEAD + "text, seen = '', [0] * 5\n" + body + SHOW, f"hook={hook}")
    with opened(game) as playing:
        (step,) = playing.step([ActArrays(np.array([[1, 1]], np.float32), np.array([[1, 1]], np.int32))])
    assert step.observations[1].tolist() == [[63.0, 0.0, 1.0, 1.0, 1.0]]


def test_time_is_virtual_everywhere(tmp_path):
    body = LOOP + "    seen = time.time(), pygame.time.get_ticks(), datetime.datetime.now().timestamp()\n"
    body += "    late = pygame.time.get_ticks() + 100\n    while pygame.time.get_ticks() < late: pass\n"
    hook = tmp_path / "hook.py"
    hook.write_text("def state(program): return [program.seen[1], program.seen[0] % 86400, program.seen[2] % 86400]\n")
    game = program(tmp_path, "import datetime, time\n" + HEAD + "seen = (0, 0, 0)\n" + body + SHOW, f"hook={hook}")
    first, second = (step.observations[1][0] for step in steps(game, 2))
    assert 400 <= second[0] - first[0] <= 500
    assert second[1] == second[2] == pytest.approx(second[0] / 1000, abs=1)


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
import json, os, pathlib
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


def test_a_server_gives_its_program_rewards_keys_and_arguments(tmp_path):
    path = tmp_path / "program.py"
    path.write_text("import sys\nassert sys.argv[1:] == ['--level']\n" + HEAD + LOOP + SHOW)
    words = ["--pygame", str(path), "--reward", r"Score: (\d+)", "--keys", "UP,a", "--", "--level"]
    listed = joybridge("list", *words)
    assert "rewards: score (weight 1)" in listed.output
    assert "key_UP (released | pressed [ArrowUp]), key_a (released | pressed [KeyA])" in " ".join(listed.output.split())
    with server(*words) as process, Session(process.address, "program", arenas=2, seed=1) as session:
        (step,) = session.step(make_acts(session.spec, 2))
        process.kill()  # then the processes of the program end by themselves
    assert step.observations[0].shape == (2, 55, 74, 3)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--reward", "Score"], "--reward is for the program in a --pygame before it"),
        (["--gym", "CartPole-v1", "--done", "over"], "--done is for the program in a --pygame before it"),
        (["--", "--level", "3"], "got '--level' after --"),
    ],
)
def test_options_of_a_program_without_one_are_refused(words, what):
    errors = io.StringIO()
    with redirect_stderr(errors), pytest.raises(SystemExit):
        main(["list", *words])
    assert what in errors.getvalue()


def test_commands_name_a_program_by_its_place(tmp_path):
    done = joybridge("look", f"pygame:{CATCH} name=fruit", str(tmp_path / "look.png"), "--pictures", "2")
    assert done == (
        0,
        f"{tmp_path / 'look.png'}: 2 pictures of fruit, one every 4 decisions\n{CATCH} name=fruit, a program {KEYS}\n",
        "",
    )


@pytest.mark.parametrize("place", ["pygame:", "pygame:'open"])
def test_a_place_without_a_program_is_refused_by_both_sides(place):
    with pytest.raises(CatalogError, match=r"missing|quotation"):
        load_game(place)
    with pytest.raises(ConfigError, match=r"missing|quotation"):
        choose_game(place, (), None)


CONFIG = r"""
game: {pygame: PROGRAM, reward: ['Score: (\d+)', 'sound:none'], done: Game over, keys: [LEFT, RIGHT], mouse: false,
       max_decisions: 8, name: fruit}
options: {screen: '48', colors: gray}
arenas: 2
pipeline_groups: 1
total_timesteps: 32
log_interval: 16
policy: {hidden_sizes: [4], rollout_steps: 8, frame_stack: 1, image_encoder: none, epochs: 1}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    config = folder / "fruit.yaml"
    config.write_text(CONFIG.replace("PROGRAM", str(CATCHING)))
    trained = joybridge("train", str(config), "--run", str(folder / "run"), "game.max_decisions=4")
    assert trained.status == 0, trained.errors
    return folder / "run"


def test_a_run_remembers_the_program_that_its_configuration_has_named(run):
    assert (run / "config.yaml").read_text().startswith("game: fruit\n")
    evaluated = joybridge("evaluate", str(run), "--episodes", "2", "--json")
    assert evaluated.status == 0 and '"length": 4.0' in evaluated.output


@pytest.mark.parametrize(("acts", "proposed"), [(0, "joybridge export"), (1, "joybridge watch")])
def test_no_export_is_proposed_that_would_be_refused(acts, proposed, run, tmp_path):
    if acts:
        config, run = run / "config.yaml", tmp_path / "run"
        trained = joybridge("train", str(config), "--run", str(run), f"policy.remember_acts={acts}")
        assert trained.status == 0, trained.errors
    recorded = joybridge("record", str(run), str(tmp_path / "play.gif"), "--seconds", "0.5")
    assert recorded.status == 0 and f"next: {proposed} {run}" in recorded.errors, recorded.errors


def test_settings_of_an_evaluation_are_laid_over_those_of_the_training(run, tmp_path):
    program = f"{CATCHING} tapes={tmp_path / 'tapes'}"
    evaluated = joybridge("evaluate", str(run), "--pygame", program, "--episodes", "1", "--json")
    assert evaluated.status == 0 and '"length": 4.0' in evaluated.output, evaluated.errors
    assert {path.name[:6] for path in (tmp_path / "tapes").glob("*.tape")} == {"fruit-"}


def test_a_fault_of_a_run_is_replayed_with_the_program_of_the_run(run, tmp_path):
    (place,) = json.loads((run / "simulators.json").read_text())["games"]
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    with server("--game", place) as process:
        session = Session(process.address, "fruit", arenas=1, seed=1, timeout=20)
        session.record_faults(copy / "faults")
        session.step(make_acts(session.spec, 1))
        process.kill()
        process.wait()
    with session, pytest.raises(SimulatorLost):
        session.step(make_acts(session.spec, 1))
    (fault,) = (copy / "faults").iterdir()
    done = joybridge("replay", str(fault))
    assert done.status == 0 and "2 steps are as they were recorded" in done.output, done.errors


def test_the_configuration_of_a_run_trains_another_one_with_its_program(run, tmp_path):
    again = joybridge("train", str(run / "config.yaml"), "--run", str(tmp_path / "again"))
    assert again.status == 0, again.errors
    assert (tmp_path / "again/simulators.json").read_text() == (run / "simulators.json").read_text()


def test_a_configuration_that_names_its_program_takes_no_other_from_the_command_line(tmp_path):
    config = tmp_path / "fruit.yaml"
    config.write_text(f"game: {{pygame: {CATCHING}}}\n")
    done = joybridge("train", str(config), "--pygame", "other.py", "--run", str(tmp_path / "run"))
    assert done.status == 1 and f"names its own program, pygame:{CATCHING}, so that of --pygame" in done.errors
    assert "write game.pygame=other.py" in done.errors


def test_a_program_is_found_beside_the_configuration_that_names_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "below"
    folder.mkdir()
    (folder / "fruit.yaml").write_text("game: {pygame: fruit.py, hook: hook.py, arguments: [fruit.py]}\n")
    for name in ("fruit.py", "hook.py"):
        (folder / name).touch()
    assert programs_of("below/fruit.yaml", []) == {"game": "pygame:below/fruit.py hook=below/hook.py -- fruit.py"}
    assert find_and_load("below/fruit.yaml").game == "fruit"
    (tmp_path / "hook.py").touch()
    assert programs_of("below/fruit.yaml", []) == {"game": "pygame:below/fruit.py hook=hook.py -- fruit.py"}
    assert programs_of("below/fruit.yaml", ["game.pygame=none.py"])["game"].startswith("pygame:none.py ")


def test_a_configuration_without_a_program_behind_its_keys_is_refused(tmp_path):
    config = tmp_path / "fruit.yaml"
    config.write_text("game: {reward: 'Score'}\n")
    done = joybridge("train", str(config), "--run", str(tmp_path / "run"))
    assert done.status == 1 and "expected one program, as in {pygame: my_game.py}" in done.errors


def test_a_hook_and_a_configuration_are_written_for_a_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "game.py").write_text(CATCHING.read_text())
    made = joybridge("new", "--pygame", "game.py keys=LEFT buttons=left -- easy")
    assert made.status == 0 and "train game.yaml --run runs/game" in made.output, made.errors
    assert len((tmp_path / "game_hook.py").read_text().splitlines()) <= 20
    options = Namespace(game=[], simulator=[], overrides=[])
    add_own_game(options, ["game.yaml"])
    load_config(tmp_path / "game.yaml", options.overrides)
    written = (tmp_path / "game.yaml").read_text()
    assert '  #   - "^Score: (-?\\\\d+)"  # 0 to ' in written and '  # done: "Game over"  # ' in written
    paid = written.replace("  # reward:", "  reward:").replace("  #   - ", "    - ").replace("  # done:", "  done:")
    keys = YAML(typ="safe").load(paid)["game"]
    assert "^Score: (-?\\d+)" in keys["reward"] and keys["done"] == "Game over"
    (place,) = options.game
    assert place == "pygame:game.py keys=LEFT buttons=left hook=game_hook.py -- easy"
    game: Any = load_game(place)
    game.processes.end()
    assert game.look.channels == ["reward"]
    again = joybridge("new", "--pygame", "game.py")
    assert again.status == 2 and "game.yaml exists and is not overwritten" in again.errors


def test_the_policy_of_a_run_plays_the_program_in_its_own_window(run, tmp_path, monkeypatch):
    shorter = tmp_path / "shorter.py"
    source = CATCHING.read_text().replace("randint(2, 5)", "randint(40, 50)").replace("0, 20\n", "0, 1\n")
    source = source.replace("pygame.init()\n", "pygame.init()\n    pygame.mixer.init()\n", 1)
    shorter.write_text(source.replace("sys.exit()", "break") + CLOSED.format(tmp_path / "closed"))
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.delenv("SDL_AUDIODRIVER", raising=False)  # there may be no sound card
    driven = joybridge("drive", str(shorter), str(run), "--episodes", "2")
    assert driven.status == 0, driven.errors
    assert re.fullmatch(rf"({PACE}){{2}}", driven.output)
    assert float((tmp_path / "closed").read_text()) > 0  # written outside of any fence, by the real clock


def test_a_hook_that_is_not_there_is_named(tmp_path):
    with pytest.raises(CatalogError, match=r"there is no hook .*none\.py; its path is relative to the current folder"):
        program(tmp_path, HEAD + LOOP + SHOW, f"hook={tmp_path}/none.py")


def test_a_file_is_no_name_of_a_game():
    with pytest.raises(ConfigError, match=r"my\.py is a file: name a pygame program pygame:my\.py, and a game"):
        choose_game("my.py", (), None)


def test_a_window_needs_a_display(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    driven = joybridge("drive", str(CATCHING), str(tmp_path))
    assert driven.status == 1 and driven.errors.startswith("error: there is no display on which a window could open")


PACE = r"reward [-\d.]+ in \d+ decisions(, [\d.]+ per second of 12.5)?\n"


@pytest.mark.parametrize("suffix", ["onnx", "json"])
def test_an_exported_policy_plays_the_program_in_its_own_window(run, tmp_path, monkeypatch, suffix):
    exported = joybridge("export", str(run), str(tmp_path / f"policy.{suffix}"))
    assert exported.status == 0, exported.errors
    (words,) = re.findall(r"next: (.*)", exported.errors)
    assert shlex.split(words)[:2] == ["joybridge", "drive"] and "'reward=Score: (\\d+)'" in shlex.split(words)[2]
    shorter = tmp_path / "shorter.py"
    source = CATCHING.read_text().replace("randint(2, 5)", "randint(40, 50)").replace("0, 20\n", "0, 1\n")
    shorter.write_text(source)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("SDL_AUDIODRIVER", "dummy")
    monkeypatch.setattr(drive, "Progress", partial(Progress, seconds=0.0))
    driven = joybridge("drive", str(shorter), str(tmp_path / f"policy.{suffix}"))
    assert driven.status == 0, driven.errors
    assert "1 decisions, reward 0; nothing ends the episode but the program, its window or Ctrl-C" in driven.errors
    assert re.fullmatch(PACE, driven.output) and "does not say what pays and what ends an episode" in driven.errors
    driven = joybridge("drive", f"{shorter} 'reward=Score: (\\d+)'", str(tmp_path / f"policy.{suffix}"))
    assert driven.status == 0 and "does not say" not in driven.errors
    other = joybridge("drive", f"{shorter} keys=UP", str(tmp_path / f"policy.{suffix}"))
    assert other.status == 1 and "the policy was trained with ['key_LEFT', 'key_RIGHT']" in other.errors


def test_a_file_that_is_no_policy_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for suffix in ("onnx", "json"):
        path = tmp_path / f"policy.{suffix}"
        path.write_bytes(b"{}")
        driven = joybridge("drive", str(CATCHING), str(path))
        assert driven.status == 1 and f"{path} is no exported policy" in driven.errors, driven.errors
        driven = joybridge("drive", str(CATCHING), str(path), "--deterministic")
        assert driven.status == 1 and "was exported with its own" in driven.errors, driven.errors


CLOSED = """
    import contextlib, pathlib, time
    with contextlib.suppress(PermissionError):  # behind the fences of its first look
        pathlib.Path('{}').write_text(str(time.time() - 1_750_000_000))
"""


def test_keys_that_no_source_names_are_found_by_watching_the_program_play(tmp_path):
    body = (
        "numbers, late = [100, 107], {}\n"
        + LOOP
        + (
            "    for event in events:\n"
            "        if event.type == pygame.KEYDOWN and event.key in (pygame.K_UP, numbers[0], *late): pass\n"
            "    held = pygame.key.get_pressed()\n"
            "    moved = held[numbers[1]], any(held)\n"
        )
    )
    description = program(tmp_path, HEAD + body + SHOW).description
    assert description.endswith("Keys in its sources: UP; that it was seen to read: UP, d, k.")


def test_a_joystick_is_plugged_in_where_a_program_reads_nothing_else(tmp_path):
    body = (
        "stick, seen = pygame.joystick.Joystick(pygame.joystick.get_count() - 1), [0] * 5\n"
        "while True:\n"
        "    for event in pygame.event.get():\n"
        "        seen[3] += event.type == pygame.JOYAXISMOTION\n"
        "        seen[4] += event.type == pygame.JOYBUTTONDOWN and event.button == 3\n"
        "    seen[:3] = stick.get_axis(0), stick.get_axis(1), stick.get_button(3)\n"
    )
    (tmp_path / "hook.py").write_text("def state(program): return program.seen\n")
    game = program(tmp_path, HEAD + body + SHOW, f"hook={tmp_path / 'hook.py'}")
    with opened(game) as playing:
        act = ActArrays(np.array([[0.5, 1.0]], np.float32), np.array([[0, 0, 0, 1]], np.int32))
        (step,) = playing.step([act])
    assert step.observations[1].tolist() == [[0.5, -1.0, 1.0, 2.0, 1.0]]


def test_a_program_that_does_not_go_on_from_snapshots_as_before_is_served_without(tmp_path):
    source = "import os\n" + HEAD + LOOP + "    screen.fill(os.getpid() % 2**24)\n" + SHOW
    game = program(tmp_path, source)
    spec = game.describe(choose_options(game.options, {}, game.name))
    assert spec.snapshot_bytes_per_arena == 0 and "Without snapshots" in spec.description
    forced: Any = program(tmp_path, source, "snapshots=true")
    with opened(forced) as playing:
        playing.step(still(forced))
        state = playing.save()
        forced.processes.forget_branches()
        with pytest.raises(ValueError, match="arena 0 does not show the picture of the snapshot"):
            playing.restore(state)


def test_a_program_that_draws_in_a_thread_is_refused(tmp_path):
    draw = "import threading\nthread = threading.Thread(target=pygame.display.flip)\nthread.start()\nthread.join()\n"
    with pytest.raises(CatalogError, match="the program draws in a thread"):
        program(tmp_path, HEAD + draw + LOOP + SHOW)


def test_a_package_without_scripts_is_refused_with_the_names_of_its_modules():
    with pytest.raises(CatalogError, match=r"'pillow' has no script; its modules are .*PIL.*: name the one that runs"):
        load_game("pygame:pillow")


def test_a_program_that_compares_keys_with_all_there_are_has_those_of_its_sources(tmp_path):
    body = (
        "names = [pygame.K_UP, *range(97, 123), *range(48, 58)]\n"
        + LOOP
        + (
            "    for event in events:\n"
            "        if event.type == pygame.KEYDOWN and any([event.key == name for name in names]): pass\n"
        )
    )
    assert list(program(tmp_path, HEAD + body + SHOW).look.keys) == ["UP"]
