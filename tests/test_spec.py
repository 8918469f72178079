"""Every rule of bridge.proto about a spec, and the limits of messages that follow from one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joybridge.contract.limits import MAX_MESSAGE, element_count, request_bytes, response_bytes
from joybridge.contract.spec import SpecError, check_spec, choose_options
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import Hybrid

quick = settings(derandomize=True, deadline=None, max_examples=60)


def a_spec():
    return Hybrid.describe({"size": "small", "masks": "on"})


BREAKS = {
    "a game without a name: name is empty": lambda s: s.ClearField("name"),
    "decision_interval is 0": lambda s: s.ClearField("decision_interval"),
    "max_arenas is 0": lambda s: s.ClearField("max_arenas"),
    "options: a name is empty": lambda s: s.options[0].ClearField("name"),
    "options: a name stands twice": lambda s: s.options.append(s.options[0]),
    "option 'size' has default 'huge'": lambda s: setattr(s.options[0], "default_choice", "huge"),
    "parameters: a name stands twice": lambda s: s.parameters.append(s.parameters[0]),
    "parameter 'drift' has its default outside": lambda s: setattr(s.parameters[0], "default_value", 2.5),
    "parameter 'drift' has its default outside low": lambda s: setattr(s.parameters[0], "low", np.nan),
    "no behaviors": lambda s: s.ClearField("behaviors"),
    "behaviors: a name stands twice": lambda s: s.behaviors.append(s.behaviors[0]),
    "agents_per_arena is 0": lambda s: s.behaviors[0].ClearField("agents_per_arena"),
    "no sensors": lambda s: s.behaviors[0].ClearField("sensors"),
    "no reward channels": lambda s: s.behaviors[0].ClearField("channels"),
    "a device needs an axis or a branch": lambda s: s.behaviors[0].ClearField("device"),
    "sensors: a name stands twice": lambda s: s.behaviors[0].sensors.append(s.behaviors[0].sensors[0]),
    "axes: a name is empty": lambda s: s.behaviors[0].device.axes[0].ClearField("name"),
    "branches: a name is empty": lambda s: s.behaviors[0].device.branches[0].ClearField("name"),
    "channels: a name is empty": lambda s: s.behaviors[0].channels[0].ClearField("name"),
    "metrics: a name is empty": lambda s: s.behaviors[0].metrics[0].ClearField("name"),
    "axis 'x' has low 1 not below high 1": lambda s: setattr(s.behaviors[0].device.axes[0], "low", 1.0),
    "axis 'x' has no finite low and high": lambda s: setattr(s.behaviors[0].device.axes[0], "low", np.nan),
    "branch 'press' needs at least two choices": lambda s: s.behaviors[0].device.branches[1].choices.pop(),
    "branch 'press' repeats a choice": lambda s: s.behaviors[0].device.branches[1].choices.append("pressed"),
    "sensor 'place' has no valid dtype": lambda s: s.behaviors[0].sensors[0].ClearField("dtype"),
    "sensor 'count' has no valid dtype": lambda s: setattr(s.behaviors[0].sensors[1], "dtype", 5),
    "sensor 'place' has shape []": lambda s: s.behaviors[0].sensors[0].ClearField("shape"),
    "sensor 'image' has shape [2, 2, 0]": lambda s: s.behaviors[0].sensors[2].shape.append(0),
    "sensor 'place' names 1 elements of 2": lambda s: s.behaviors[0].sensors[0].elements.append("x"),
    "name has 101 characters, expected at most 100": lambda s: setattr(s, "name", "x" * 101),
    "description has 1001 characters": lambda s: setattr(s, "description", "x" * 1001),
    "axes: name has 101 characters": lambda s: setattr(s.behaviors[0].device.axes[0], "name", "x" * 101),
    "description of 'drift' has 1001 characters": lambda s: setattr(s.parameters[0], "description", "x" * 1001),
    "metrics: 1003 entries": lambda s: s.behaviors[0].metrics.extend(pb.Metric(name=str(n)) for n in range(1001)),
    "tick_seconds is nan": lambda s: setattr(s, "tick_seconds", np.nan),
    "tick_seconds is -1": lambda s: setattr(s, "tick_seconds", -1.0),
    "picture is 2049x": lambda s: setattr(s.picture, "width", 2049),
    "option 'size' has an empty choice": lambda s: s.options[0].choices.append(""),
    "option 'size' repeats a choice": lambda s: s.options[0].choices.append("small"),
    "option 'size': choice has 101 characters": lambda s: s.options[0].choices.append("x" * 101),
    "parameter 'drift' has no finite low": lambda s: setattr(s.parameters[0], "low", -np.inf),
    "lanes in max_arenas, expected 2^31 - 1": lambda s: setattr(s, "max_arenas", 2**32 - 1),
    "has weight inf": lambda s: setattr(s.behaviors[0].channels[0], "default_weight", np.inf),
    "has 65537 choices, expected 2 to 65536": lambda s: (
        s.behaviors[0]
        .device.branches[0]
        .choices.extend(str(number) for number in range(65537 - len(s.behaviors[0].device.branches[0].choices)))
    ),
    "sensor 'image' has 9 sizes": lambda s: s.behaviors[0].sensors[2].shape.extend([1] * 7),
    "sensors have 16777217 elements together": lambda s: (
        s.behaviors[0].sensors[3].shape.__setitem__(0, 2**24 - 6)  # 7 in the others
    ),
    "sensor 'lamps' has a list of 65537 entries": lambda s: (
        s.behaviors[0].sensors[3].shape.__setitem__(0, 65537),
        s.behaviors[0].sensors[3].low.extend([0.0] * 65537),
    ),
    "bytes, expected at most 4000000": lambda s: s.options[0].choices.extend("x" * 4_000_000 for _ in range(1)),
    "hybrid: description is 'red\\x1b[31m', expected printable": lambda s: setattr(s, "description", "red\x1b[31m"),
    "axes: name is 'x\\ny', expected printable": lambda s: setattr(s.behaviors[0].device.axes[0], "name", "x\ny"),
    "option 'size': choice is '\\u202e', expected printable": lambda s: s.options[0].choices.append("\u202e"),
    "sensor 'lamps': element is '\\t', expected printable": lambda s: (
        s.behaviors[0].sensors[3].elements.extend(["a", "b", "\t"])
    ),
    "sensor 'lamps' has a bound that is NaN": lambda s: s.behaviors[0].sensors[3].high.append(np.nan),
    "sensor 'lamps' has a low above its high": lambda s: (
        s.behaviors[0].sensors[3].low.append(2.0),
        s.behaviors[0].sensors[3].high.append(1.0),
    ),
    "version has 101 characters": lambda s: setattr(s, "version", "x" * 101),
    "sensor 'place' is an image of another dtype": lambda s: setattr(
        s.behaviors[0].sensors[0].image, "color", pb.COLOR_GRAY
    ),
    "sensor 'image' is an image without a valid color": lambda s: s.behaviors[0].sensors[2].image.SetInParent(),
    "sensor 'image' is an image of shape [2, 2], expected [height, width, 3]": lambda s: setattr(
        s.behaviors[0].sensors[2].image, "color", pb.COLOR_RGB
    ),
    "axis 'x' counts only with branch 'pedal', expected one of gear, press": lambda s: setattr(
        s.behaviors[0].device.axes[0].only_with, "branch", "pedal"
    ),
    "axis 'x' counts only with choice 'reverse', expected one of low, middle, high": lambda s: (
        s.behaviors[0].device.axes[0].only_with.CopyFrom(pb.Condition(branch="gear", choice="reverse"))
    ),
    "branch 'gear' has 2 keys for 3 choices": lambda s: s.behaviors[0].device.branches[0].keys.extend(["KeyA", ""]),
    "branch 'gear' has one key for two choices": lambda s: (
        s.behaviors[0].device.branches[0].keys.extend(["KeyA", "", "KeyA"])
    ),
    "branch 'gear' has the key 'Key A', expected 1 to 32 letters": lambda s: (
        s.behaviors[0].device.branches[0].keys.extend(["KeyB", "", "Key A"])
    ),
    "sensor 'lamps' has 2 bounds": lambda s: s.behaviors[0].sensors[3].high.extend([1.0, 1.0]),
}


def test_a_spec_that_follows_the_contract_is_accepted():
    check_spec(a_spec())


@pytest.mark.parametrize("text", BREAKS)
def test_a_spec_that_breaks_the_contract_is_refused(text):
    spec = a_spec()
    BREAKS[text](spec)
    with pytest.raises(SpecError) as caught:
        check_spec(spec)
    assert text in str(caught.value)


def test_options_left_out_have_their_defaults():
    options = a_spec().options
    assert choose_options(options, {}, "hybrid") == {"size": "small", "masks": "on"}
    assert choose_options(options, {"size": "large"}, "hybrid") == {"size": "large", "masks": "on"}
    with pytest.raises(SpecError, match="unknown option 'colour', expected one of size, masks"):
        choose_options(options, {"colour": "red"}, "hybrid")
    with pytest.raises(SpecError, match="option 'size' got 'huge', expected one of small, large"):
        choose_options(options, {"size": "huge"}, "hybrid")


@quick
@given(st.integers(1, 40), st.integers(0, 2**32 - 1), st.booleans())
def test_the_limits_of_a_message_hold_the_largest_that_a_spec_allows(arenas, seed, large):
    spec = Hybrid.describe({"size": "large" if large else "small", "masks": "on"})
    spec.behaviors[0].agents_per_arena = 3
    spec.behaviors[0].sensors[2].shape[:] = [60, 40]
    spec.snapshot_bytes_per_arena = 1000
    spec.behaviors[0].sensors[0].description = "long " * 100_000
    behavior, random = spec.behaviors[0], np.random.default_rng(seed)
    lanes = 3 * arenas

    def sense():
        return [random.bytes(lanes * element_count(s) * NUMPY_TYPES[s.dtype].itemsize) for s in behavior.sensors]

    rest = 4 * lanes * 2 * 2 + lanes * (3 + 2 + 3)  # channels, metrics; masks, ends, deciding
    observations = [pb.Tensor(data=data) for data in sense() + sense() + [random.bytes(rest)]]
    pictures = [pb.Tensor(data=bytes(6 * 8 * 3))] * 64
    step = pb.Step(behaviors=[pb.BehaviorStep(observations=observations)], pictures=pictures)
    started = pb.PlayResponse(started=pb.Started(spec=spec, step=step))
    assert started.ByteSize() <= response_bytes(spec, arenas, 64)
    snapshot = pb.Snapshot(parts={"all": random.bytes(1000 * arenas)})
    assert pb.PlayResponse(snapshot=snapshot).ByteSize() <= response_bytes(spec, arenas)
    assert pb.PlayRequest(start=pb.Start(game="hybrid", snapshot=snapshot)).ByteSize() <= request_bytes(spec, arenas)
    act = pb.BehaviorAct(axes=pb.Tensor(data=bytes(8 * lanes)), choices=pb.Tensor(data=bytes(8 * lanes)))
    assert pb.PlayRequest(act=pb.Act(behaviors=[act], draw=range(64))).ByteSize() <= request_bytes(spec, arenas)


def test_no_limit_is_larger_than_a_message_can_be():
    spec = a_spec()
    spec.snapshot_bytes_per_arena = 2**32 - 1
    assert response_bytes(spec, 1024) == request_bytes(spec, 1024) == MAX_MESSAGE
