"""Visual observations of players of Unity: PNG, channels and their mapping."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from joybridge.adapters.unity.pictures import decode
from joybridge.contract.codec import ActArrays
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.catalog import load_game
from tests.support.servers import free_port
from tests.support.unity_player import StandIn, agent, hybrid, says, vector

pytestmark = pytest.mark.nightly

PIXELS = np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10


def png(pixels):
    file = BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def visual(data, shape=(3, 2, 4), mapping=()):
    return ml.Observation(shape=shape, compression=ml.PNG, compressed=data, channel_mapping=mapping, name="camera")


def test_a_png_is_the_image_that_was_packed():
    assert (decode(png(PIXELS), (3, 2, 4), []) == PIXELS).all()
    assert (decode(png(PIXELS[:, :, 0]), (1, 2, 4), [])[:, :, 0] == PIXELS[:, :, 0]).all()


def test_one_channel_is_the_mean_of_the_first_picture():
    assert decode(png(PIXELS) + png(PIXELS), (1, 2, 4), []).tolist() == PIXELS[:, :, 1:2].tolist()


def test_pictures_are_stacked_by_their_channels():
    both = png(PIXELS) + png(PIXELS[:, :, ::-1])
    assert decode(both, (6, 2, 4), []).tolist() == np.concatenate([PIXELS, PIXELS[:, :, ::-1]], axis=2).tolist()
    assert decode(both, (4, 2, 4), []).shape == (2, 4, 4)
    mapped = decode(both, (2, 2, 4), [0, 0, 0, 1, -1, -1])
    assert mapped.tolist() == PIXELS[:, :, [1, 2]].tolist()


@pytest.mark.parametrize(
    ("data", "shape", "mapping", "text"),
    [
        (b"", (3, 2, 4), [], "has 0 PNG files"),
        (png(PIXELS)[:40], (3, 2, 4), [], "has a PNG file that cannot be read"),
        (png(PIXELS), (3, 4, 2), [], "has a PNG file of 4 x 2 pixels, expected 2 x 4"),
        (png(PIXELS), (4, 2, 4), [], "has 3 channels, expected 4"),
        (png(PIXELS), (2, 2, 4), [0, 1], r"maps channels to \[0, 1\], expected one of -1\.\.1 for each of the 3"),
        (png(PIXELS), (2, 2, 4), [0, 0, 0], "and each at least once"),
        (png(PIXELS) * 65, (3, 2, 4), [], "has 65 PNG files, expected 1 to 64"),
    ],
)
def test_what_is_no_such_picture_is_an_error(data, shape, mapping, text):
    with pytest.raises(ValueError, match=text):
        decode(data, shape, mapping)


def test_agents_that_send_png_and_numbers_are_images():
    floats = np.linspace(0, 1, 24, dtype=np.float32).reshape(3, 2, 4)
    port = free_port()

    def both(pixels):
        return agent(0, visual(png(pixels)), vector(*floats.ravel(), shape=[3, 2, 4], name="heat"))

    StandIn(
        port, [says(both(PIXELS), new=hybrid()), says(both(255 - PIXELS)), says(agent(0, visual(b""), visual(b"")))]
    )
    game = load_game(f"unity-port:{port}")({}, {}, 1, 0, 0)
    assert [(s.name, list(s.shape), s.dtype) for s in game.describe({}).behaviors[0].sensors] == [
        ("camera", [2, 4, 3], 3),
        ("heat", [2, 4, 3], 1),
    ]
    rest = [ActArrays(np.zeros((1, 1), np.float32), np.empty((1, 0), np.int32))]
    for step, pixels in ((game.observe()[0], PIXELS), (game.step(rest)[0], 255 - PIXELS)):
        assert step.observations[0].tolist() == [pixels.tolist()]
        assert step.observations[1].tobytes() == floats.transpose(1, 2, 0).tobytes()
    with pytest.raises(GameError, match="observation 0 of agent 0 has 0 PNG files, expected 1 to 64"):
        game.step(rest)
