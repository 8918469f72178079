"""A camera over a field of three screens: what moves it, what is seen, and that the crosshair stays on the screen."""

import hashlib
from typing import Any

import numpy as np
import pytest

from joybridge.contract.spec import check_spec, choose_options
from joybridge.games.shooting_birds import picture, script
from joybridge.games.shooting_birds.game import ShootingBirds
from tests.support import sweeps
from tests.support.sweeps import step

MOVING = ["edge", "axis", "drag"]
GOLDEN = {"edge": "718290ac4f2f2259", "axis": "cdc678c9676715bf", "drag": "6aa84bfa77b7b45e"}


def options(camera: str, **others: str) -> dict[str, str]:
    chosen = {"camera": camera, "locomotion": "axes", **others}
    return choose_options(ShootingBirds.options, chosen, "shooting_birds")


def new_game(camera: str, arenas: int = 1, first_arena: int = 0, seed: int = 5, **others: str) -> Any:
    return ShootingBirds(options(camera, **others), {}, arenas, first_arena, seed)


def sweep(game: Any, decisions: int) -> list[str]:
    return sweeps.sweep(game, decisions, game.describe(game_options(game)).behaviors[0].device)


def middle(game: Any) -> None:
    """Put crosshair and camera into the middle of the field, and the birds far away."""
    game.arenas.x = game.arenas.y = game.arenas.camera = 0.0
    game.arenas.birds.y, game.arenas.birds.x, game.arenas.birds.wait = 1000.0, 0.0, 0


def game_options(game: Any) -> dict[str, str]:
    return options(("fixed", *MOVING)[game.world.camera])


@pytest.mark.parametrize("camera", MOVING)
def test_every_camera_has_a_well_formed_spec_that_its_game_keeps(camera):
    choices: list[dict[str, str]] = [{}, {"camera_position": "hidden"}, {"hints": "on"}]
    for others in [*choices, {**choices[1], **choices[2]}]:
        spec = ShootingBirds.describe(options(camera, **others))
        check_spec(spec)
        (seen,) = new_game(camera, 2, 0, 5, **others).observe()
        sensors = spec.behaviors[0].sensors
        for sensor, values in zip(sensors, seen.observations, strict=True):
            assert values.shape == (2, *sensor.shape)
        names = [sensor.name for sensor in sensors]
        assert ("camera" in names) == ("camera_position" not in others) and ("hints" in names) == ("hints" in others)


def test_pushing_against_the_border_moves_the_camera_and_the_crosshair_stays_on_the_screen():
    game = new_game("edge")
    middle(game)
    for _ in range(200):
        step(game, (1.0, 0.0), (0, 0))
        assert abs(game.arenas.x[0] - game.arenas.camera[0]) <= 18.8
    assert game.arenas.camera[0] == 38.0
    for _ in range(17):
        step(game, (-1.0, 0.0), (0, 0))
    assert game.arenas.camera[0] == 38.0  # only the border moves it


def test_an_axis_moves_the_camera_by_0_8_units_per_decision_and_the_crosshair_with_it():
    game = new_game("axis")
    middle(game)
    step(game, (0.0, 0.0, -0.5), (0, 0))
    assert game.arenas.camera[0] == pytest.approx(-0.4) and game.arenas.x[0] == pytest.approx(-0.4)
    for _ in range(100):
        step(game, (0.0, 0.0, -1.0), (0, 0))
    assert game.arenas.camera[0] == game.arenas.x[0] == -38.0


def test_a_held_button_drags_the_field_along_with_the_crosshair():
    game = new_game("drag")
    middle(game)
    step(game, (0.5, 0.0), (1, 0, 0))
    assert game.arenas.x[0] == pytest.approx(0.0) and game.arenas.camera[0] == pytest.approx(-0.5)
    step(game, (0.5, 0.0), (0, 0, 0))
    assert game.arenas.x[0] == pytest.approx(0.5) and game.arenas.camera[0] == pytest.approx(-0.5)


@pytest.mark.parametrize("camera", MOVING)
def test_positions_are_those_on_the_screen_and_the_camera_has_a_sensor(camera):
    game = new_game(camera, hints="on")
    middle(game)
    game.arenas.camera, game.arenas.x = 19.0, 25.0
    game.arenas.birds.x[0, :3] = (-1.0, 1.0, 39.0)
    _, crosshair, *_, position, hints = game.observe()[0].observations
    assert crosshair[0, 0] == pytest.approx((6.0 + 1.1) / 17.715)
    assert position[0, 0] == 0.5 and hints[0].tolist() == pytest.approx([0.1, 0.1])


