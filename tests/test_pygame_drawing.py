"""With skip_drawing, a program draws only the frames that somebody sees, and nobody sees a difference."""

from typing import Any

import numpy as np
import pytest

from joybridge.simulator.catalog import CatalogError, load_game
from tests.support.programs import CATCH, HEAD, LOOP, SHOW, opened, program, still
from tests.test_pygame_programs import played

COUNT = "    drawn += screen.get_at((3, 3)) == (n, 0, 0)\n"  # frames whose own color has come onto the display
SCENE = "n, drawn = 0, 0\n" + LOOP + "    n += 1\n    screen.fill((n, 0, 0))\n"


@pytest.fixture(scope="module")
def games():
    made: list[Any] = [load_game(f"pygame:{CATCH} skip_drawing={skip}") for skip in ("false", "true")]
    yield made
    for game in made:
        game.processes.end()


def test_the_same_is_seen_and_paid(games):
    hashes = []
    for game in games:
        with opened(game, 2, seed=4) as playing:
            hashes.append(played(playing, game, 60, np.random.default_rng(0), 2))
    assert hashes[0] == hashes[1] and hashes[0][1] > 0


def test_pictures_of_all_frames_are_drawn_where_somebody_wants_them(games):
    shown = []
    for game in games:
        with opened(game, seed=3) as playing:
            playing.drawn_by_tick = 0
            for _ in range(4):
                playing.step(still(game))
                shown.append(np.array([*playing.tick_pictures, playing.draw(0)]))
    assert np.array_equal(shown[:4], shown[4:]) and len(shown[0]) == 4


@pytest.mark.parametrize(("skip", "drawn"), [("false", 40), ("true", 10)])
def test_only_the_last_frame_of_a_decision_is_drawn(skip, drawn, tmp_path):
    hook = tmp_path / "hook.py"
    hook.write_text("def metrics(program): return {'drawn': program.drawn}\n")
    game = program(tmp_path, HEAD + SCENE + COUNT + SHOW, f"hook={hook} skip_drawing={skip} max_decisions=10")
    with opened(game) as playing:
        for _ in range(10):
            (step,) = playing.step(still(game))
    assert step.truncated[0] and step.metrics.tolist() == [[drawn + 1]]  # and the first, before any decision
    game.processes.end()


def test_a_part_of_the_display_that_the_program_draws_in_stays_that_part(tmp_path):
    part = "    screen.set_clip((8, 8, 16, 16))\n    screen.fill((0, n, 200))\n    screen.set_clip(None)\n"
    kept = "screen.set_clip((0, 0, 40, 40))\n"
    for source in (SCENE + part + SHOW, kept + SCENE + SHOW):
        pictures = []
        for skip in ("false", "true"):
            game = program(tmp_path, HEAD + source, f"skip_drawing={skip}")
            with opened(game) as playing:
                for _ in range(7):
                    playing.step(still(game))
                pictures.append(playing.draw(0))
            game.processes.end()
        assert np.array_equal(*pictures) and pictures[0].any()


@pytest.mark.parametrize(
    "body", ["    screen.fill((n, 0, 0), (n % 64, 0, 1, 48))\n", "    n == 7 and screen.fill('red')\n"]
)
def test_a_program_that_draws_only_what_has_changed_is_refused(body, tmp_path):
    with pytest.raises(CatalogError, match="skip_drawing=true: the program does not draw its whole picture"):
        program(tmp_path, HEAD + "n = 0\n" + LOOP + "    n += 1\n" + body + SHOW, "skip_drawing=true")
