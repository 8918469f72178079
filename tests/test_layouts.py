"""Layouts by name: spaced values, joint choices, mixtures, and those of other packages."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.layouts import AxisRange, AxisTable, DeviceError, JointTable, list_roles, make_layouts
from joybridge.layouts.check import check_layouts
from joybridge.v1 import bridge_pb2 as pb
from tests.support.own_layouts import ENTRY_POINTS, offer
from tests.test_actions import POINTER, make_device


@pytest.fixture
def other_packages(tmp_path, monkeypatch):
    """Install two packages with layouts."""
    offer(tmp_path, "compass", ENTRY_POINTS)
    offer(tmp_path, "again", "[joybridge.layouts]\ntwice = elsewhere:twice\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])


def positions(name: str, device: pb.Device = POINTER) -> list[list[float]]:
    """Return the values of each axis that a layout of one policy gives branches of their own."""
    (layout,) = make_layouts(name, device).values()
    return [part.values.tolist() for part in layout.discrete if isinstance(part, AxisTable)]


def test_where_every_joint_choice_is_forbidden_the_device_gets_what_it_allows():
    device = make_device([], [2, 2])
    for name in ("bucket-3", "joint-3"):
        (layout,) = make_layouts(name, device).values()
        walls = [np.array([[False, True], [True, True]])] * 2  # the first lane may make no first choice
        (allowed,) = layout.masks(walls)
        assert allowed.any(axis=1).all() and allowed[1].all()
        for choice in np.flatnonzero(allowed[0]):
            act = ActArrays(np.zeros((2, 0), np.float32), np.zeros((2, 2), np.int32))
            layout.write(np.zeros((2, 0)), np.array([[choice], [0]]), act, walls)
            assert act.choices[0].tolist() == [1, 1]


def test_mu_law_values_are_those_of_vpt_on_any_axis():
    # MineRL's camera turns by up to 10 degrees; VPT's 11 bins are these.
    (values,) = positions("bucket-11-mu", make_device([(-10, 10)], []))
    assert values == pytest.approx([-10, -5.81, -3.22, -1.61, -0.62, 0, 0.62, 1.61, 3.22, 5.81, 10], abs=0.006)
    (values,) = positions("bucket-3-mu", make_device([(2, 3)], []))
    assert values == [2.0, 2.5, 3.0]


def test_joint_choices_are_all_combinations_and_a_mask_forbids_those_that_contain_a_forbidden_choice():
    device = make_device([(-1, 1), (0, 4)], [2, 3])
    (layout,) = make_layouts("joint-3", device).values()
    assert layout.space.branches == (3 * 3 * 2 * 3,) and layout.space.continuous == 0
    choices = np.arange(54)
    act = ActArrays(np.zeros((54, 2), np.float32), np.zeros((54, 2), np.int32))
    layout.write(np.zeros((54, 0), np.float32), choices[:, None], act)
    rows = {(*axes, *branches) for axes, branches in zip(act.axes.tolist(), act.choices.tolist(), strict=True)}
    assert rows == {(x, y, a, b) for x in (-1, 0, 1) for y in (0, 2, 4) for a in (0, 1) for b in (0, 1, 2)}
    (allowed,) = layout.masks([np.array([[True, False]] * 54), np.array([[True, False, True]] * 54)])
    np.testing.assert_array_equal(allowed[0], (act.choices[:, 0] == 0) & (act.choices[:, 1] != 1))
    assert layout.names(device) == (["axis0+axis1+branch0+branch1"], [])


def test_more_joint_choices_than_can_be_learned_are_refused_before_they_are_made():
    with pytest.raises(
        ConfigError, match=r"'joint-10' cannot express this device: 10,000,000 joint choices, .* 10,000;"
    ):
        make_layouts("joint-10", make_device([(-1, 1)] * 7, []))
    with pytest.raises(ConfigError, match=r"about 10\^4000 joint choices"):
        make_layouts("joint-10000", make_device([(-1, 1)] * 1000, []))


def test_single_axes_and_branches_may_have_other_layouts():
    (layout,) = make_layouts("bucket-11, speed=bucket-3-mu, reload=hybrid,shoot=threshold-0.0", POINTER).values()
    assert layout.names(POINTER) == (["angle", "speed", "reload"], ["shoot"])
    assert layout.space.branches == (11, 3, 2)
    act = ActArrays(np.zeros((1, 2), np.float32), np.zeros((1, 2), np.int32))
    layout.write(np.array([[0.4]], np.float32), np.array([[0, 2, 1]]), act)
    assert act.axes.tolist() == [[-1.0, 1.0]] and act.choices.tolist() == [[1, 1]]


def test_parts_with_the_same_layout_are_held_together():
    (layout,) = make_layouts("hybrid, angle=joint-3, speed=joint-3", POINTER).values()
    assert layout.names(POINTER) == (["angle+speed", "shoot", "reload"], [])
    assert layout.space.branches == (9, 2, 2)
    # All parts are elsewhere, and nothing is left for hybrid.
    (layout,) = make_layouts("multiagent, angle=hybrid, speed=hybrid, shoot=hybrid, reload=hybrid", POINTER).values()
    assert [type(part) for part in layout.continuous] == [AxisRange, AxisRange]


def test_behaviors_may_have_other_layouts():
    spec = pb.GameSpec(name="tag", behaviors=[pb.Behavior(name=name, device=POINTER) for name in ("hunter", "prey")])
    roles = list_roles("bucket-3, prey=hybrid, hunter.angle=bucket-5, prey.shoot=threshold-0.5", spec)
    assert [role.name for role in roles] == ["hunter", "prey"]
    assert [role.layout.space.branches for role in roles] == [(5, 3, 3), (2,)]
    assert [role.layout.space.continuous for role in roles] == [0, 3]
    roles = list_roles("hybrid, prey=multiagent", spec)
    assert [role.name for role in roles] == ["hunter", "prey-axes", "prey-buttons"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "bucket-3, angel=hybrid",
            "'bucket-3, angel=hybrid' is about 'angel', which tag lacks; it has hunter, angle, ",
        ),
        ("bucket-3, prey=hybrid", "about 'prey', which tag lacks"),
        ("bucket-3, angle", "got 'angle' in 'bucket-3, angle', expected NAME=LAYOUT after a comma"),
        ("bucket-3,", "got '' in 'bucket-3,', expected NAME=LAYOUT"),
        ("bucket-3, angle=", "expected NAME=LAYOUT"),
        ("bucket-3, angle=hybrid, angle=bucket-5", "'angle' stands twice"),
        ("bucket-3, angle=bukket-5", "unknown layout 'bukket-5', expected hybrid, multiagent, bucket-N, "),
        ("bucket-3, angle=multiagent", "'multiagent' has several policies, so it cannot be mixed with others"),
        ("bucket-3-nu", "unknown layout 'bucket-3-nu', expected bucket-N or bucket-N-mu with N in 2..10000"),
        ("bucket-10001", "unknown layout 'bucket-10001', expected bucket-N or"),
        ("joint", "unknown layout 'joint', expected joint-N or joint-N-mu"),
    ],
)
def test_a_wrong_name_is_refused_with_what_was_expected(name, message):
    spec = pb.GameSpec(name="tag", behaviors=[pb.Behavior(name="hunter", device=POINTER)])
    with pytest.raises(ConfigError, match=message):
        list_roles(name, spec)


def test_an_installed_package_offers_layouts_by_entry_points(other_packages):
    (layout,) = make_layouts("compass-4", POINTER).values()
    assert layout.names(POINTER) == (["angle+speed", "shoot", "reload"], [])
    (table, *_) = layout.discrete
    assert isinstance(table, JointTable) and table.positions is not None
    np.testing.assert_allclose(table.positions, [[1, 0], [0, 1], [-1, 0], [0, -1], [0, 0]], atol=1e-6)
    assert make_layouts("hybrid", POINTER)[""].space.continuous == 2  # nobody else's


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("compass-x", "unknown layout 'compass-x', expected compass-N with N directions"),
        ("compas-8", "unknown layout 'compas-8', expected hybrid, .*, careless, compass, "),
        ("compass-8, speed=hybrid", "'compass-8' cannot express this device: it has 1 axes, and a compass moves two"),
        ("missing", "'missing' cannot be loaded from 'tests.support.own_layouts:nothing': .* no attribute 'nothing'"),
        ("twice", "'twice' is offered by .* and .*; uninstall one"),
        ("careless-forgets", "'careless-forgets' cannot express this device: it sets 'angle' 0 times, expected once"),
        ("careless-repeats", "it sets 'angle' 2 times, expected once"),
        ("careless-overshoots", r"it sets 'reload' to \[2\], expected values in 0..1"),
        ("careless-inverts", r"it has a range 1\.\.-1 of axis 0, expected low < high"),
        ("careless-misses", "it has a table of 2 rows for 2 axes with 0 positions, expected positions where"),
        ("leaving-exit", "'leaving-exit' cannot be made: SystemExit: 0"),
        ("leaving-error", r"'leaving-error' cannot be made: RuntimeError: \\x1b\[2J"),
        ("leaving", "'leaving' cannot be made: TypeError"),
        ("careless", "it sets branch 7 of a device with 2, counted from 0"),
    ],
)
def test_what_is_wrong_with_a_layout_of_another_package_is_said_in_a_sentence(name, message, other_packages):
    with pytest.raises(ConfigError, match=message):
        make_layouts(name, POINTER)


def test_the_layout_in_the_page_about_layouts_is_what_the_text_says():
    page = (Path(__file__).parents[1] / "docs" / "layouts.md").read_text()
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {}
    exec(program, names)  # it is ours
    pointer = make_device([(-1, 1), (0, 4)], [])
    layout = names["compass"](pointer, "4")
    check_layouts([layout], pointer)
    np.testing.assert_allclose(layout.discrete[0].positions, [[1, 2], [0, 4], [-1, 2], [0, 0]], atol=1e-6)
    with pytest.raises(DeviceError, match="a compass moves two axes and presses nothing"):
        names["compass"](POINTER, "4")