def test_rays_end_at_the_border_of_the_screen():
    game = new_game("axis")
    middle(game)
    game.arenas.level = 5
    game.arenas.x = 14.0
    bird = game.arenas.birds[0, 0:1]
    bird["y"], bird["kind"] = 0.0, 0
    for x, seen in ((18.0, True), (20.2, True), (20.4, False)):
        bird["x"] = x
        assert (game.observe()[0].observations[2][0, 0, 0] >= 0.0) == seen


@pytest.mark.parametrize("observation", ["screen", "fovea"])
def test_images_end_at_the_border_of_the_screen(observation):
    game = new_game("axis", observation=observation, cursor="hidden")
    middle(game)
    game.arenas.camera, game.arenas.x = 10.0, 28.0
    before = game.observe()[0].observations[0].copy()
    bird = game.arenas.birds[0, 0:1]
    bird["x"], bird["y"], bird["kind"], bird["z"] = 31.0, 0.0, 0, -0.15
    assert (game.observe()[0].observations[0] == before).all()
    bird["x"] = 27.0
    assert game.observe()[0].observations[0].max() >= picture.GRAYS[0] > before[0, :-4].max()


def test_birds_enter_outside_the_screen():
    game = new_game("axis", 200)
    assert (abs(game.arenas.birds["x"]) >= 19.0).all() and (abs(game.arenas.birds["x"]) <= 57.0).all()
    assert len(np.unique(game.arenas.birds["x"])) == 2000
    middle(game)
    game.arenas.camera = 30.0
    game.arenas.birds.x = 1000.0
    step(game, (0.0, 0.0, 0.0), (0, 0))
    assert (abs(game.arenas.birds["x"] - 30.0) >= 18.8).all()


def test_the_time_without_a_bird_on_the_screen_is_a_metric():
    game = new_game("axis", 2)
    middle(game)
    game.arenas.tick, game.arenas.empty = 1999, [999, 0]
    game.arenas.birds.y, game.arenas.birds.x, game.arenas.birds.vx = 0.0, [[40.0], [0.0]], 0.0
    metrics = step(game, (0.0, 0.0, 0.0), (0, 0)).metrics
    assert metrics[:, 4].tolist() == [0.5, 0.0]


@pytest.mark.parametrize("camera", MOVING)
@pytest.mark.parametrize("levels", ["original", "generated"])
def test_the_scripted_player_travels_and_hits(camera, levels):
    game = new_game(camera, 20, levels=levels)
    assert script.play(game, 1000).mean() > 15.0


@pytest.mark.parametrize("camera", MOVING)
def test_a_restored_game_continues_to_the_same_bytes_alone_or_among_others(camera):
    game = new_game(camera, 3, levels="generated", birds="mixed")
    sweep(game, 100)
    state = {name: values.copy() for name, values in game.save().items()}
    wanted = sweep(game, 100)
    other = new_game(camera, 3, seed=99, levels="generated", birds="mixed")
    other.restore(state)
    assert sweep(other, 100) == wanted
    among = sweep(new_game(camera, 3), 60)
    assert sweep(new_game(camera, 1, first_arena=1), 60) == among[1:2]


@pytest.mark.parametrize("camera", GOLDEN)
def test_a_seeded_run_gives_the_bytes_it_always_gave(camera):
    seen = sweep(new_game(camera, 3, observation="all", hints="on", birds="mixed", levels="generated"), 150)
    assert hashlib.sha256("".join(seen).encode()).hexdigest()[:16] == GOLDEN[camera]


@pytest.mark.parametrize("place", [-38.1, 38.1, np.nan])
def test_restore_refuses_a_camera_beyond_the_field(place):
    game = new_game("axis", 2)
    arenas = game.arenas.copy()
    arenas.camera[1] = place
    with pytest.raises(ValueError, match="camera is outside"):
        game.restore({**game.save(), "arenas": np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1)})


def test_a_picture_shows_where_the_camera_is():
    game = new_game("axis")
    middle(game)
    first = game.draw(0)
    game.arenas.camera = game.arenas.x = 20.0
    assert (game.draw(0) != first).any(axis=2).mean() > 0.3
