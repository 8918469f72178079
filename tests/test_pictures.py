"""Images of the two large games: what they show, hide and mark, where, and to the same bytes."""

import hashlib

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import check_spec, choose_options
from joybridge.games.beastly_rivals import picture as beast_picture
from joybridge.games.beastly_rivals.game import BeastlyRivals
from joybridge.games.shooting_birds import picture as bird_picture
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.levels import OBSTACLES
from joybridge.games.shooting_birds.sensing import covered
from joybridge.games.sight import OBSERVATIONS

GAMES = [ShootingBirds, BeastlyRivals]
OPTIONS = choose_options(ShootingBirds.options, {}, "shooting_birds")


def make(game, arenas=1, seed=3, **options):
    return game(choose_options(game.options, options, game.name), {}, arenas, 0, seed)


def images(game):
    """Return the images of all arenas, one [arenas, height, width, channels] per sensor."""
    return [values for values in game.observations(game.arenas) if values.ndim == 4]


def clear_sky(**options):
    """Return Shooting Birds with one small bird, the pointer in the middle, in a level where this place is free."""
    game = make(ShootingBirds, level="4", **options)
    game.fields["birds"]["x"] = 1000.0
    game.fields["x"], game.fields["y"], game.fields["ammo"] = 0.0, 8.0, 8
    place(game, 0, 0.0, 8.0, 2)
    return game


def place(game, number, x, y, kind):
    bird = game.fields["birds"][0, number : number + 1]
    bird["x"], bird["y"], bird["kind"], bird["z"] = x, y, kind, kind - 0.15


def large_bird(**options):
    game = clear_sky(**options)
    place(game, 0, 0.0, 8.0, 0)
    return game


@pytest.mark.parametrize("game", GAMES)
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_an_option_selects_numbers_and_images(game, observation):
    options = choose_options(game.options, {"observation": observation}, game.name)
    spec = game.describe(options)
    check_spec(spec)
    sensors = spec.behaviors[0].sensors
    shown = {sensor.name: sensor.image.centered for sensor in sensors if sensor.HasField("image")}
    assert shown == {name: name != "screen" for name in OBSERVATIONS[observation] if name != "state"}
    assert (len(sensors) > len(shown)) == (observation in ("state", "all"))
    values = make(game, arenas=2, observation=observation).observe()[0].observations
    assert [one.shape[1:] for one in values] == [tuple(sensor.shape) for sensor in sensors]


HASHES = {
    ("shooting_birds", "gray"): "e058a0bde5e83799",
    ("shooting_birds", "rgb"): "da45d7a9e3ef4e39",
    ("beastly_rivals", "gray"): "bcbca7bbd98709b1",
    ("beastly_rivals", "rgb"): "f0afdd7cb0646517",
}


@pytest.mark.parametrize("color", ["gray", "rgb"])
@pytest.mark.parametrize("game", GAMES)
def test_images_are_the_same_bytes_on_every_machine(game, color):
    playing, random = make(game, arenas=5, observation="all", color=color), np.random.default_rng(0)
    digest = hashlib.sha256()
    for _ in range(60):
        axes = random.uniform(-1, 1, (5, 2)).astype(np.float32)
        (step,) = playing.step([ActArrays(axes, random.integers(0, 2, (5, 2)).astype(np.int32))])
        for values in step.observations[-3:]:
            digest.update(values.tobytes())
    assert digest.hexdigest()[:16] == HASHES[game.name, color]


@pytest.mark.parametrize(("positions", "different"), [("exact", 8), ("rounded", 1)])
def test_a_part_of_a_pixel_that_a_bird_moves_shows_in_its_shades(positions, different):
    game = clear_sky(observation="screen", screen_size="48", positions=positions)
    unit = 2 * bird_picture.HALF_WIDTH / 48
    seen = []
    for shift in np.arange(8) / 8:
        place(game, 0, shift * unit, 8.0, 2)
        seen.append(images(game)[0].tobytes())
    assert len(set(seen)) == different


# With "rounded", ground and bird move once each, one after the other.
@pytest.mark.parametrize(("positions", "different"), [("exact", 8), ("rounded", 3)])
def test_a_pointer_that_moves_by_a_part_of_a_pixel_shifts_the_square_around_it(positions, different):
    game = clear_sky(observation="fovea", positions=positions)
    seen = []
    for shift in np.arange(8) / 8:
        game.fields["x"] = shift * 8.0 / 32
        seen.append(images(game)[0].tobytes())
    assert len(set(seen)) == different


