"""Programs that are written in ways of their own are games all the same."""

import numpy as np
import pytest

from joybridge.adapters.pygame_programs.settings import read_pygame_settings
from joybridge.contract.codec import ActArrays
from joybridge.contract.limits import MAX_DESCRIPTION
from joybridge.simulator.catalog import CatalogError, load_game
from tests.support.programs import HEAD, LOOP, SHOW, opened, program, steps

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
