"""The layout `map-WxH`: cells are places in an image, and their logits come from the convolutions."""

import re
from functools import partial

import numpy as np
import pytest
import torch

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.layouts import ActionSpace, JointTable, Map, make_layouts
from joybridge.play.policy_outputs import policy_outputs
from joybridge.policy.actor import make_actors
from joybridge.policy.config_fit import check_fit
from joybridge.policy.player import PolicyPlayer
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.distributions import FORBIDDEN
from joybridge.ppo.fast.kernels import draw_noise
from joybridge.ppo.images import Image, check_maps
from joybridge.ppo.loss import Actions, Batch, autograd_gradient, joint_log_probs
from joybridge.ppo.networks import Network, Towers
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.pointing import Pointer
from joybridge.ppo.sampling import sample_actions
from joybridge.ppo.schedule import Coefficients
from joybridge.simulator import axis, behavior, branch, button, image, sensor
from joybridge.v1 import bridge_pb2 as pb
from tests.test_actions import make_device

DEVICE = make_device([(-1, 1), (0, 4)], [2, 2, 3])


def cells(name: str, device: pb.Device = DEVICE) -> tuple[JointTable, np.ndarray]:
    """Return the branch of a map and what it sets the axes to, [height, width, 2]."""
    table = make_layouts(name, device)[""].discrete[0]
    assert isinstance(table, JointTable) and table.map is not None and table.positions is not None
    return table, table.positions.reshape(table.map.height, table.map.width, 2)


def test_cells_are_parts_of_the_field_row_after_row_from_the_top_left():
    table, places = cells("map-4x2")
    assert table.map == Map(2, 4, relative=False)
    assert places[0, :, 0].tolist() == [-0.75, -0.25, 0.25, 0.75]
    assert places[:, 0, 1].tolist() == [3.0, 1.0]


def test_cells_are_where_axes_of_another_way_say():
    _, turned = cells("map-4x2", pb.Device(axes=[axis("x", way="left"), axis("y", way="down")]))
    _, plain = cells("map-4x2", pb.Device(axes=[axis("x"), axis("y")]))
    np.testing.assert_array_equal(turned, -plain)


def test_cells_that_are_relative_reach_from_full_deflection_to_full_deflection():
    table, places = cells("map-5x3-relative")
    assert table.map == Map(3, 5, relative=True)
    assert places[1].tolist() == [[-1, 2], [-0.5, 2], [0, 2], [0.5, 2], [1, 2]]
    assert places[:, 2, 1].tolist() == [4.0, 2.0, 0.0]


def test_buttons_are_those_of_bucket_and_may_have_other_layouts():
    assert make_layouts("map-4x2", DEVICE)[""].names(DEVICE) == (["axis0+axis1", "branch2", "branch0+branch1"], [])
    mixed = make_layouts("map-4x2, branch0=threshold-0.0, branch1=hybrid", DEVICE)[""]
    assert mixed.names(DEVICE) == (["axis0+axis1", "branch2", "branch1"], ["branch0"])
    assert mixed.space.maps == ((0, Map(2, 4, relative=False)),)
    three = make_device([(-1, 1), (0, 4), (0, 1)], [2])
    one_of_three = make_layouts("bucket-5, axis1=map-4x2, axis2=map-4x2", three)[""]
    assert one_of_three.names(three) == (["axis0", "branch0", "axis1+axis2"], [])
    assert one_of_three.space.maps == ((2, Map(2, 4, relative=False)),)


@pytest.mark.parametrize("name", ["map", "map-4", "map-1x9", "map-4x4x4", "map-101x100", "map-4x4-mu", "map-4×4"])
def test_names_that_are_no_maps_are_refused(name):
    with pytest.raises(
        ConfigError, match=rf"unknown layout '{name}', expected map-WxH or map-WxH-relative, .* 10000 c"
    ):
        make_layouts(name, DEVICE)


def test_a_device_without_two_axes_is_refused_with_what_to_write():
    with pytest.raises(ConfigError, match=r"'map-4x4' cannot express this device: .* and there are 3; .* x=map-16x10"):
        make_layouts("map-4x4", make_device([(-1, 1)] * 3, []))
    with pytest.raises(ConfigError, match="and there are 1; take bucket-N"):
        make_layouts("map-4x4", make_device([(-1, 1)], []))