@pytest.mark.parametrize("observation", ["screen", "fovea"])
def test_a_bird_in_the_picture_is_where_the_gun_would_hit_it(observation):
    game = clear_sky(observation=observation, cursor="hidden")
    random, agree, where = np.random.default_rng(1), 0, 0
    for _ in range(300):
        kind = int(random.integers(3))
        x, y = random.uniform(-17, 17), random.uniform(-8, 8)
        place(game, 0, x, y, kind)
        game.fields["x"], game.fields["y"] = x, y
        image = images(game)[0][0, :, :, 0]
        (view,) = ShootingBirds.views({**OPTIONS, "observation": observation}).values()
        left = x - 4 if view.centered else -bird_picture.HALF_WIDTH
        top = y + 4 if view.centered else bird_picture.HALF_HEIGHT
        pixel = image[int((top - y) / view.unit), int((x - left) / view.unit)]
        hidden = covered(x, y, kind - 0.15, 4, OBSTACLES)
        near_edge = {covered(x + dx, y + dy, kind - 0.15, 4, OBSTACLES) for dx in (-0.7, 0.7) for dy in (-0.7, 0.7)}
        if near_edge == {hidden}:
            where += 1
            agree += (pixel > 100) != hidden
    assert where > 150 and agree == where


def test_the_pointer_is_drawn_around_birds_and_hides_none():
    drawn, hidden = (images(large_bird(observation="screen", cursor=cursor))[0] for cursor in ("drawn", "hidden"))
    assert (drawn != hidden).any() and drawn.max() == hidden.max() >= 200
    bright = hidden >= 100
    bright[:, -2:] = False  # the bar
    assert (drawn[bright] == hidden[bright]).all()


def test_what_lies_beyond_the_field_is_marked_in_images_around_the_pointer():
    game = clear_sky(observation="fovea+wide")
    game.fields["x"] = 17.7
    for image in images(game):
        assert (image[0, :-2, -1, 0] == bird_picture.GROUND_GRAYS[bird_picture.WALL]).all()
    at_wall = images(game)
    game.fields["x"] = 1e6  # as a forged snapshot may say
    assert [image.shape for image in images(game)] == [image.shape for image in at_wall]


@pytest.mark.parametrize("observation", ["screen", "fovea"])
def test_ammo_is_drawn(observation):
    game, bars = clear_sky(observation=observation), []
    for ammo in range(9):
        game.fields["ammo"] = ammo
        bars.append(int(images(game)[0][0, -1].astype(int).sum()))
    assert bars == sorted(set(bars)) and bars[0] == 0


def test_the_nearer_of_two_birds_is_in_front():
    game = clear_sky(observation="screen", cursor="hidden")
    place(game, 1, 0.0, 8.0, 0)
    top = images(game)[0][0, :12].max()
    assert top == bird_picture.GRAYS[0]


def test_cooldown_and_speed_of_the_beast_are_drawn():
    game = make(BeastlyRivals, observation="screen")
    middle, bars = 32, []
    for cooldown, speed in ((0, 1.0), (100, 1.0), (200, 8.0)):
        game.fields["cooldown"], game.fields["speed"] = cooldown, speed
        row = images(game)[0][0, -1, :, 0].astype(int)
        bars.append((row[:middle].sum(), row[middle:].sum()))
    assert bars[0][0] > bars[1][0] > bars[2][0] == 0 and bars[2][1] > bars[1][1] == bars[0][1] > 0


def test_a_beast_outside_the_picture_is_marked_at_its_edge():
    game = make(BeastlyRivals, observation="screen", cursor="hidden")
    beast = game.fields["beast"]
    beast["x"], beast["z"] = 30.0, 0.0
    image = images(game)[0][0, :, :, 0]
    assert image[30:34, -4:].max() == beast_picture.GRAYS[beast_picture.FAR_BEAST]


def test_only_arenas_whose_episode_ended_are_observed_anew():
    game, random = make(BeastlyRivals, arenas=40, observation="all"), np.random.default_rng(0)
    ends = 0
    for _ in range(150):
        axes = random.uniform(-1, 1, (40, 2)).astype(np.float32)
        (step,) = game.step([ActArrays(axes, np.zeros((40, 2), np.int32))])
        ends += step.terminated.sum()
        for values, wanted in zip(step.observations, game.observations(game.arenas), strict=True):
            assert (values == wanted).all()
    assert ends > 0
