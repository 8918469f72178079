"""Actions and steps into messages and back, and every rule of bridge.proto about them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joybridge.contract.codec import ActArrays, Codec, StepArrays, lane_count, pack, pack_act
from joybridge.contract.tensors import NUMPY_TYPES, TensorError
from joybridge.v1 import bridge_pb2 as pb
from tests.support.wire import pack_step

ARENAS = 3
PILOT = pb.Behavior(
    name="pilot",
    agents_per_arena=2,
    sensors=[
        pb.Sensor(name="radar", dtype=pb.DTYPE_FLOAT32, shape=[2, 2]),
        pb.Sensor(name="fuel", dtype=pb.DTYPE_INT32, shape=[1]),
        pb.Sensor(name="camera", dtype=pb.DTYPE_UINT8, shape=[3, 2, 1]),
        pb.Sensor(name="lamps", dtype=pb.DTYPE_BOOL, shape=[4]),
    ],
    device=pb.Device(
        axes=[pb.Axis(name="pitch", low=-1.0, high=1.0), pb.Axis(name="throttle", low=0.25, high=4.0)],
        branches=[
            pb.Branch(name="gear", choices=["up", "hold", "down"]),
            pb.Branch(name="fire", choices=["no", "yes"]),
        ],
    ),
    channels=[pb.RewardChannel(name="hits"), pb.RewardChannel(name="fuel")],
    metrics=[pb.Metric(name="accuracy")],
)
LANES = lane_count(PILOT, ARENAS)
quick = settings(derandomize=True, deadline=None, max_examples=60)


def a_step(ended=(), truncated=(), masks=False, deciding=None, seed=0, behavior=PILOT):
    """Return a step of random but right content; `ended` lanes terminated, `truncated` lanes were cut."""
    random = np.random.default_rng(seed)
    lanes = lane_count(behavior, ARENAS)

    def sense(rows):
        shapes = [(sensor.dtype, (rows, *sensor.shape)) for sensor in behavior.sensors]
        return [random.integers(0, 2, shape).astype(NUMPY_TYPES[dtype]) for dtype, shape in shapes]

    ends = np.isin(np.arange(lanes), ended), np.isin(np.arange(lanes), truncated)
    step = StepArrays(sense(lanes), random.normal(size=(lanes, 2)).astype(np.float32), *ends)
    if masks:
        step.masks = [random.random((lanes, len(b.choices))) < 0.5 for b in behavior.device.branches]
        for mask in step.masks:
            mask[np.arange(lanes), random.integers(mask.shape[1], size=lanes)] = True
    if deciding is not None:
        step.deciding = np.isin(np.arange(lanes), deciding)
    step.ended = np.flatnonzero(ends[0] | ends[1]).astype(np.int32)
    if len(step.ended):
        step.final_observations = sense(len(step.ended))
        if behavior.metrics:
            step.metrics = random.normal(size=(len(step.ended), len(behavior.metrics))).astype(np.float32)
    return step


def an_act(lanes=LANES):
    return ActArrays(np.full((lanes, 2), 0.5, np.float32), np.zeros((lanes, 2), np.int32))


def act_refusal(act, previous=None):
    with pytest.raises(TensorError, match=r"^pilot\.(axes|choices)") as caught:
        Codec(PILOT, ARENAS).unpack_act(act if isinstance(act, pb.BehaviorAct) else pack_act(act), previous or a_step())
    return str(caught.value)


def step_refusal(message):
    with pytest.raises(TensorError, match=r"^pilot") as caught:
        Codec(PILOT, ARENAS).unpack_step(message)
    return str(caught.value)


# ------------------------------------------------------------------------------------------------------ acts


@quick
@given(st.data())
def test_an_act_comes_back_as_it_was(data):
    axes = [[data.draw(st.floats(axis.low, axis.high, width=32)) for axis in PILOT.device.axes] for _ in range(LANES)]
    choices = [
        [data.draw(st.integers(0, len(branch.choices) - 1)) for branch in PILOT.device.branches] for _ in range(LANES)
    ]
    act = ActArrays(np.array(axes, np.float32), np.array(choices, np.int32))
    back = Codec(PILOT, ARENAS).unpack_act(pb.BehaviorAct.FromString(pack_act(act).SerializeToString()), a_step())
    assert back.axes.tobytes() == act.axes.tobytes() and back.axes.shape == (LANES, 2)
    assert back.choices.tobytes() == act.choices.tobytes() and back.choices.shape == (LANES, 2)


@pytest.mark.parametrize("end", ["low", "high"])
def test_both_ends_of_an_axis_belong_to_it(end):
    act = an_act()
    act.axes[:] = [getattr(axis, end) for axis in PILOT.device.axes]
    assert Codec(PILOT, ARENAS).unpack_act(pack_act(act), a_step()).axes.tolist() == act.axes.tolist()


def test_a_script_plays_in_place_of_the_lanes_that_name_it_and_the_others_are_checked():
    piloted = pb.Behavior()
    piloted.CopyFrom(PILOT)
    piloted.scripts.extend([pb.Script(name="calm"), pb.Script(name="bold")])
    act = an_act()
    act.scripts = np.array([0, 1, 2, 0, 1, 0], np.int32)
    act.axes[[1, 2, 3, 4]] = 9.0  # lanes 1, 2 and 4 are a script's, and lane 3 waits
    back = Codec(piloted, ARENAS).unpack_act(pack_act(act), a_step(deciding=[0, 1, 2, 5]))
    assert back.scripts is not None and back.scripts.tolist() == [0, 1, 2, 0, 1, 0]
    assert back.axes.tolist() == [[0.5, 0.5], *[[-1.0, 0.25]] * 4, [0.5, 0.5]]
    act.axes[3] = 0.5
    everyone = Codec(piloted, ARENAS).unpack_act(pack_act(act), a_step())
    assert everyone.axes[:, 1].tolist() == [0.5, 0.25, 0.25, 0.5, 0.25, 0.5]
    some = back.rows(np.array([2, 5]))
    assert some.scripts is not None and some.scripts.tolist() == [2, 0] and an_act().rows(slice(2)).scripts is None
    for wrong in (-1, 3):
        act.scripts[4] = wrong
        with pytest.raises(TensorError, match=f"got {wrong} in lane 4, expected 0..2 for calm, bold"):
            Codec(piloted, ARENAS).unpack_act(pack_act(act), a_step())


INVALID_ACTS = {  # the text: the field, the place and the value
    "axes: axis 'pitch' got 1.0000001192092896 in lane 4, expected -1..1": ("axes", (4, 0), 1.0000001),
    "axes: axis 'throttle' got 0.2499999850988388 in lane 4, expected 0.25..4": ("axes", (4, 1), 0.24999999),
    "axes: value nan at [3, 1], expected finite numbers": ("axes", (3, 1), np.nan),
    "axes: value -inf at [3, 1], expected finite numbers": ("axes", (3, 1), -np.inf),
    "choices: branch 'gear' got -1 in lane 5, expected 0..2": ("choices", (5, 0), -1),
    "choices: branch 'fire' got 2 in lane 5, expected 0..1": ("choices", (5, 1), 2),
}


@pytest.mark.parametrize("text", INVALID_ACTS)
def test_an_action_that_a_device_does_not_have_is_refused_by_its_place_and_value(text):
    field, place, value = INVALID_ACTS[text]
    act = an_act()
    getattr(act, field)[place] = value
    assert act_refusal(act) == f"pilot.{text}"


@pytest.mark.parametrize("field", ["axes", "choices"])
def test_an_act_has_both_halves_with_a_row_for_every_lane(field):
    message = pack_act(an_act())
    getattr(message, field).CopyFrom(getattr(pack_act(an_act(1)), field))
    assert act_refusal(message) == f"pilot.{field}: shape is [1, 2], expected [{LANES}, 2]"
    message.ClearField(field)
    assert act_refusal(message).startswith(f"pilot.{field}: dtype is DTYPE_UNSPECIFIED")


@pytest.mark.parametrize("kind", ["axes", "branches"])
def test_a_device_may_lack_axes_or_branches_and_an_act_then_lacks_their_half(kind):
    behavior = pb.Behavior()
    behavior.CopyFrom(PILOT)
    behavior.device.ClearField(kind)
    act = an_act()
    act.axes = act.axes[:, : len(behavior.device.axes)]
    act.choices = act.choices[:, : len(behavior.device.branches)]
    message = pack_act(act)
    assert (message.HasField("axes"), message.HasField("choices")) == (kind != "axes", kind != "branches")
    back = Codec(behavior, ARENAS).unpack_act(message, a_step())
    assert back.axes.shape == act.axes.shape and back.choices.shape == act.choices.shape
    extra = pack_act(an_act())
    with pytest.raises(TensorError, match=r"shape is \[6, 2\], expected \[6, 0\]"):
        Codec(behavior, ARENAS).unpack_act(extra, a_step())


@quick
@given(st.integers(0, 2**32 - 1), st.integers(0, LANES - 1), st.integers(0, 1), st.integers(0, 2))
def test_a_choice_is_accepted_exactly_if_its_mask_allows_it(seed, lane, branch, choice):
    previous = a_step(masks=True, seed=seed)
    choice = min(choice, previous.masks[branch].shape[1] - 1)
    act = an_act()
    act.choices[:] = np.stack([mask.argmax(axis=1) for mask in previous.masks], axis=1)
    act.choices[lane, branch] = choice
    if previous.masks[branch][lane, choice]:
        assert (Codec(PILOT, ARENAS).unpack_act(pack_act(act), previous).choices == act.choices).all()
    else:
        assert f"in lane {lane}, which its mask forbids" in act_refusal(act, previous)


def test_lanes_that_do_not_decide_may_ask_for_anything_and_their_games_get_something_valid():
    previous = a_step(masks=True, deciding=[1, 4])
    previous.masks[0][[0, 2]] = [False, True, False]
    act = an_act()
    act.axes[[0, 2, 3, 5]] = [-1e30, 99.0]
    act.choices[[0, 2, 3, 5]] = [-7, 2**31 - 1]
    act.choices[[1, 4]] = np.stack([mask[[1, 4]].argmax(axis=1) for mask in previous.masks], axis=1)
    back = Codec(PILOT, ARENAS).unpack_act(pack_act(act), previous)
    assert (back.axes[[1, 4]] == act.axes[[1, 4]]).all() and (back.choices[[1, 4]] == act.choices[[1, 4]]).all()
    for index, axis in enumerate(PILOT.device.axes):
        assert ((back.axes[:, index] >= axis.low) & (back.axes[:, index] <= axis.high)).all()
    for index, branch in enumerate(PILOT.device.branches):
        assert ((back.choices[:, index] >= 0) & (back.choices[:, index] < len(branch.choices))).all()


def test_a_lane_that_decides_is_named_by_its_own_number_among_those_that_wait():
    previous = a_step(deciding=[1, 4], masks=True)
    act = an_act()
    act.choices[[1, 4]] = np.stack([mask[[1, 4]].argmax(axis=1) for mask in previous.masks], axis=1)
    act.axes[4, 0] = 2.0
    assert "axis 'pitch' got 2.0 in lane 4" in act_refusal(act, previous)
    act.axes[4, 0] = 0.0
    act.choices[4, 1] = 9
    assert "branch 'fire' got 9 in lane 4" in act_refusal(act, previous)
    act.choices[4, 1] = 1
    previous.masks[1][4] = [True, False]
    assert "branch 'fire' got 'yes' in lane 4" in act_refusal(act, previous)


# ----------------------------------------------------------------------------------------------------- steps


@quick
@given(
    seed=st.integers(0, 2**32 - 1),
    ends=st.lists(st.sampled_from("-tc"), min_size=LANES, max_size=LANES),
    masks=st.booleans(),
    deciding=st.none() | st.sets(st.integers(0, LANES - 1)),
    metrics=st.booleans(),
)
def test_a_step_comes_back_as_it_was(seed, ends, masks, deciding, metrics):
    behavior = pb.Behavior()
    behavior.CopyFrom(PILOT)
    if not metrics:
        behavior.ClearField("metrics")
    ended = [lane for lane, end in enumerate(ends) if end == "t"], [lane for lane, end in enumerate(ends) if end == "c"]
    step = a_step(*ended, masks, None if deciding is None else list(deciding), seed, behavior)
    message = pb.BehaviorStep.FromString(pack_step(step).SerializeToString())
    back = Codec(behavior, ARENAS).unpack_step(message)
    for name in vars(step):
        assert same(getattr(back, name), getattr(step, name)), name
    assert message.HasField("ended") == bool(ended[0] + ended[1])
    assert message.HasField("deciding") == (deciding is not None)
    assert bool(message.masks) == masks


def same(one, other):
    if one is None or other is None:
        return one is other
    if isinstance(one, list):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


TENSORS = {  # every tensor of a step and what it is called in an error
    "observations[radar]": lambda m: m.observations[0],
    "observations[fuel]": lambda m: m.observations[1],
    "observations[camera]": lambda m: m.observations[2],
    "observations[lamps]": lambda m: m.observations[3],
    "rewards": lambda m: m.rewards,
    "terminated": lambda m: m.terminated,
    "truncated": lambda m: m.truncated,
    "masks[gear]": lambda m: m.masks[0],
    "masks[fire]": lambda m: m.masks[1],
    "deciding": lambda m: m.deciding,
    "ended.lanes": lambda m: m.ended.lanes,
    "ended.final_observations[radar]": lambda m: m.ended.final_observations[0],
    "ended.final_observations[fuel]": lambda m: m.ended.final_observations[1],
    "ended.final_observations[camera]": lambda m: m.ended.final_observations[2],
    "ended.final_observations[lamps]": lambda m: m.ended.final_observations[3],
    "ended.metrics": lambda m: m.ended.metrics,
}


def a_full_message():
    return pack_step(a_step(ended=[1], truncated=[4], masks=True, deciding=range(LANES)))


def test_a_full_step_is_accepted():
    assert Codec(PILOT, ARENAS).unpack_step(a_full_message()).ended.tolist() == [1, 4]


@pytest.mark.parametrize("field", TENSORS)
def test_every_tensor_of_a_step_is_checked_and_named(field):
    for damage in (
        lambda t: t.Clear(),
        lambda t: setattr(t, "dtype", pb.DTYPE_UINT8 if t.dtype != pb.DTYPE_UINT8 else pb.DTYPE_BOOL),
        lambda t: t.shape.append(1),
        lambda t: t.shape.__setitem__(0, t.shape[0] + 1),
        lambda t: setattr(t, "data", t.data + b"\0"),
        lambda t: setattr(t, "data", t.data[:-1]),
    ):
        message = a_full_message()
        damage(TENSORS[field](message))
        assert step_refusal(message).startswith(f"pilot.{field}: ")


@pytest.mark.parametrize(
    "field", ["rewards", "observations[radar]", "ended.final_observations[radar]", "ended.metrics"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_every_float_of_a_step_must_be_finite(field, value):
    message = a_full_message()
    tensor = TENSORS[field](message)
    tensor.data = tensor.data[:-4] + np.float32(value).tobytes()
    assert step_refusal(message).startswith(f"pilot.{field}: value {value} at ")


@pytest.mark.parametrize(
    "field", ["terminated", "truncated", "masks[gear]", "masks[fire]", "deciding", "observations[lamps]"]
)
def test_every_boolean_of_a_step_must_be_0_or_1(field):
    message = a_full_message()
    tensor = TENSORS[field](message)
    tensor.data = tensor.data[:-1] + b"\x02"
    assert step_refusal(message) == f"pilot.{field}: a boolean is 2, expected 0 or 1"


@pytest.mark.parametrize("number", [0, 3, 5])
def test_a_step_has_one_observation_per_sensor(number):
    message = a_full_message()
    parts = [*message.observations, *message.observations][:number]
    message.ClearField("observations")
    message.observations.extend(parts)
    assert step_refusal(message) == f"pilot.observations: {number} tensors, expected 4, one per sensor"
    message = a_full_message()
    message.ended.ClearField("final_observations")
    message.ended.final_observations.extend(parts)
    assert step_refusal(message) == f"pilot.ended.final_observations: {number} tensors, expected 4, one per sensor"


def test_masks_come_for_every_branch_or_not_at_all():
    message = a_full_message()
    del message.masks[1]
    assert step_refusal(message) == "pilot.masks: 1 tensors, expected 2, one per branch, or none"
    message.ClearField("masks")
    assert Codec(PILOT, ARENAS).unpack_step(message).masks is None


def test_a_mask_must_allow_something_in_every_lane():
    step = a_step(masks=True)
    step.masks[1][3] = False
    assert step_refusal(pack_step(step)) == "pilot.masks[fire]: lane 3 allows no choice, expected at least one"


def test_only_an_episode_that_is_truncated_can_be_interrupted():
    step = a_step(ended=[0, 4], truncated=[2, 3])
    step.interrupted = np.array([False, True, False, False])  # of lanes 0, 2, 3 and 4
    codec = Codec(PILOT, ARENAS)
    came = codec.unpack_step(pack_step(step))
    assert came.interrupted is not None and came.interrupted.tolist() == [False, True, False, False]
    step.interrupted[:] = [False, True, False, True]
    with pytest.raises(TensorError, match=r"pilot\.ended\.interrupted: lane 4 is interrupted, but not truncated"):
        codec.unpack_step(pack_step(step))


def test_no_lane_ends_twice():
    step = a_step(ended=[1, 2], truncated=[2, 3])
    assert step_refusal(pack_step(step)) == "pilot: lane 2 is both terminated and truncated, expected at most one"


@pytest.mark.parametrize("lanes", [[4, 1], [1, 1], [1, 3], [-1, 4], [1, 6]])
def test_the_lanes_that_ended_are_those_that_terminated_or_truncated_ascending(lanes):
    message = a_full_message()
    message.ended.lanes.CopyFrom(pack(np.array(lanes, np.int32)))
    assert (
        step_refusal(message) == f"pilot.ended.lanes: got {lanes}, expected the terminated and truncated lanes [1, 4]"
    )


def test_an_end_cannot_be_left_out_nor_made_up():
    message = a_full_message()
    message.ClearField("ended")
    assert step_refusal(message).startswith("pilot.ended.lanes: ")
    quiet = pack_step(a_step())
    quiet.ended.CopyFrom(a_full_message().ended)
    assert step_refusal(quiet) == "pilot.ended.lanes: shape is [2], expected [0]"


def test_metrics_come_only_from_a_behavior_that_has_some():
    behavior = pb.Behavior()
    behavior.CopyFrom(PILOT)
    behavior.ClearField("metrics")
    message = pack_step(a_step(ended=[1], behavior=behavior))
    assert not message.ended.HasField("metrics")
    assert Codec(behavior, ARENAS).unpack_step(message).metrics is None
    assert step_refusal(message).startswith("pilot.ended.metrics: ")