def test_demonstrated_places_become_the_nearest_cells():
    layout = make_layouts("map-7x5", DEVICE)[""]
    act = ActArrays(np.zeros((35, 2), np.float32), np.zeros((35, 3), np.int32))
    chosen = np.column_stack([np.arange(35), np.arange(35) % 3, np.arange(35) % 3])
    layout.write(np.zeros((35, 0), np.float32), chosen, act)
    act.axes[:] += np.random.default_rng(0).uniform(-0.13, 0.13, (35, 2)).astype(np.float32)
    continuous, discrete = layout.read(act)
    assert continuous.shape == (35, 0)
    np.testing.assert_array_equal(discrete, chosen)


# ------------------------------------------------------------------------------------------------ configurations

FIELD, FOVEA = image("field", 24, 32), image("fovea", 24, 24, centered=True)


def game(*sensors: pb.Sensor) -> pb.GameSpec:
    player = behavior(
        "player",
        sensors=[sensor("speed", [2]), *sensors],
        axes=[axis("x"), axis("y")],
        branches=[button("a"), branch("gear", ["low", "middle", "high"])],
    )
    return pb.GameSpec(name="seen", behaviors=[player])


@pytest.mark.parametrize(
    ("layout", "sensors", "message"),
    [
        (
            "map-4x4",
            (),
            "player: the layout is a map in an image that shows the whole field, but it sees no image; "
            "take joint-N, which makes one choice for two axes from numbers",
        ),
        ("map-4x4", (FOVEA,), "its images are centered on the pointer; take map-WxH-relative if"),
        ("map-5x5-relative", (FIELD,), "centered on the pointer, but none of its images is; take map-WxH if"),
    ],
)
def test_a_map_without_its_image_is_refused(layout, sensors, message):
    for check in (check_fit, make_actors):
        with pytest.raises(ConfigError, match=re.escape(message)):
            check(Config(game="seen", layout=layout), game(*sensors))


@pytest.mark.parametrize(
    ("layout", "settings", "message"),
    [
        ("map-4x4", {}, "has no maps for the layout; choose one without map-WxH"),
        ("hybrid", {"remember_acts": 1}, "sees sensors alone; set remember_acts to 0"),
    ],
)
def test_a_network_of_ones_own_is_refused_what_it_does_not_have(layout, settings, message):
    config = Config(game="seen", layout=layout, policy=PolicyConfig(network="torch.nn:Identity", **settings))
    for check in (check_fit, make_actors):
        with pytest.raises(ConfigError, match=f"network: torch.nn:Identity {message}"):
            check(config, game(FIELD))


def test_pixels_that_are_plain_numbers_are_no_image_to_point_into():
    config = Config(game="seen", layout="map-4x4", policy=PolicyConfig(image_encoder="none"))
    with pytest.raises(ConfigError, match="it sees no image"):
        check_fit(config, game(FIELD))
    check_maps("player", [Map(4, 4, relative=False)], [Image(24, 24, 1, centered=True), Image(24, 32, 1)])


def test_each_map_points_into_the_images_that_show_it():
    encoder = ImageEncoder("auto", [Image(24, 24, 1, centered=True), Image(24, 32, 1), Image(32, 32, 1)], 0, 1, "relu")
    assert Pointer(Map(4, 4, relative=False), encoder).images == [1, 2]
    assert Pointer(Map(5, 5, relative=True), encoder).images == [0]


# ---------------------------------------------------------------------------------------------------- networks


