"""Programs that are written in ways of their own are games all the same."""

import numpy as np
import pytest

from joybridge.adapters.pygame_programs.settings import read_pygame_settings
from joybridge.contract.codec import ActArrays
from joybridge.contract.limits import MAX_DESCRIPTION
from joybridge.simulator.catalog import CatalogError, load_game
from tests.support.programs import HEAD, LOOP, SHOW, opened, program, steps, still

COUNT = "def state(program): return [program.n]\n"


def hook(tmp_path, text=COUNT):
    (tmp_path / "hook.py").write_text(text)
    return f"hook={tmp_path / 'hook.py'}"


def test_texts_of_several_lines_and_long_ones_are_proposed_in_a_description_that_fits(tmp_path):
    texts = ["Score: {n}\\nLives: 3", "Score:\\t{n}", "a" * 300 + " {n} {n} {n} {n}", "b" * 300 + " {n} {n} {n} {n}"]
    renders = "".join(f"    font.render(f{text!r}, True, 'white')\n".replace("\\\\", "\\") for text in texts)
    source = HEAD + "font, n = pygame.font.Font(None, 20), 0\n" + LOOP + "    n += 1\n" + renders + SHOW
    game = program(tmp_path, source)
    assert game.description.isprintable() and len(game.description) == MAX_DESCRIPTION
    paid = program(tmp_path, source, r"'reward=^Score: \d+\s+Lives: (\d+)' 'reward=Score:\s+(\d+)'")
    (step,) = steps(paid, 1)
    assert step.rewards.tolist() == [[0.0, 4.0]]  # the lives do not change


def test_a_program_that_awaits_its_frames_is_played_in_virtual_time(tmp_path):
    source = (
        "import asyncio\n" + HEAD + "n = 0\nasync def main():\n    global n\n    while True:\n"
        "        pygame.event.get()\n        n = pygame.time.get_ticks()\n        pygame.display.flip()\n"
        "        await asyncio.sleep(1 / 50)\n        await asyncio.sleep(0)\nasyncio.run(main())\n"
    )
    first, second = steps(program(tmp_path, source, hook(tmp_path)), 2)
    assert second.observations[1][0, 0] - first.observations[1][0, 0] == 80


def test_what_has_just_been_pressed_is_told_for_one_frame(tmp_path, monkeypatch):
    names = ("get_just_pressed", "get_just_released")  # pygame-ce has them
    given = "".join(f"pygame.key.{name} = pygame.mouse.{name} = None\n" for name in names)
    (tmp_path / "sitecustomize.py").write_text("import pygame\n" + given)
    monkeypatch.syspath_prepend(str(tmp_path))
    body = (
        "n = [0] * 5\n"
        + LOOP
        + (
            "    n[0] += pygame.key.get_just_pressed()[pygame.K_a]\n"
            "    n[1] += pygame.key.get_just_released()[pygame.K_a]\n"
            "    n[2] += pygame.mouse.get_just_pressed()[0]\n    n[3] += pygame.mouse.get_just_released()[0]\n"
            "    n[4] += pygame.key.get_pressed()[pygame.K_a] and pygame.mouse.get_pressed()[0]\n"
        )
    )
    game = program(tmp_path, HEAD + body + SHOW, hook(tmp_path, "def state(program): return program.n\n"))
    with opened(game) as playing:
        for pressed in (1, 1, 0, 1):
            (step,) = playing.step([ActArrays(np.zeros((1, 2), np.float32), np.full((1, 2), pressed, np.int32))])
    assert step.observations[1].tolist() == [[2, 1, 2, 1, 12]]


@pytest.mark.parametrize(
    ("state", "what"),
    [
        ("[0] * (2 if program.n < 6 else 3)", "the hook's state has 3 numbers, at first it had 2"),
        ("[0 if program.n < 6 else float('nan')]", "the hook's state has nan, expected finite numbers"),
    ],
)
def test_a_state_that_changes_its_length_or_is_no_number_is_refused(tmp_path, state, what):
    source = HEAD + "n = 0\n" + LOOP + "    n += 1\n" + SHOW
    with pytest.raises(CatalogError, match=what):
        program(tmp_path, source, hook(tmp_path, f"def state(program): return {state}\n") + " snapshots=false")


@pytest.mark.parametrize(
    "paid", ["reward(program): return float('inf')", "metrics(program): return {'m': float('nan')}"]
)
def test_rewards_and_metrics_of_a_hook_are_finite(tmp_path, paid):
    source = HEAD + "n = 0\n" + LOOP + "    n += 1\n    if n > 9: break\n" + SHOW
    with pytest.raises(
        CatalogError, match=r"the hook's (reward reward|metric m) is (inf|nan), expected a finite number"
    ):
        program(tmp_path, source, hook(tmp_path, f"def {paid}\n"))


