"""What does not fit between a trained network and a game is named in the words of the game and the configuration."""

import numpy as np
import pytest

from joybridge.layouts import ActionSpace
from joybridge.policy.fit import misfits
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.images import Image
from joybridge.ppo.networks import MemoryKind, Network, Towers
from joybridge.simulator import image, sensor

SENSORS = [sensor("hand", [3]), sensor("target", [1])]


def network(observation=8, continuous=2, branches=(2,), hidden=(8, 6), shared=False, memory=None):
    made = Network(observation, ActionSpace(continuous, branches), Towers(hidden, shared, memory=memory), seed=0)
    return {name: tensor.numpy() for name, tensor in made.state_dict().items()}


def test_a_network_of_the_same_shape_fits():
    assert misfits(network(), network(), SENSORS, 2) == []


@pytest.mark.parametrize(
    ("before", "difference"),
    [
        ({"observation": 20}, "the sensors had 20 numbers, now 8 (2 frames of hand 3, target 1)"),
        ({"hidden": (8,)}, "hidden_sizes was [8], now [8, 6]"),
        ({"hidden": (4, 4)}, "hidden_sizes was [4, 4], now [8, 6]"),
        ({"shared": True}, "shared_body was true, now false"),
        ({"memory": MemoryKind("lstm", 5)}, "memory was lstm of 5, now none"),
        ({"memory": MemoryKind("gru", 5)}, "memory was gru of 5, now none"),
        (
            {"continuous": 1},
            "the network had 1 Gaussians and 2 outputs of branches for actions, now 2 Gaussians and 2 "
            "outputs of branches: the layout or the device differs",
        ),
    ],
)
def test_each_difference_has_a_phrase(before, difference):
    assert misfits(network(**before), network(), SENSORS, 2) == [difference]


def seeing(kind="simple", size=8, channels=1, frames=2, encoders=1):
    made = [ImageEncoder(kind, [Image(size, size, channels)], 3 * frames, frames, "relu") for _ in range(encoders)]
    network = Network(3 * frames, ActionSpace(2, (2,)), Towers([8]), seed=0, encoders=made)
    return {name: tensor.numpy() for name, tensor in network.state_dict().items()}


@pytest.mark.parametrize(
    ("before", "difference"),
    [
        ({}, None),
        (
            {"kind": "impala"},
            "image_encoder, network, frame_stack or an image was another one, now 2 frames of hand 3, view 64",
        ),
        (
            {"channels": 3},
            "image_encoder, network, frame_stack or an image was another one, now 2 frames of hand 3, view 64",
        ),
        ({"size": 12}, "the sensors had 294 features, now 134 (2 frames of hand 3, view 64)"),
        ({"encoders": 2}, "shared_encoder was false, now true"),
    ],
)
def test_each_difference_of_networks_that_see_images_has_a_phrase(before, difference):
    sensors = [SENSORS[0], image("view", 8, 8)]
    assert misfits(seeing(**before), seeing(), sensors, 2) == ([difference] if difference else [])


def test_an_unknown_network_is_one_of_another_version():
    later = network() | {"memory.weight": np.zeros((2, 2), np.float32)}
    assert misfits(later, network(), SENSORS, 2) == ["it is a network of another version of joybridge"]
