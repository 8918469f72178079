"""Small images that are painted shape by shape: the share of each pixel that is covered, and nothing beyond."""

import hashlib

import numpy as np
import pytest

from joybridge.games.archer.game import Archer
from joybridge.games.marble.game import Marble
from joybridge.games.orchard.game import Orchard
from joybridge.simulator.canvas import Canvas


def blank(height=8, width=8, channels=1, unit=1.0):
    return Canvas(np.zeros((height, width, channels), np.uint8), left=0.0, top=height * unit, unit=unit)


def test_a_box_covers_pixels_by_the_share_of_their_area():
    canvas = blank()
    canvas.box(1.5, 1.0, 3.0, 2.25, (200,))
    assert canvas.pixels[5, :4, 0].tolist() == [0, 25, 50, 0]
    assert canvas.pixels[6, :4, 0].tolist() == [0, 100, 200, 0]
    assert canvas.pixels.sum() == 375


@pytest.mark.parametrize("center", [(20.0, 20.0), (20.25, 19.6)])
def test_a_disc_a_ring_and_a_line_have_their_areas_and_places_within_a_pixel(center):
    disc, ring, line = blank(40, 40), blank(40, 40), blank(40, 40)
    disc.disc(center, 6.0, (255,))
    ring.ring(center, 10.0, 2.0, (255,))
    line.line(center, (center[0] + 12, center[1] + 9), 3.0, (255,))
    areas = [canvas.pixels.sum() / 255 for canvas in (disc, ring, line)]
    assert areas == pytest.approx([np.pi * 36, np.pi * 40, 3 * 15 + np.pi * 2.25], rel=0.02)
    y, x = np.mgrid[39.5:-0.5:-1, 0.5:40]
    for canvas, middle in ((disc, center), (ring, center), (line, (center[0] + 6, center[1] + 4.5))):
        weights = canvas.pixels[..., 0] / canvas.pixels.sum()
        assert ((weights * x).sum(), (weights * y).sum()) == pytest.approx(middle, abs=0.05)


def test_units_colors_and_backgrounds_are_those_that_were_given():
    background = np.full((6, 8, 3), 90, np.uint8)
    canvas = Canvas(background, left=-2.0, top=1.5, unit=0.5)
    canvas.box(-1.0, -0.5, 0.0, 0.5, (10, 20, 30))
    expected = background.copy()
    expected[2:4, 2:4] = 10, 20, 30
    assert (canvas.pixels == expected).all() and (background == 90).all()
    canvas.disc((100, 100), 5, (0, 0, 0))
    canvas.line((-50, -50), (-50, 50), 3, (0, 0, 0))
    canvas.box(9, 9, 12, 12, (0, 0, 0))
    assert (canvas.pixels == expected).all()  # what lies beyond is cut off
    canvas.box(-9, -9, 9, 9, (1, 2, 3))
    assert (canvas.pixels == (1, 2, 3)).all()


def test_a_wrong_background_or_color_is_refused():
    with pytest.raises(ValueError, match=r"got float64 \[8, 8\], expected uint8 \[height, width, 1 or 3\]"):
        Canvas(np.zeros((8, 8)), 0, 0, 1)
    with pytest.raises(ValueError, match=r"got uint8 \[8, 8, 2\]"):
        blank(channels=2)
    with pytest.raises(ValueError, match=r"got \(1, 2, 3\), expected a shade for each of 1 channels"):
        blank().disc((1, 1), 1, (1, 2, 3))


IMAGES = {  # of an episode of random play, which may change only with a reason
    Archer: "66ba19c8de0f1bb6",
    Orchard: "1c8aa32be67cbdf1",
    Marble: "21dbeb5c9cdde1d7",
}


@pytest.mark.parametrize("kind", IMAGES)
def test_the_images_of_the_small_games_are_the_same_bytes_everywhere(kind):
    game, digest = kind(), hashlib.blake2b(digest_size=8)
    game.option, game.rng = {"observation": "screen"}, np.random.default_rng(0)
    spec = kind.describe(game.option)
    game.parameter = {one.name: one.default_value for one in spec.parameters}
    device, choose = spec.behaviors[0].device, np.random.default_rng(1)
    step = game.reset()
    for _ in range(60):
        digest.update(np.asarray(step.observation["screen"]).tobytes())
        masks = step.masks or {}
        action = {one.name: float(choose.uniform(-1, 1)) for one in device.axes}
        for branch in device.branches:
            allowed = np.flatnonzero(masks.get(branch.name, np.ones(len(branch.choices))))
            action[branch.name] = int(choose.choice(allowed))
        step = game.step(action)
    assert digest.hexdigest() == IMAGES[kind]
