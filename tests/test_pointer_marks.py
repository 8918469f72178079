"""Crosses where agents put their pointers."""

import numpy as np
import pytest

from joybridge.layouts import make_acts
from joybridge.play.pointer_marks import BRIGHT, mark_pointers, pointers
from joybridge.simulator import axis, behavior, button, sensor
from joybridge.v1 import bridge_pb2 as pb


def game(*axes, agents=1):
    hand = behavior("hand", sensors=[sensor("fish", [2])], axes=axes, branches=[button("cast")], agents=agents)
    return pb.GameSpec(name="pond", behaviors=[hand])


@pytest.mark.parametrize(
    ("ways", "place"),
    [(("right", "up"), (0.25, 0.0)), (("left", "down"), (0.75, 1.0)), (("right", "down"), (0.25, 1.0))],
)
def test_a_pointer_is_where_its_axes_put_it(ways, place):
    spec = game(*(axis(name, 0, 4, kind="position", way=way) for name, way in zip("xy", ways, strict=True)))
    acts = make_acts(spec, 2)
    acts[0].axes[:] = [[1.0, 4.0], [3.0, 3.0]]  # the second arena is not drawn
    assert list(pointers(spec, acts)) == [place]


def test_a_cross_is_drawn_within_the_picture_and_the_picture_itself_stays():
    spec = game(axis("x", kind="position", way="right"), axis("y", kind="position", way="up"), agents=2)
    acts, picture = make_acts(spec, 1), np.full((41, 61, 3), 128, np.uint8)
    acts[0].axes[:] = [[0.0, 0.0], [-1.0, 9.0]]
    marked = mark_pointers(picture, spec, acts)
    assert (picture == 128).all()
    for arms in (marked[20, 30 - 3 : 30 + 3 + 1], marked[20 - 3 : 20 + 3 + 1, 30]):
        assert (arms[[0, 1, 5, 6]] == BRIGHT).all() and (arms[2:5] == 128).all()  # what is pointed at is seen
    assert (marked[0, 0] == 128).all() and (marked[0, 3] == BRIGHT).all()  # beyond the corner counts as the corner
    assert (marked[:, 45:] == 128).all()


def test_axes_that_do_not_say_that_they_are_positions_have_no_cross():
    spec = game(axis("x", kind="velocity", way="right"), axis("y", kind="velocity", way="up"))
    picture = np.zeros((8, 8, 3), np.uint8)
    assert mark_pointers(picture, spec, make_acts(spec, 1)) is picture
