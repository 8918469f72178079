"""The behaviors of a spec: their sensors, devices, reward channels and metrics are well-formed."""

from collections.abc import Callable
from math import isfinite
from typing import Any

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.registry import check, table
from joybridge.conformance.spec_expectations import expect_each, expect_unique_names, parts_of
from joybridge.conformance.subject import Subject
from joybridge.contract.limits import MAX_KEY, element_count
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.v1 import bridge_pb2 as pb


def _has_bounds(sensor: pb.Sensor) -> bool:
    return all(len(bounds) in (0, 1, element_count(sensor)) for bounds in (sensor.low, sensor.high))


def _is_ordered(sensor: pb.Sensor) -> bool:
    """Return whether no low of a sensor is above its high. Numbers of bounds that do not fit are another check."""
    low, high = list(sensor.low), list(sensor.high)
    count = max(len(low), len(high))
    if not (low and high and {len(low), len(high)} <= {1, count}):
        return True
    return all(a <= b for a, b in zip(low * (count // len(low)), high * (count // len(high)), strict=True))


def _has_keys_of_its_own(branch: pb.Branch) -> bool:
    named = [key for key in branch.keys if key]
    fits = len(branch.keys) in (0, len(branch.choices)) and len(set(named)) == len(named)
    return fits and all(key.isascii() and key.isalnum() and len(key) <= MAX_KEY for key in named)


NAMED = (  # name, section, rule, field of Behavior
    (
        "every_behavior_has_sensors_with_unique_names",
        "Behavior",
        "A behavior has at least one sensor, and a name identifies one of them.",
        "sensors",
    ),
    (
        "every_behavior_has_reward_channels_with_unique_names",
        "Behavior",
        "A behavior has at least one reward channel, and a name identifies one of them.",
        "channels",
    ),
)
PARTS = (  # name, section, rule; of each part of a kind: the fields that are shown, what holds, what is expected
    ("every_behavior_has_agents", "Behavior", "agents_per_arena is at least 1.",
     "behaviors", ["agents_per_arena"], lambda b: b.agents_per_arena >= 1, "at least 1"),
    ("default_weights_are_finite", "RewardChannel",
     "The reward is the sum of channel * weight, so that a default weight is a finite number.",
     "channels", ["default_weight"], lambda c: isfinite(c.default_weight), "a finite number"),
    ("axis_ranges_are_finite", "Axis", "Low and high of an axis are finite, and low is below high.",
     "axes", ["low", "high"], lambda a: isfinite(a.low) and isfinite(a.high) and a.low < a.high,
     "finite numbers, low below high"),
    ("every_branch_has_two_choices_or_more", "Branch",
     "A branch has at least two choices, each with a label of its own.",
     "branches", ["choices"], lambda b: len(set(b.choices)) == len(b.choices) >= 2, "two or more unique labels"),
    ("keys_are_one_per_choice", "Branch",
     "Keys has one code per choice, different from each other, empty for none; or no entries.",
     "branches", ["keys", "choices"], _has_keys_of_its_own, "no keys, or one of letters and digits per choice"),
    ("sensor_dtypes_are_valid", "Dtype", "DTYPE_UNSPECIFIED is never valid.",
     "sensors", ["dtype"], lambda s: s.dtype in NUMPY_TYPES, "a dtype of the contract"),
    ("sensor_shapes_are_at_least_one", "Sensor",
     "The shape of a sensor leaves out the lanes; every dimension is at least 1.",
     "sensors", ["shape"], lambda s: s.shape and min(s.shape) >= 1, "one dimension or more, each at least 1"),
    ("sensor_elements_match_the_shape", "Sensor",
     "Elements has one text per element of the observation, or is empty.",
     "sensors", ["elements"], lambda s: len(s.elements) in (0, element_count(s)), "one per element, or none"),
    ("sensor_bounds_match_the_shape", "Sensor", "Low and high have one value per element, one value for all, or none.",
     "sensors", ["low", "high"], _has_bounds, "one value per element, one for all, or none"),
    ("sensor_low_is_not_above_high", "Sensor", "Low is the smallest value of an element and high the largest.",
     "sensors", ["low", "high"], _is_ordered, "no low above its high"),
)  # fmt: skip


@check("GameSpec")
def spec_has_behaviors_with_unique_names(subject: Subject) -> None:
    """A game has at least one behavior, and a name identifies one of them."""
    expect(subject.spec.behaviors, "no behaviors", "at least one")
    expect_unique_names(subject.spec.behaviors, "behaviors")


@table(NAMED)
def _is_not_empty_and_named(subject: Subject, field: str) -> None:
    for behavior in subject.spec.behaviors:
        expect(getattr(behavior, field), f"{behavior.name}: no {field}", "at least one")
        expect_unique_names(getattr(behavior, field), f"{field} of {behavior.name}")


@check("Device")
def every_device_has_an_axis_or_a_branch(subject: Subject) -> None:
    """A device has at least one axis or branch, and a name identifies one axis or one branch."""
    for behavior in subject.spec.behaviors:
        device = behavior.device
        expect(len(device.axes) + len(device.branches), f"{behavior.name}: an empty device", "an axis or a branch")
        expect_unique_names(device.axes, f"axes of {behavior.name}")
        expect_unique_names(device.branches, f"branches of {behavior.name}")


@check("Metric")
def metric_names_are_unique(subject: Subject) -> None:
    """A name identifies one metric of a behavior."""
    skip_unless(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for behavior in subject.spec.behaviors:
        expect_unique_names(behavior.metrics, f"metrics of {behavior.name}")


@table(PARTS)
def _each_part_holds(
    subject: Subject, kind: str, fields: list[str], holds: Callable[[Any], object], expected: str
) -> None:
    expect_each(subject.spec, kind, fields, holds, expected)


@check("Condition")
def conditions_of_axes_name_a_choice(subject: Subject) -> None:
    """Axis.only_with names a branch of the same device and one of its choices."""
    axes = [(axis, behavior.device) for behavior in subject.spec.behaviors for axis in behavior.device.axes]
    conditional = [(axis, device) for axis, device in axes if axis.HasField("only_with")]
    skip_unless(conditional, "every axis always counts")
    for axis, device in conditional:
        condition, choices = axis.only_with, {branch.name: list(branch.choices) for branch in device.branches}
        got = f"branch {condition.branch!r}, choice {condition.choice!r} of axis {axis.name!r}"
        expect(condition.choice in choices.get(condition.branch, []), got, "a choice of a branch of its device")


@check("Image")
def images_have_the_shape_of_their_color(subject: Subject) -> None:
    """An image is UINT8: [height, width] or [height, width, 1] if it is gray, [height, width, 3] if it is RGB."""
    images = [sensor for sensor in parts_of(subject.spec, "sensors") if sensor.HasField("image")]
    skip_unless(images, "no sensor is an image")
    for sensor in images:
        shape, color = list(sensor.shape), sensor.image.color
        channels = {pb.COLOR_GRAY: 1, pb.COLOR_RGB: 3}.get(color, 0)
        fits = (len(shape) == 2 and color == pb.COLOR_GRAY) or (len(shape) == 3 and shape[2] == channels)
        got = f"shape {shape}, dtype {sensor.dtype}, color {color} of {sensor.name!r}"
        expect(fits and sensor.dtype == pb.DTYPE_UINT8, got, "UINT8, and one channel for gray or three for RGB")
