"""Sensors that are images are seen with their shape and channels, through convolutions."""

from functools import partial

import numpy as np
import pytest
import torch

from joybridge.config.config import Config, PolicyConfig
from joybridge.config.errors import ConfigError
from joybridge.layouts import ActionSpace
from joybridge.policy.actor import make_actors
from joybridge.policy.scaling import make_scaling
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.images import Image, find_images
from joybridge.ppo.loss import Batch
from joybridge.ppo.networks import Network
from joybridge.ppo.schedule import Coefficients
from joybridge.ppo.update import Learner
from joybridge.simulator import sensor
from joybridge.simulator.catalog import load_games
from tests.support.games import PLACES

SENSORS = [
    sensor("place", [2]), sensor("camera", [5, 4, 3], dtype=np.uint8), sensor("table", [2, 2]),
    sensor("map", [3, 3], dtype=np.uint8),
]  # fmt: skip
IMAGES = [Image(2, 5, 4, 3), Image(66, 3, 3, 1)]
FRAME = 75


def test_images_are_found_by_their_shapes_and_others_are_refused():
    assert find_images("player", "simple", SENSORS) == IMAGES
    assert find_images("player", "none", SENSORS) == []
    with pytest.raises(ConfigError, match=r"nature, which needs 36 x 36 pixels, but sensor 'camera' has 5 x 4; set im"):
        find_images("player", "nature", SENSORS)
    with pytest.raises(ConfigError, match=r"no sensor is an image of shape \[.*\] \(place \[2\], table \[2, 2\]\)"):
        find_images("player", "impala", [SENSORS[0], SENSORS[2]])


@pytest.mark.parametrize("kind", ["none", "running"])
def test_pixels_of_bytes_are_scaled_to_0_to_1_and_other_numbers_as_the_policy_says(kind):
    scaling = make_scaling("player", kind, SENSORS, IMAGES)
    assert scaling is not None
    frames = np.zeros((2, FRAME), np.float32)
    frames[:, [0, 2, 61, 62, 74]] = [[100.0, 255.0, 51.0, 30.0, 102.0], [300.0, 255.0, 51.0, 30.0, 102.0]]
    scaling.watch(frames)
    scaling.refresh()
    seen = scaling.apply(frames)[:, [0, 2, 61, 62, 74]]
    numbers = [[100.0, 30.0], [300.0, 30.0]] if kind == "none" else [[-1.0, 0.0], [1.0, 0.0]]
    np.testing.assert_allclose(seen[:, [0, 3]], numbers, atol=1e-5)
    np.testing.assert_allclose(seen[:, [1, 2, 4]], [[1.0, 0.2, 0.4]] * 2, rtol=1e-6)


def test_the_frames_of_a_stack_are_channels_of_one_image_and_other_numbers_pass_by():
    encoder = ImageEncoder("simple", IMAGES, FRAME, 2, "relu")
    observations = torch.rand(7, 2 * FRAME, generator=torch.Generator().manual_seed(0))
    old, new = observations[:, :FRAME], observations[:, FRAME:]
    features = encoder(observations)
    others = [part for frame in (old, new) for part in (frame[:, :2], frame[:, 62:66])]
    torch.testing.assert_close(features[:, :12], torch.cat(others, 1))
    camera = torch.cat([frame[:, 2:62].view(7, 5, 4, 3).permute(0, 3, 1, 2) for frame in (old, new)], 1)
    count = 32 * 2 * 1  # channels of 5 x 4 pixels, halved twice
    torch.testing.assert_close(features[:, 12 : 12 + count], encoder.convolutions[0](camera).flatten(1))
    board = torch.stack([frame[:, 66:].view(7, 3, 3) for frame in (old, new)], 1)
    torch.testing.assert_close(features[:, 12 + count :], encoder.convolutions[1](board).flatten(1))


@pytest.mark.parametrize(("kind", "size", "others"), [("simple", 6, 0), ("nature", 36, 3), ("impala", 9, 3)])
@pytest.mark.parametrize("shared", [True, False])
def test_every_convolution_learns_in_one_tower_and_in_two(kind, size, others, shared):
    frame = others + size * size * 2
    make = partial(ImageEncoder, kind, [Image(others, size, size, 2)], frame, 1, "elu")
    network = Network(frame, ActionSpace(1, (3,)), [8], shared, 1, "elu", make)
    learner = Learner("player", network, branches=["b"], gaussians=["x"], autograd=False)
    assert not isinstance(learner.gradient, ClosedFormGradient)
    normal = partial(torch.randn, generator=torch.Generator().manual_seed(0))
    batch = Batch(
        normal((4, frame)), normal((4, 1)), torch.ones(4, 1, dtype=torch.long), None, normal(4), normal(4), normal(4),
        normal(4),
    )  # fmt: skip
    learner.gradient(batch, torch.arange(len(batch)), Coefficients(1e-3, 0.2, 0.01))
    silent = [
        name for name, parameter in network.named_parameters() if parameter.grad is None or not parameter.grad.any()
    ]
    assert silent == []
    assert len([name for name, _ in network.named_parameters() if "convolutions" in name]) >= 4 * (1 if shared else 2)


def test_a_policy_of_a_game_with_an_image_acts_on_it():
    spec = load_games(PLACES)["hybrid"].describe({"size": "large", "masks": "off"})
    (actor,) = make_actors(Config(game="hybrid", policy=PolicyConfig(image_encoder="simple", frame_stack=1)), spec)
    frames = np.zeros((2, actor.encoder.size), np.float32)
    frames[1, 3:13] = 1.0  # place 2, count 1, image 10, lamps 3
    values = actor.values(frames)
    assert values[0] != values[1]
    assert {name.split(".")[1] for name in actor.state() if name.startswith("actor.")} == {"images", "hidden", "head"}