@pytest.mark.parametrize("kind", ["windows", "simple", "nature", "impala"])
@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize(("height", "width"), [(40, 64), (39, 57)])
def test_the_logit_of_a_cell_is_of_its_place_in_the_image(kind, relative, height, width):
    encoder = ImageEncoder(kind, [Image(height, width, 1, relative)], 0, 1, "relu")
    form = Map(7, 11, relative)
    pointer = Pointer(form, encoder)
    shares = [np.linspace(0, 1, n) if relative else (np.arange(n) + 0.5) / n for n in (7, 11)]
    channels = [stage[0] for stage in encoder.bodies[0].maps]
    for side, pixels in enumerate((height, width)):
        for stage in range(len(channels)):
            # A stage of which one channel says how far down, or to the right, each of its places is in the image.
            maps = [torch.zeros(1, *shape) for shape in encoder.bodies[0].maps]
            places = encoder.bodies[0].places(stage)[side]
            maps[stage][0, 2] = torch.from_numpy(places).float().view((-1, 1) if side == 0 else (1, -1))
            wanted = torch.zeros(1, sum(channels))
            wanted[0, sum(channels[:stage]) + 2] = 1.0
            logits = pointer([maps], wanted).detach().view(7, 11)
            truth = np.clip(shares[side] * pixels, places[0], places[-1])
            seen = logits[:, 0] if side == 0 else logits[0]
            np.testing.assert_allclose(seen, truth, atol=1e-3)
            assert places[0] < pixels / 2 < places[-1] or len(places) == 1
            assert abs(places[0] + places[-1] - pixels) < 8  # about in the middle of the image


def test_the_middle_of_a_window_is_where_a_spot_excites_it_most():
    encoder = ImageEncoder("windows", [Image(40, 61, 1)], 0, 1, "relu")
    body = encoder.bodies[0]
    for parameter in body.parameters():
        torch.nn.init.constant_(parameter, 0.01)
    rows, columns = body.places(1)
    for row, column in ((0, 0), (2, 3), (len(rows) - 1, 1)):
        pixels = torch.zeros(1, 40, 61, 1)
        pixels[0, int(np.clip(rows[row], 0, 39)), int(np.clip(columns[column], 0, 60))] = 1.0
        found = body.see(pixels)[1][0, 0]
        assert found[row, column] == found.max()


def actor(layout: str = "map-6x4, a=hybrid", **more: object):
    policy = PolicyConfig(frame_stack=1, hidden_sizes=[16], **more)
    (made,) = make_actors(Config(game="seen", layout=layout, policy=policy), game(FIELD, FOVEA))
    return made


def seen(rows: int, seed: int = 0) -> Observations:
    rng = np.random.default_rng(seed)
    shapes = ((rows, 1, 24, 32, 1), (rows, 1, 24, 24, 1))
    pictures = tuple(torch.from_numpy(rng.integers(0, 256, shape, np.uint8)) for shape in shapes)
    return Observations(torch.from_numpy(rng.normal(size=(rows, 2)).astype(np.float32)), pictures)


@pytest.mark.parametrize("layout", ["map-6x4, a=hybrid", "hybrid, x=map-6x4, y=map-6x4", "map-6x4, gear=joint-2"])
@pytest.mark.parametrize("masked", [False, True])
def test_the_log_probability_is_the_sum_over_the_map_and_all_other_branches(layout, masked):
    made, rows = actor(layout), 64
    network, space = made.network, made.layout.space
    observations = seen(rows)
    masks = None
    if masked:  # the first gear is forbidden
        allowed = [np.ones((rows, 2), bool), np.tile([False, True, True], (rows, 1))]
        masks = np.zeros((rows, len(space.branches), space.widest), np.float32)
        for index, mask in enumerate(made.layout.masks(allowed)):
            masks[:, index, : mask.shape[1]] = np.where(mask, 0.0, FORBIDDEN)
    noise = draw_noise(np.random.default_rng(1), (rows, space.continuous), (rows, len(space.branches)))
    with torch.inference_mode():
        heads = network.heads(observations)[0]
        action = sample_actions(network, heads, masks, noise, deterministic=False)
        outputs = network(observations)
    chosen = torch.from_numpy(action.discrete)
    given = None if masks is None else torch.from_numpy(masks)
    batch = Actions(observations, torch.from_numpy(action.continuous), chosen, given)
    joint, _, entropies = joint_log_probs(outputs, network.log_variance, batch)
    np.testing.assert_allclose(action.log_probs, joint.detach().numpy(), atol=1e-4)
    each = torch.stack(
        [
            torch.log_softmax(outputs.logits[:, b] + (0 if given is None else given[:, b]), 1).gather(
                1, chosen[:, b, None]
            )
            for b in range(len(space.branches))
        ]
    ).sum((0, 2))
    torch.testing.assert_close(joint, each)
    (branch_of_map,) = (index for index, _ in space.maps)
    assert entropies[branch_of_map] == pytest.approx(np.log(24), abs=0.1)  # an untrained policy points anywhere
    assert len(set(action.discrete[:, branch_of_map])) > 10
    if masked:
        act = ActArrays(np.zeros((rows, 2), np.float32), np.zeros((rows, 2), np.int32))
        made.layout.write(action.continuous, action.discrete, act)
        assert set(act.choices[:, 1]) == {1, 2}


