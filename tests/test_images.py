"""Sensors that are images are seen with their shape and channels, through convolutions."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import nn

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.layouts import ActionSpace
from joybridge.policy.actor import make_actors
from joybridge.policy.config_fit import check_fit
from joybridge.policy.encoder import push_frames
from joybridge.ppo.convolutions import FEATURES, GAIN, WHITE, Convolutions, DifferenceConvolution, ImageEncoder, Moments
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.history import History
from joybridge.ppo.images import MIN_PIXELS, Image, encoder_kind, find_images
from joybridge.ppo.loss import Batch
from joybridge.ppo.networks import Network, Towers
from joybridge.ppo.observation import Observation
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients
from joybridge.ppo.update import Learner
from joybridge.simulator import image, sensor
from joybridge.simulator.catalog import load_games
from tests.support.games import PLACES

SENSORS = [
    sensor("place", [2]),
    sensor("camera", [5, 4, 3], dtype=np.uint8),
    sensor("table", [2, 2]),
    sensor("map", [3, 3], dtype=np.uint8),
]
IMAGES = {"camera": Image(5, 4, 3), "map": Image(3, 3, 1)}


def test_images_are_found_by_their_shapes_and_others_are_refused():
    assert find_images("player", "simple", SENSORS) == IMAGES
    assert find_images("player", "none", SENSORS) == {}
    assert find_images("player", "auto", SENSORS) == {}  # the game does not call them images
    with pytest.raises(ConfigError, match=r"nature, which needs 36 x 36 pixels, but sensor 'camera' has 5 x 4; set im"):
        find_images("player", "nature", SENSORS)
    with pytest.raises(
        ConfigError, match=r"type uint8 and shape \[.*\] \(place \[2\], table \[2, 2\]\); set image_encoder=auto"
    ):
        find_images("player", "impala", [SENSORS[0], SENSORS[2]])


def test_what_a_game_calls_an_image_is_one_without_a_word_in_the_configuration():
    sensors = [SENSORS[0], image("screen", 24, 32), image("small", 6, 6, channels=3)]
    assert find_images("player", "auto", sensors) == {"screen": Image(24, 32, 1), "small": Image(6, 6, 3)}
    assert encoder_kind("auto", Image(24, 32, 1)) == "windows" and encoder_kind("auto", Image(6, 6, 3)) == "simple"
    assert find_images("player", "none", sensors) == {}


def test_black_images_have_the_features_and_the_gradient_that_each_of_them_would_have():
    body = Convolutions("moments", Image(24, 20, 1), 2, "relu")
    with torch.no_grad():
        for parameter in body.parameters():  # biases that are not 0 give black images features of their own
            parameter.add_(0.1)
    stacks = torch.from_numpy(bytes_of((7, 2, 24, 20, 1)))
    stacks[[0, 3, 6]] = 0
    stacks[5, 0] = 0  # only one of its pictures is black
    found = []
    for parts in ([stacks], stacks.split(1)):  # all at once, or one after the other
        body.zero_grad()
        features = torch.cat([body(part)[0] for part in parts])
        (features**2).mean().backward()
        found.append((features.detach(), [parameter.grad for parameter in body.parameters()]))
    torch.testing.assert_close(*found)
    assert torch.equal(found[0][0][0], found[0][0][3]) and not torch.equal(found[0][0][0], found[0][0][1])
    assert all(len(values) == 7 for values in body(stacks)[1])
    assert body(torch.zeros_like(stacks))[0].shape == (7, body.features)


@pytest.mark.parametrize("kind", MIN_PIXELS)
def test_each_encoder_sees_the_smallest_image_that_it_is_said_to(kind):
    size = MIN_PIXELS[kind]
    encoder = ImageEncoder(kind, [Image(size, size, 1)], 0, 1, "relu")
    encoded = encoder(Observations(torch.zeros(2, 0), (torch.zeros(2, 1, size, size, 1),)))
    assert encoded.features.shape == (2, encoder.features)


def bytes_of(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def test_the_pictures_of_a_stack_are_channels_of_one_image_and_numbers_pass_by():
    encoder = ImageEncoder("simple", [*IMAGES.values()], 12, 2, "relu")
    numbers = torch.rand(7, 12, generator=torch.Generator().manual_seed(0))
    camera, board = (torch.from_numpy(bytes_of((7, 2, *IMAGES[name].shape))) for name in IMAGES)
    features = encoder(Observations(numbers, (camera, board))).features
    torch.testing.assert_close(features[:, :12], numbers)
    pixels = torch.cat([camera[:, 0], camera[:, 1]], 3) / WHITE
    count = 32 * 2 * 1  # channels of 5 x 4 pixels, halved twice
    torch.testing.assert_close(features[:, 12 : 12 + count], encoder.bodies[0].see(pixels)[-1].flatten(1))
    pixels = torch.cat([board[:, 0], board[:, 1]], 3) / WHITE
    torch.testing.assert_close(features[:, 12 + count :], encoder.bodies[1].see(pixels)[-1].flatten(1))


@pytest.mark.parametrize("kind", MIN_PIXELS)
@pytest.mark.parametrize("frames", [2, 3])
def test_differences_between_frames_are_other_weights_of_the_same_pictures(kind, frames):
    size, colors = 40, 3
    encoder = ImageEncoder(kind, [Image(size, size, colors)], 0, frames, "elu", True)
    stacks = torch.from_numpy(bytes_of((5, frames, size, size, colors)))
    body = encoder.bodies[0]
    first = body.stages[0]
    assert isinstance(first, nn.Sequential) and isinstance(first[0], DifferenceConvolution)
    inner = first[0].convolution
    pixels = stacks.permute(0, 1, 4, 2, 3).float() / body.white
    changes = [GAIN * (after - before) for before, after in pairwise(pixels.unbind(1))]
    expected = first[1:](inner(torch.cat([*changes, pixels[:, -1]], 1)))
    torch.testing.assert_close(body(stacks)[1][0], expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("kind", "size", "numbers"),
    [("windows", 24, 3), ("moments", 24, 0), ("simple", 6, 0), ("nature", 36, 3), ("impala", 9, 3)],
)
@pytest.mark.parametrize(("shared", "encoders"), [(True, 1), (False, 1), (False, 2)])
def test_every_convolution_learns_shared_or_not(kind, size, numbers, shared, encoders):
    made = [ImageEncoder(kind, [Image(size, size, 2)], numbers, 1, "elu") for _ in range(encoders)]
    network = Network(numbers, ActionSpace(1, (3,)), Towers([8], shared, "elu"), 1, made)
    learner = Learner("player", network, branches=["b"], gaussians=["x"], autograd=False)
    assert not isinstance(learner.gradient, ClosedFormGradient)
    normal = partial(torch.randn, generator=torch.Generator().manual_seed(0))
    rows, chosen = 16, torch.ones(16, 1, dtype=torch.long)
    seen = Observations(normal((rows, numbers)), (torch.from_numpy(bytes_of((rows, 1, size, size, 2))),))
    drawn = [normal(rows) for _ in range(4)]
    batch = Batch(seen, normal((rows, 1)), chosen, None, *drawn)
    learner.gradient(batch, torch.arange(len(batch)), Coefficients(1e-3, 0.2, 0.01))
    silent = [
        name for name, parameter in network.named_parameters() if parameter.grad is None or not parameter.grad.any()
    ]
    assert silent == []
    assert len([name for name, _ in network.named_parameters() if "convolutions" in name]) >= 4 * encoders


def test_threads_share_the_gradient_of_images():
    found, used = [], []
    for threads in (1, 2, 2):
        encoder = ImageEncoder("windows", [Image(24, 24, 1)], 3, 1, "elu")
        network = Network(3, ActionSpace(1, (3,)), Towers([8], True, "elu"), 1, [encoder])
        encoder.register_forward_hook(lambda *_: used.append(torch.get_num_threads()))
        learner = Learner("player", network, branches=["b"], gaussians=["x"], autograd=False, threads=threads)
        normal = partial(torch.randn, generator=torch.Generator().manual_seed(0))
        chosen = torch.ones(64, 1, dtype=torch.long)
        seen = Observations(normal((64, 3)), (torch.from_numpy(bytes_of((64, 1, 24, 24, 1))),))
        batch = Batch(seen, normal((64, 1)), chosen, None, *(normal(64) for _ in range(4)))
        before = torch.get_num_threads()
        learner.gradient(batch, torch.arange(64), Coefficients(1e-3, 0.2, 0.01))
        assert torch.get_num_threads() == before
        found.append(torch.cat([each.grad.flatten() for each in network.parameters() if each.grad is not None]))
    assert used == [1, 2, 2] and torch.equal(found[1], found[2])
    torch.testing.assert_close(found[0], found[1])


def test_moments_say_how_much_a_map_finds_and_where_to_a_part_of_a_place():
    """Three numbers of a spot between two places, of another map with nothing in it, and of one that is full."""
    values = torch.zeros(1, 3, 4, 8)
    values[0, 0, 1, 6] = values[0, 0, 1, 7] = 100.0  # a spot on the edge between the last two columns
    values[0, 2] = -100.0
    x, y, mass = Moments(4, 8)(values)[0].view(3, 3)
    torch.testing.assert_close(x, torch.tensor([2 * 0.75, 0.0, 0.0]), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(y, torch.tensor([2 * -0.25, 0.0, 0.0]), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(mass, torch.tensor([1.0, 0.0, 1.0]), rtol=1e-4, atol=1e-4)


def test_features_are_those_of_windows_and_the_moments_of_each_map():
    """The first features are what windows give with the same weights."""
    torch.manual_seed(0)
    body, stacks = Convolutions("moments", Image(32, 40, 1), 2, "relu"), torch.from_numpy(bytes_of((5, 2, 32, 40, 1)))
    plain = Convolutions("windows", Image(32, 40, 1), 2, "relu")
    plain.load_state_dict(body.state_dict())  # moments have no parameters
    features, maps = body(stacks)
    assert features.shape == (5, body.features) and body.features == FEATURES + 3 * (16 + 32)
    assert torch.equal(features[:, :FEATURES], plain(stacks)[0])
    first = body.moments[0](maps[0])
    assert torch.equal(features[:, FEATURES:][:, : 3 * 16], first) and first.std() > 0


@pytest.mark.parametrize(
    ("kind", "height", "width"),
    [
        ("windows", 32, 32),
        ("windows", 40, 64),
        ("windows", 16, 17),
        ("windows", 84, 30),
        ("simple", 9, 6),
        ("nature", 84, 84),
        ("nature", 64, 40),
        ("impala", 17, 12),
    ],
)
def test_every_pixel_of_an_image_is_seen(kind, height, width):
    encoder = ImageEncoder(kind, [Image(height, width, 1)], 0, 1, "elu")
    pixels = torch.rand(1, height, width, 1, generator=torch.Generator().manual_seed(0)).requires_grad_()
    encoder.bodies[0].see(pixels)[-1].sum().backward()
    assert pixels.grad is not None and pixels.grad.all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"image_encoder": "none"}, "there are no images; leave it out"),
        ({"image_encoder": "simple", "frame_stack": 1}, "frame_stack is 1; set it to 2 or more"),
        ({"network": "torch.nn:Identity"}, "torch.nn:Identity sees the pictures as they are"),
    ],
)
def test_differences_of_no_frames_are_refused(settings, message):
    spec = load_games(PLACES)["hybrid"].describe({"size": "large", "masks": "off"})
    config = Config(game="hybrid", policy=PolicyConfig(frame_differences=True, **settings))
    for check in (check_fit, make_actors):
        with pytest.raises(ConfigError, match=f"player: frame_differences: {message}"):
            check(config, spec)


def test_a_policy_of_a_game_with_an_image_acts_on_it():
    spec = load_games(PLACES)["hybrid"].describe({"size": "large", "masks": "off"})
    (actor,) = make_actors(Config(game="hybrid", policy=PolicyConfig(image_encoder="simple", frame_stack=1)), spec)
    shape = (2, 1, *actor.encoder.images["image"].shape)
    pictures = np.zeros(shape, np.uint8)
    pictures[1] = 255
    values = actor.values(Observation(np.zeros((2, actor.encoder.size), np.float32), (pictures,)))
    assert values[0] != values[1]
    assert {name.split(".")[0] for name in actor.state()} >= {"encoders", "actor"}


# ------------------------------------------------------------------------------------------------------ stacks

STEPS, LANES, STACK = 6, 4, 3
SHAPE, PICTURE = (2, 3, 1), Image(2, 3, 1)


def made_step(ended: np.ndarray, deciding: np.ndarray | None) -> StepArrays:
    over = np.zeros(LANES, bool)
    over[ended] = True
    return StepArrays(
        observations=[],
        rewards=np.zeros((LANES, 1), np.float32),
        terminated=over,
        truncated=np.zeros(LANES, bool),
        masks=None,
        deciding=deciding,
        ended=ended.astype(np.int32),
        final_observations=None,
        metrics=None,
    )


def naive(now: np.ndarray, pictures: np.ndarray, step: StepArrays) -> np.ndarray:
    """Return the stacks after a step, one lane after the other."""
    after = now.copy()
    for lane in range(LANES):
        over = bool(step.terminated[lane])
        if step.deciding is not None and not step.deciding[lane] and not over:
            continue
        older = np.zeros_like(now[lane, 1:]) if over else now[lane, 1:]
        after[lane] = np.concatenate([older, pictures[lane][None]])
    return after


@pytest.mark.parametrize("waits", [False, True])
def test_stacks_that_are_gathered_equal_stacks_that_are_copied(waits):
    rng = np.random.default_rng(1)
    history, whole = History(STEPS, LANES, PICTURE, STACK), slice(None)
    first = bytes_of((LANES, *SHAPE), 2)
    history.begin(first, whole)
    expected = np.zeros((LANES, STACK, *SHAPE), np.uint8)
    expected[:, -1] = first
    for update in range(3):
        seen = []
        for t in range(STEPS):
            np.testing.assert_array_equal(history.window(t).gather(), expected)
            seen.append(expected)
            deciding = rng.random(LANES) < 0.6 if waits else None
            step = made_step(np.flatnonzero(rng.random(LANES) < 0.2), deciding)
            pictures = bytes_of((LANES, *SHAPE), 10 * update + t)
            now, after, new = history.push(t, whole, pictures)
            push_frames(now, new, step, after)
            expected = naive(expected, pictures, step)
        marked = rng.random((STEPS, LANES)) < 0.5
        np.testing.assert_array_equal(history.at(*np.nonzero(marked)).gather(), np.stack(seen)[marked])
        history.restart()
    fresh = History(STEPS, LANES, PICTURE, STACK)
    fresh.load(history.window(0).gather())
    np.testing.assert_array_equal(fresh.window(0).gather(), expected)


def test_a_rollout_of_pictures_takes_little_more_memory_than_its_bytes():
    history = History(64, 8, Image(84, 84, 1), 3)
    assert history.pictures.nbytes + history.sources.nbytes <= 1.1 * 64 * 8 * 84 * 84