def test_a_program_of_any_name_among_many_files_is_found_with_what_lies_beside_it(tmp_path, monkeypatch):
    for number in range(210):
        (tmp_path / f"a{number:03}.txt").touch()
    (tmp_path / "zz.txt").write_text("7")
    (tmp_path / "game.pyw").write_text(HEAD + "n = int(open('zz.txt').read())\n" + LOOP + SHOW)
    settings = hook(tmp_path)
    monkeypatch.chdir(tmp_path)
    (step,) = steps(load_game(f"pygame:game.pyw {settings}"), 1)
    assert step.observations[1].tolist() == [[7.0]]


def test_a_package_that_runs_while_it_is_looked_up_is_named(tmp_path, monkeypatch):
    (tmp_path / "runs_at_once").mkdir()
    (tmp_path / "runs_at_once" / "__init__.py").write_text(HEAD + LOOP + SHOW)
    (tmp_path / "runs_at_once" / "play.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(CatalogError, match="importing its package already runs the program"):
        load_game("pygame:runs_at_once.play")


def test_a_process_that_ends_before_it_connects_is_not_waited_for(tmp_path, monkeypatch):
    (tmp_path / "pygame.py").write_text("raise ImportError('no library')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(CatalogError, match="the process has ended with status 1; its error is above"):
        program(tmp_path, HEAD + LOOP + SHOW, "start=600")


def test_every_reward_has_a_channel_of_its_own():
    settings = read_pygame_settings(r"x.py reward=attr:main.score_2 'reward=Score: (\d+)' 'reward=score (\d+)'")
    assert [*settings.rewards] == ["score_2", "score", "score_3"]


def test_generators_that_are_made_before_the_first_frame_have_other_numbers_in_each_episode(tmp_path):
    source = (
        "import random\nimport numpy as np\n"
        + HEAD
        + "mine, theirs, fixed = random.Random(), np.random.default_rng(), random.Random(7)\n"
        + "old, bits, known = np.random.RandomState(), np.random.PCG64(), np.random.RandomState(7)\n"
        + "drawn = np.random.Generator(bits)\nn = [0] * 6\n"
        + LOOP
        + "    n = [mine.random(), theirs.random(), old.rand(), drawn.random(), fixed.random(), known.rand()]\n"
    )
    game = program(tmp_path, source + SHOW, hook(tmp_path, "def state(program): return program.n\n"))
    (again,), (once,), (other,) = (steps(game, 1, seed=seed) for seed in (5, 5, 6))
    first, same, second = (step.observations[1][0].tolist() for step in (once, again, other))
    assert first == same and [a == b for a, b in zip(first, second, strict=True)] == [False] * 4 + [True] * 2


def test_every_clock_of_the_program_is_virtual(tmp_path):
    body = "import time\nn = [0]\n" + LOOP
    body += "    stamp = time.strftime('%Y %j %H %M %S').split() + time.ctime().split()[-1:]\n"
    body += "    n = [*map(int, stamp), time.localtime().tm_year, time.gmtime().tm_year, time.gmtime(0).tm_year]\n"
    game = program(tmp_path, HEAD + body + SHOW, hook(tmp_path, "def state(program): return program.n\n"))
    (step,) = steps(game, 1)
    year, day, *_ = shown = step.observations[1][0].tolist()
    assert (year, shown[5:]) == (2024, [2024, 2024, 2024, 1970]) and day <= 2


def test_a_program_that_looks_around_with_the_mouse_turns_on_beyond_the_edge_of_its_window(tmp_path):
    body = "pygame.mouse.set_visible(False)\npygame.event.set_grab(True)\nn = [0]\n" + LOOP
    body += "    n[0] += sum(event.rel[0] for event in events if event.type == pygame.MOUSEMOTION)\n"
    game = program(tmp_path, HEAD + body + SHOW, hook(tmp_path, "def state(program): return program.n\n"))
    with opened(game, pointer="velocity") as playing:
        acts = still(game)
        acts[0].axes[:, 0] = 1
        turned = [playing.step(acts)[0].observations[1][0, 0] for _ in range(12)]
    ways = np.diff(turned)
    assert turned[-1] > 64 and np.ptp(ways[2:]) <= 1


def test_functions_of_the_program_are_not_taken_for_those_that_play_it(tmp_path):
    source = HEAD + "def show():\n    score = 0\n    " + (LOOP + "    score += 1\n" + SHOW).replace("\n", "\n    ")
    game = program(tmp_path, source + "\nshow()\n", "reward=attr:show.score")
    assert steps(game, 2)[1].rewards.tolist() == [[4.0]]
    ends = HEAD + "def main():\n    player = 7\n    for _ in range(12):\n        pygame.event.get()\n"
    ends += "        pygame.mouse.get_pos()\n" + SHOW.replace("    ", "        ") + "main()\n"
    asks = "from joybridge.adapters.hooks import look_up\ndef state(program): return [look_up('main.player') or 0]\n"
    seen = [step.observations[1].tolist() for step in steps(program(tmp_path, ends, hook(tmp_path, asks)), 2)]
    assert seen == [[[7.0]], [[7.0]]]


def test_a_hook_that_fails_when_the_program_ends_is_named(tmp_path):
    body = "n = 0\nfor n in range(12):\n    pygame.event.get()\n    pygame.mouse.get_pos()\n"
    fails = "def state(program): return [1 / (11 - program.n)]\n"
    with pytest.raises(CatalogError, match=r"ZeroDivisionError: .*line 1 of .*hook\.py"):
        program(tmp_path, HEAD + body + SHOW, hook(tmp_path, fails) + " snapshots=false")


def test_a_hook_sees_the_program_when_it_has_ended(tmp_path):
    body = "n = 0\nfor n in range(12):\n    pygame.event.get()\n    pygame.mouse.get_pos()\n" + SHOW
    asks = "from joybridge.adapters.hooks import look_up\n"
    asks += "def metrics(program): return {'n': program.n, 'also': look_up('n')}\n"
    game = program(tmp_path, HEAD + body + "pygame.quit()\n", hook(tmp_path, asks))
    ended = [step for step in steps(game, 6) if len(step.ended)]
    assert ended[0].metrics.tolist() == [[11.0, 11.0]]


def test_an_infinite_variable_pays_nothing(tmp_path):
    body = "best = float('inf')\nn = 0\n" + LOOP + "    n += 1\n    best = n if n > 6 else best\n"
    game = program(tmp_path, HEAD + body + SHOW, "reward=attr:best")
    assert [step.rewards[0, 0] for step in steps(game, 4)] == [0.0, 2.0, 4.0, 4.0]


def test_a_key_that_is_held_repeats_as_often_as_the_program_wishes(tmp_path):
    body = "pygame.key.set_repeat(100, 10)\nn = 0\nwhile True:\n"
    body += "    n += sum(event.type == pygame.KEYDOWN for event in pygame.event.get())\n"
    source = HEAD + body + SHOW.replace("60", "20")
    game = program(tmp_path, source, hook(tmp_path) + " keys=a mouse=false fps=20")
    with opened(game) as playing:
        for _ in range(3):  # of four frames of 50 ms
            (step,) = playing.step([ActArrays(np.zeros((1, 0), np.float32), np.ones((1, 1), np.int32))])
    assert 40 <= step.observations[1][0, 0] <= 54


def test_a_queued_sound_is_forgotten_when_another_one_plays_or_the_channel_stops(tmp_path):
    for name in "abc":
        (tmp_path / f"{name}.wav").write_bytes(bytes(1000))
    body = (
        "A, B, C = (pygame.mixer.Sound(f'{name}.wav') for name in 'abc')\nmusic = pygame.mixer.music\n"
        "first, second = pygame.mixer.Channel(0), pygame.mixer.Channel(1)\n"
        "n, left = [0] * 4, 0\n"
        + LOOP
        + "    left += 1\n    if left == 1:\n        first.play(A)\n        first.queue(B)\n        first.play(C)\n"
        "        second.play(A)\n        second.queue(B)\n        second.stop()\n        n[0] = second.get_busy()\n"
        "        n[1] = first.get_queue() is None\n        music.load('a.wav')\n        music.play()\n"
        "        music.queue('b.wav')\n        music.stop()\n        n[2] = music.get_busy()\n"
        "        music.play()\n        music.queue('b.wav')\n        music.load('c.wav')\n"
        "        n[3] = music.get_busy()\n"
    )
    settings = hook(tmp_path, "def state(program): return program.n\n")
    step = steps(program(tmp_path, HEAD + body + SHOW, f"reward=sound:b {settings}"), 60)[-1]
    assert step.observations[1].tolist() == [[0, 1, 0, 0]] and step.rewards.tolist() == [[0.0]]


def test_music_that_begins_later_in_its_file_ends_earlier(tmp_path):
    (tmp_path / "a.mp3").write_bytes(bytes(16_000))  # a second of 128 kbit
    body = (
        "pygame.mixer.music.load('a.mp3')\npygame.mixer.music.play(start=0.9)\nn, busy = [0, 0], 0\n"
        + LOOP
        + "    busy += 1\n    n[busy > 12] += pygame.mixer.music.get_busy()\n"
    )
    settings = hook(tmp_path, "def state(program): return program.n\n")
    step = steps(program(tmp_path, HEAD + body + SHOW, settings), 10)[-1]
    during, after = step.observations[1][0]
    assert 0 < during <= 7 and after == 0
