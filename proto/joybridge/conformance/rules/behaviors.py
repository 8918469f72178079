"""The behaviors of a spec: their sensors, devices, reward channels and metrics are well-formed."""

import math
from collections.abc import Iterator

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.names import expect_unique_names
from joybridge.conformance.registry import check
from joybridge.conformance.subject import Subject
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.v1 import bridge_pb2 as pb


@check("GameSpec")
def spec_has_behaviors_with_unique_names(subject: Subject) -> None:
    """A game has at least one behavior, and a name identifies one of them."""
    expect(subject.spec.behaviors, "no behaviors", "at least one")
    expect_unique_names(subject.spec.behaviors, "behaviors")


@check("Behavior")
def every_behavior_has_agents(subject: Subject) -> None:
    """agents_per_arena is at least 1."""
    for behavior in subject.spec.behaviors:
        expect(behavior.agents_per_arena >= 1, f"{behavior.name}: agents_per_arena 0", "at least 1")


@check("Behavior")
def every_behavior_has_sensors_with_unique_names(subject: Subject) -> None:
    """A behavior has at least one sensor, and a name identifies one of them."""
    for behavior in subject.spec.behaviors:
        expect(behavior.sensors, f"{behavior.name}: no sensors", "at least one")
        expect_unique_names(behavior.sensors, f"sensors of {behavior.name}")


@check("Device")
def every_device_has_an_axis_or_a_branch(subject: Subject) -> None:
    """A device has at least one axis or branch, and a name identifies one axis or one branch."""
    for behavior in subject.spec.behaviors:
        device = behavior.device
        expect(len(device.axes) + len(device.branches), f"{behavior.name}: an empty device", "an axis or a branch")
        expect_unique_names(device.axes, f"axes of {behavior.name}")
        expect_unique_names(device.branches, f"branches of {behavior.name}")


@check("Behavior")
def every_behavior_has_reward_channels_with_unique_names(subject: Subject) -> None:
    """A behavior has at least one reward channel, and a name identifies one of them."""
    for behavior in subject.spec.behaviors:
        expect(behavior.channels, f"{behavior.name}: no channels", "at least one")
        expect_unique_names(behavior.channels, f"channels of {behavior.name}")


@check("RewardChannel")
def default_weights_are_finite(subject: Subject) -> None:
    """The reward is the sum of channel * weight, so that a default weight is a finite number."""
    for behavior in subject.spec.behaviors:
        for channel in behavior.channels:
            got = f"{channel.default_weight} of channel {channel.name!r}"
            expect(math.isfinite(channel.default_weight), got, "a finite default_weight")


@check("Metric")
def metric_names_are_unique(subject: Subject) -> None:
    """A name identifies one metric of a behavior."""
    skip_unless(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for behavior in subject.spec.behaviors:
        expect_unique_names(behavior.metrics, f"metrics of {behavior.name}")


@check("Axis")
def axis_ranges_are_finite(subject: Subject) -> None:
    """Low and high of an axis are finite, and low is below high."""
    skip_unless(any(behavior.device.axes for behavior in subject.spec.behaviors), "the game has no axes")
    for behavior in subject.spec.behaviors:
        for axis in behavior.device.axes:
            valid = math.isfinite(axis.low) and math.isfinite(axis.high) and axis.low < axis.high
            expect(valid, f"{axis.low}..{axis.high} of {axis.name!r}", "finite numbers, low below high")


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


@check("Branch")
def every_branch_has_two_choices_or_more(subject: Subject) -> None:
    """A branch has at least two choices, each with a label of its own."""
    skip_unless(any(behavior.device.branches for behavior in subject.spec.behaviors), "the game has no branches")
    for behavior in subject.spec.behaviors:
        for branch in behavior.device.branches:
            choices = list(branch.choices)
            unique = len(set(choices)) == len(choices) >= 2
            expect(unique, f"choices {choices} of branch {branch.name!r}", "two or more unique labels")


@check("Dtype")
def sensor_dtypes_are_valid(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    for sensor in _sensors(subject):
        expect(sensor.dtype in NUMPY_TYPES, f"dtype {sensor.dtype} of {sensor.name!r}", "a dtype of the contract")


@check("Sensor")
def sensor_shapes_are_at_least_one(subject: Subject) -> None:
    """The shape of a sensor leaves out the lanes; every dimension is at least 1."""
    for sensor in _sensors(subject):
        valid = sensor.shape and min(sensor.shape) >= 1
        expect(valid, f"shape {list(sensor.shape)} of {sensor.name!r}", "one dimension or more, each at least 1")


@check("Sensor")
def sensor_elements_match_the_shape(subject: Subject) -> None:
    """Elements has one text per element of the observation, or is empty."""
    for sensor in _sensors(subject):
        got, expected = len(sensor.elements), element_count(sensor)
        expect(got in (0, expected), f"{got} elements of {sensor.name!r}", f"0 or {expected}")


@check("Sensor")
def sensor_bounds_match_the_shape(subject: Subject) -> None:
    """Low and high have one value per element, one value for all, or none."""
    for sensor in _sensors(subject):
        count = element_count(sensor)
        for bounds in (sensor.low, sensor.high):
            expect(len(bounds) in (0, 1, count), f"{len(bounds)} bounds of {sensor.name!r}", f"0, 1 or {count}")


@check("Sensor")
def sensor_low_is_not_above_high(subject: Subject) -> None:
    """Low is the smallest value of an element and high the largest."""
    for sensor in _sensors(subject):
        count = max(len(sensor.low), len(sensor.high))
        if sensor.low and sensor.high and {len(sensor.low), len(sensor.high)} <= {1, count}:
            lows, highs = ([*bounds] * (count // len(bounds)) for bounds in (sensor.low, sensor.high))
            valid = all(low <= high for low, high in zip(lows, highs, strict=True))
            expect(valid, f"low {lows} and high {highs} of {sensor.name!r}", "no low above its high")


@check("Image")
def images_have_the_shape_of_their_color(subject: Subject) -> None:
    """An image is UINT8: [height, width] or [height, width, 1] if it is gray, [height, width, 3] if it is RGB."""
    images = [sensor for sensor in _sensors(subject) if sensor.HasField("image")]
    skip_unless(images, "no sensor is an image")
    for sensor in images:
        shape, color = list(sensor.shape), sensor.image.color
        channels = {pb.COLOR_GRAY: (1,), pb.COLOR_RGB: (3,)}.get(color, ())
        flat = len(shape) == 2 and color == pb.COLOR_GRAY
        valid = sensor.dtype == pb.DTYPE_UINT8 and (flat or (len(shape) == 3 and shape[2] in channels))
        got = f"shape {shape}, dtype {sensor.dtype}, color {color} of {sensor.name!r}"
        expect(valid, got, "UINT8, and one channel for gray or three for RGB")


def _sensors(subject: Subject) -> Iterator[pb.Sensor]:
    for behavior in subject.spec.behaviors:
        yield from behavior.sensors
