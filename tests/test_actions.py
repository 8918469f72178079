"""Layouts map every policy action to a legal device action, for any device."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, Codec, StepArrays, pack_act
from joybridge.layouts import CLIP, ActionSpace, Layout, make_layouts
from joybridge.layouts.bucket import bucket
from joybridge.layouts.threshold import threshold
from joybridge.v1 import bridge_pb2 as pb

NAMES = (
    "hybrid", "bucket-2", "bucket-11", "bucket-8-mu", "joint-2", "joint-3-mu", "ordinal-5", "threshold-0.0",
    "threshold-0.1", "threshold-0.5", "multiagent", "beta", "squashed, axis0=ordinal-3", "gsde-4",
    "compass-8", "laplace", "hybrid, axis0=bucket-5-mu, branch1=threshold-0.0",
    "bucket-3, axis0=hybrid, branch0=joint-2", "map-5x3", "bucket-4, axis0=map-3x2-relative, axis1=map-3x2-relative",
)  # fmt: skip


pytestmark = pytest.mark.usefixtures("other_package")


def make_device(axes: list[tuple[float, float]], branches: list[int]) -> pb.Device:
    return pb.Device(
        axes=[pb.Axis(name=f"axis{i}", low=low, high=high) for i, (low, high) in enumerate(axes)],
        branches=[
            pb.Branch(name=f"branch{i}", choices=[f"choice{c}" for c in range(count)])
            for i, count in enumerate(branches)
        ],
    )


ranges = st.tuples(st.floats(-5, 4, width=32), st.floats(0.125, 5, width=32)).map(lambda r: (r[0], r[0] + r[1]))
devices = (
    st.tuples(st.lists(ranges, max_size=3), st.lists(st.integers(2, 5), max_size=4))
    .filter(lambda parts: bool(parts[0] or parts[1]))
    .map(lambda parts: make_device(*parts))
)


def layouts_of(name: str, device: pb.Device) -> list[Layout]:
    """Return the layouts of all policies; a device that the layout refuses is no example."""
    try:
        return list(make_layouts(name, device).values())
    except ConfigError as error:
        assume("cannot express this device" not in str(error))
        raise


def random_masks(device: pb.Device, lanes: int, rng: np.random.Generator) -> list[np.ndarray]:
    masks = [rng.random((lanes, len(branch.choices))) < 0.6 for branch in device.branches]
    for mask in masks:
        mask[:, 0] = True  # "released" stays allowed, so that every joint mask has a choice
    return masks


def sample(layout: Layout, masks: list[np.ndarray], rng: np.random.Generator, lanes: int):
    """Return random policy actions that the layout's masks allow."""
    continuous = rng.normal(0, 3, (lanes, layout.space.continuous)).astype(np.float32)
    discrete = np.zeros((lanes, len(layout.space.branches)), np.int64)
    for column, mask in enumerate(layout.masks(masks) if masks else []):
        discrete[:, column] = [rng.choice(np.flatnonzero(row)) for row in mask]
    if not masks:
        for column, size in enumerate(layout.space.branches):
            discrete[:, column] = rng.integers(size, size=lanes)
    return continuous, discrete


@given(devices, st.sampled_from(NAMES), st.booleans(), st.integers(0, 2**32))
@settings(deadline=None, max_examples=250, derandomize=True)
def test_every_action_is_legal_on_every_device_and_masks_are_honoured(device, name, masked, seed):
    lanes, rng = 16, np.random.default_rng(seed)
    masks = random_masks(device, lanes, rng) if masked and device.branches else []
    act = ActArrays(
        np.full((lanes, len(device.axes)), np.nan, np.float32), np.full((lanes, len(device.branches)), -1, np.int32)
    )
    for layout in layouts_of(name, device):
        continuous, discrete = sample(layout, masks, rng, lanes)
        layout.write(continuous, discrete, act, masks or None)
    previous = StepArrays([], np.zeros((lanes, 1)), np.zeros(lanes, bool), np.zeros(lanes, bool), masks or None)
    checked = Codec(pb.Behavior(name="agent", device=device, agents_per_arena=1), len(previous.rewards)).unpack_act(
        pack_act(act), previous
    )
    np.testing.assert_array_equal(checked.axes, act.axes)
    np.testing.assert_array_equal(checked.choices, act.choices)