@pytest.mark.parametrize("shared", [True, False])
def test_every_parameter_of_a_network_with_maps_learns(shared):
    images = [Image(24, 32, 1), Image(24, 24, 2, centered=True)]
    space = ActionSpace(
        1, (3, 24, 7, 25), ordinal=(2,), maps=((1, Map(4, 6, relative=False)), (3, Map(5, 5, relative=True)))
    )
    network = Network(2, space, Towers([8], shared, "elu"), 1, [ImageEncoder("simple", images, 2, 1, "elu")])
    draw = partial(torch.randn, generator=torch.Generator().manual_seed(0))
    rows, rng = 32, np.random.default_rng(0)
    pictures = tuple(torch.from_numpy(rng.integers(0, 256, (rows, 1, *image.shape), np.uint8)) for image in images)
    chosen = torch.from_numpy(rng.integers(0, space.branches, (rows, 4)))
    drawn = [draw(rows) for _ in range(4)]
    batch = Batch(Observations(draw(rows, 2), pictures), draw(rows, 1), chosen, None, *drawn)
    autograd_gradient(network, batch, torch.arange(rows), Coefficients(1e-3, 0.2, 0.01))
    silent = [name for name, each in network.named_parameters() if each.grad is None or not each.grad.any()]
    assert silent == []
    outputs = network(batch.observations)
    assert outputs.logits.shape == (rows, 4, 25) and outputs.mean.shape == (rows, 1)
    probable = torch.softmax(outputs.logits, 2)
    for index, size in enumerate(space.branches):
        assert (probable[:, index, :size] > 0).all() and not probable[:, index, size:].any()


def test_what_is_seen_where_decides_where_the_map_points():
    made = actor()
    observations = seen(2)
    field = observations.images[0]
    assert isinstance(field, torch.Tensor)
    field[:] = 0
    field[0, 0, :8, 24:, 0] = 255  # a bright patch at the top right
    network = made.network
    assert network.pointers is not None
    with torch.inference_mode():
        (pointer,) = network.pointers.pointers
        pointer.bias.fill_(1.0)  # looks for whatever excites the convolutions
        logits = network(observations).logits[:, 0, :24].view(2, 4, 6)
    difference = (logits[0] - logits[1]).abs()
    assert difference[:2, 3:].max() > 10 * difference[2:, :3].max()


def test_people_are_shown_the_chances_of_all_places():
    player, rng = PolicyPlayer(actor(), 1, 0, deterministic=True), np.random.default_rng(0)
    pixels, over = [rng.integers(0, 256, (1, 24, width, 1), np.uint8) for width in (32, 24)], np.zeros(1, bool)
    step = StepArrays([np.zeros((1, 2), np.float32), *pixels], np.zeros((1, 1), np.float32), over, over)
    player.begin(step)
    (lane,) = policy_outputs(player, game(FIELD, FOVEA), [step])["lanes"]
    places, *others = lane["branches"]
    assert (places["map"]["height"], places["map"]["width"], len(places["map"]["chances"])) == (4, 6, 24)
    assert sum(places["map"]["chances"]) == pytest.approx(1, abs=1e-3)
    likeliest = max(places["choices"], key=lambda choice: choice["chance"])
    assert max(places["map"]["chances"]) == pytest.approx(likeliest["chance"], abs=1e-4)
    assert others and not any("map" in other for other in others)
