"""`joybridge play`: which keys, pointer and gamepad act on which axes and branches."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from joybridge.simulator import axis, behavior, branch, button
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.controls import Choice, Stick, make_controls


def controls(axes=(), branches=()):
    spec = pb.GameSpec(behaviors=[behavior("one", sensors=[], axes=list(axes), branches=list(branches))])
    return make_controls(spec)


@pytest.mark.parametrize(
    ("names", "pairs", "pointer"),
    [
        (["x", "y"], [(0, 1)], "position"),
        (["velocity_x", "velocity_y"], [(0, 1)], "movement"),
        (["tilt_y", "tilt_x"], [(1, 0)], "stick"),
        (["moveX", "moveZ"], [(0, 1)], "movement"),
        (["aim x", "throttle", "aim y"], [(0, 2), (None, 1)], "position"),
        (["steer", "gas"], [(0, 1)], "stick"),
        (["rudder"], [(0, None)], "stick"),
        (["a", "b", "c"], [(0, 1), (2, None)], "stick"),
        (["left x", "left y", "right x", "right y"], [(0, 1), (2, 3)], "stick"),
    ],
)
def test_axes_that_belong_together_are_one_stick(names, pairs, pointer):
    made = controls(axes=[axis(name) for name in names])
    assert [control.axes for control in made] == pairs
    assert made[0].pointer == pointer and all(control.pointer == "off" for control in made[1:])


@pytest.mark.parametrize(("low", "span"), [(-1.0, 90.0), (0.0, 180.0)])
def test_an_angle_and_a_speed_are_a_stick_and_a_negative_speed_is_the_other_half_of_the_circle(low, span):
    (stick,) = controls(axes=[axis("speed", low, 1.0), axis("angle")])
    assert (stick.axes, stick.span, stick.pointer) == ((1, 0), span, "movement")


def test_choices_have_keys_that_fit_their_names():
    walk, lid = controls(branches=[branch("walk", ["left", "stay", "right"]), button("lid")])
    assert walk.rest == 1 and walk.keys[1] == []
    assert "ArrowLeft" in walk.keys[0] and "ArrowRight" in walk.keys[2]
    assert lid.keys[0] == [] and {"Mouse0", "Space", "KeyL"} <= set(lid.keys[1])
    (field,) = controls(branches=[branch("field", [f"f{number}" for number in range(12)])])
    assert field.keys == [[f"Digit{digit}"] for digit in range(1, 10)] + [[]] * 3


def test_what_a_spec_says_comes_before_its_names():
    axes = [axis("tilt", kind="position", way="down"), axis("pan", kind="position", way="left"), axis("gas")]
    stick, gas = controls(axes=axes, branches=[])
    assert (stick.axes, stick.pointer, stick.invert) == ((1, 0), "position", (True, True))
    assert (gas.axes, gas.pointer) == ((None, 2), "off")
    (mover,) = controls(axes=[axis("x", kind="velocity"), axis("y", kind="velocity")])
    assert (mover.pointer, mover.invert) == ("movement", (False, False))
    stick, catch, guess = controls([axis("x"), axis("y")], [button("catch", key="a"), button("hop")])
    assert catch.keys == [[], ["KeyA", "Pad0"]] and "KeyA" not in stick.keys[0] and "ArrowLeft" in stick.keys[0]
    assert guess.keys[1] and not {"KeyA", "Pad0"} & set(guess.keys[1])
    (gear,) = controls(branches=[branch("gear", ["low", "middle", "high"], keys=["1", "", "mouse right"])])
    assert gear.keys == [["Digit1"], [], ["Mouse2"]]


@given(
    st.lists(st.sampled_from(["x", "y", "z", "dx", "turn", "speed", "angle", "grip 1", "Ünï", "7"]), max_size=7),
    st.lists(st.integers(2, 12), max_size=7),
)
def test_every_axis_and_branch_has_one_control_and_no_key_has_two_meanings(names, sizes):
    made = controls(
        [axis(f"{name}{'_' * number}") for number, name in enumerate(names)],
        [branch(f"b{number}", [f"c{choice}" for choice in range(size)]) for number, size in enumerate(sizes)],
    )
    sticks = [control for control in made if isinstance(control, Stick)]
    choices = [control for control in made if isinstance(control, Choice)]
    assert sorted(one for stick in sticks for one in stick.axes if one is not None) == list(range(len(names)))
    assert [(choice.branch, len(choice.keys)) for choice in choices] == list(enumerate(sizes))
    keys = [key for control in made for codes in control.keys for key in codes]
    assert len(keys) == len(set(keys))
