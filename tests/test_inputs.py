"""What agents press is drawn below the pictures of a video."""

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.play.input_overlay import KEY, MARGIN, PAD, Inputs
from joybridge.v1 import bridge_pb2 as pb

KEYS, ACCENT = (43, 47, 59), (224, 112, 60)
PICTURE = np.full((30, 200, 3), 7, np.uint8)


def make_spec(axes, branches, agents=1):
    device = pb.Device(
        axes=[pb.Axis(name=name, low=low, high=high) for name, low, high in axes],
        branches=[pb.Branch(name=name, choices=choices) for name, choices in branches.items()],
    )
    behavior = pb.Behavior(name="player", agents_per_arena=agents, device=device)
    return pb.GameSpec(name="game", behaviors=[behavior], picture=pb.PictureSize(width=200, height=30))


def draw(spec, axes, choices):
    inputs = Inputs(spec)
    acts = ActArrays(np.array(axes, np.float32), np.array(choices, np.int32))
    shown = inputs.below(PICTURE, [acts])
    assert shown.shape == (30 + inputs.height, 200, 3) and shown.dtype == np.uint8
    np.testing.assert_array_equal(shown[:30], PICTURE)
    return shown[30:]


def middle(pixels, color):
    """Return the middle of the pixels of a color, as x and y."""
    rows, columns = np.nonzero((pixels == color).all(axis=2))
    return (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2


def test_a_stick_goes_right_with_the_first_axis_and_up_with_the_second():
    spec = make_spec([("x", -1, 1), ("y", 0, 10)], {})
    assert np.allclose(middle(draw(spec, [[0, 5]], [[]]), ACCENT), MARGIN + PAD / 2, atol=1)
    x, y = middle(draw(spec, [[1, 10]], [[]]), ACCENT)
    assert x > MARGIN + 0.8 * PAD and y < MARGIN + 0.2 * PAD


def test_a_single_axis_goes_to_the_right():
    spec = make_spec([("move", -1, 1)], {})
    places = [middle(draw(spec, [[value]], [[]]), ACCENT) for value in (-1, 0, 1)]
    assert [x for x, _ in places] == sorted({x for x, _ in places}) and len({y for _, y in places}) == 1


def test_a_key_is_colored_while_it_is_pressed():
    spec = make_spec([], {"fire": ["no", "yes"]})
    released, pressed = (draw(spec, [[]], [[choice]]) for choice in (0, 1))
    corner = MARGIN + (PAD - KEY) // 2 + 2, MARGIN + 5
    assert tuple(released[corner]) == KEYS and tuple(pressed[corner]) == ACCENT


def test_the_choice_of_a_branch_is_written_and_all_agents_are_shown_in_rows():
    spec = make_spec([], {"gear": ["low", "middle", "the highest there is"]}, agents=3)
    assert Inputs(spec).height == 3 * (PAD + MARGIN) + MARGIN
    first, second = (draw(spec, np.zeros((3, 0)), [[choice], [0], [0]]) for choice in (1, 2))
    changed = np.nonzero((first != second).any(axis=(1, 2)))[0]
    assert changed.size and changed.max() < MARGIN + PAD  # only the row of the first agent