@given(devices, st.sampled_from(NAMES))
@settings(deadline=None, max_examples=150, derandomize=True)
def test_every_choice_of_every_branch_can_be_reached(device, name):
    rng = np.random.default_rng(0)
    lanes = 4000
    act = ActArrays(np.zeros((lanes, len(device.axes)), np.float32), np.zeros((lanes, len(device.branches)), np.int32))
    for layout in layouts_of(name, device):
        continuous, discrete = sample(layout, [], rng, lanes)
        layout.write(continuous, discrete, act)
    for column, branch in enumerate(device.branches):
        assert set(act.choices[:, column]) == set(range(len(branch.choices)))


POINTER = pb.Device(
    axes=[pb.Axis(name="angle", low=-1, high=1), pb.Axis(name="speed", low=-1, high=1)],
    branches=[pb.Branch(name=name, choices=["released", "pressed"]) for name in ("shoot", "reload")],
)


def written(layout: Layout, continuous: list[list[float]], discrete: list[list[int]]) -> ActArrays:
    lanes = max(len(continuous), len(discrete))
    act = ActArrays(np.zeros((lanes, 2), np.float32), np.zeros((lanes, 2), np.int32))
    layout.write(
        np.array(continuous, np.float32).reshape(lanes, -1), np.array(discrete, np.int64).reshape(lanes, -1), act
    )
    return act


def test_bucket_11_has_steps_of_a_fifth_and_the_papers_click_branch():
    layout = bucket(POINTER, "11")
    assert layout.space.branches == (11, 11, 3)
    act = written(layout, [], [[0, 10, 0], [5, 6, 1], [1, 4, 2]])
    np.testing.assert_allclose(act.axes, [[-1.0, 1.0], [0.0, 0.2], [-0.8, -0.2]], atol=1e-7)
    np.testing.assert_array_equal(act.choices, [[1, 0], [0, 1], [0, 0]])


@pytest.mark.parametrize(
    ("value", "pressed"),
    [(0.0, [False, True, True, True]), (0.1, [False, True, False, False]), (0.5, [True, True, True, False])],
)
def test_thresholds_press_above_0_or_within_their_size(value, pressed):
    # Samples are clipped to ±3 and divided by 3: these act as -0.3, 0.05, 0.4, 1.
    samples = [-0.9, 0.15, 1.2, 7.0]
    act = written(threshold(POINTER, value), [[0, 0, s, -3] for s in samples], [])
    assert act.choices[:, 0].astype(bool).tolist() == pressed


def test_gaussian_axes_are_clipped_at_three_and_fill_the_range():
    act = written(make_layouts("hybrid", POINTER)[""], [[-CLIP, 1.5], [99, -99]], [[0, 0], [1, 1]])
    np.testing.assert_allclose(act.axes, [[-1.0, 0.5], [1.0, -1.0]])


def test_multiagent_splits_axes_from_buttons():
    layouts = make_layouts("multiagent", POINTER)
    assert {name: layout.space for name, layout in layouts.items()} == {
        "axes": ActionSpace(2, ()),
        "buttons": ActionSpace(0, (3,)),
    }


def test_a_device_without_buttons_leaves_multiagent_one_policy():
    assert list(make_layouts("multiagent", make_device([(-1, 1)], []))) == ["axes"]


@pytest.mark.parametrize("name", ["", "bucket", "bucket-1", "bucket-x", "threshold-2", "threshold-nan", "hybrid-3"])
def test_an_unknown_layout_is_refused_by_name(name):
    with pytest.raises(ConfigError, match=f"unknown layout '{name}'"):
        make_layouts(name, POINTER)
