"""One device for several games, from the names of their parts or by hand."""

import numpy as np
import pytest

from joybridge.config.errors import ConfigError
from joybridge.layouts import make_layouts
from joybridge.layouts.common_device import common_device
from joybridge.layouts.conditions import Conditions, ConditionsOfGames
from joybridge.v1 import bridge_pb2 as pb


def device(*axes: str, **branches: list[str]) -> pb.Device:
    return pb.Device(
        axes=[pb.Axis(name=name, low=-1, high=1) for name in axes],
        branches=[pb.Branch(name=name, choices=choices) for name, choices in branches.items()],
    )


BUTTON = ["released", "pressed"]
SHOOTER = device("velocity_x", "velocity_y", shoot=BUTTON, reload=BUTTON)
MARBLE = device("tilt_x", "tilt_y")
ARCHER = device("turn", string=["rest", "draw", "loose"])
CHIMP = device("pointer_y", "pointer_x", mouse_left=BUTTON)


def test_a_pointer_and_buttons_are_found_by_what_the_games_call_them():
    games = {"shooter": SHOOTER, "marble": MARBLE, "archer": ARCHER, "chimp": CHIMP}
    common = common_device(games, {})
    assert list(common.lines(games)) == [
        "x = shooter: velocity_x, marble: tilt_x, archer: turn, chimp: pointer_x",
        "y = shooter: velocity_y, marble: tilt_y, chimp: pointer_y",
        "button1 (released | pressed) = shooter: shoot, chimp: mouse_left",
        "button2 (released | pressed) = shooter: reload",
        "string (rest | draw | loose) = archer: string",
    ]
    assert common.games["chimp"].axes == [1, 0]


def test_axes_that_point_left_or_down_are_turned_around():
    below = device("cursor_x", "cursor_y")
    below.axes[1].way = pb.WAY_DOWN
    games = {"marble": MARBLE, "paint": below}
    common = common_device(games, {})
    assert list(common.lines(games)) == [
        "x = marble: tilt_x, paint: cursor_x",
        "y = marble: tilt_y, paint: -cursor_y",
    ]
    assert [placed.signs for placed in common.games.values()] == [[1, 1], [1, -1]]


def test_what_is_written_by_hand_goes_before_the_names():
    games = {"shooter": SHOOTER, "other": device("turn", walk=["left", "right"], fire=BUTTON)}
    common = common_device(games, {"trigger": ["shoot", "other.fire"]})
    assert list(common.lines(games))[2:] == [
        "trigger (released | pressed) = shooter: shoot, other: fire",
        "button1 (released | pressed) = shooter: reload, other: walk",
    ]


def test_choices_of_different_games_share_a_branch_as_long_as_the_longest():
    games = {"one": device(gear=["low", "high", "top"]), "two": device(gear=["a", "b", "c", "low"])}
    (gear,) = common_device(games, {}).device.branches
    assert list(gear.choices) == ["low", "high", "top", "low (3)"]


@pytest.mark.parametrize(
    ("by_hand", "wrong"),
    [
        ({"fire": ["shot"]}, "no game has 'shot'; there are archer.string, archer.turn, shooter.reload"),
        ({"fire": ["shoot", "reload"]}, "stands for two parts of the device of shooter"),
        ({"fire": ["shoot"], "other": ["shooter.shoot"]}, "shooter.shoot stands under fire as well"),
        ({"fire": ["shoot", "turn"]}, "stands for axes and for branches"),
    ],
)
def test_a_mapping_that_cannot_be_is_refused(by_hand, wrong):
    with pytest.raises(ConfigError, match=wrong):
        common_device({"shooter": SHOOTER, "archer": ARCHER}, by_hand)


def test_what_a_game_lacks_never_counts_and_its_own_conditions_hold():
    aimer = device("aim_x", "aim_y", shoot=BUTTON)
    for axis in aimer.axes:
        axis.only_with.CopyFrom(pb.Condition(branch="shoot", choice="pressed"))
    games = {"archer": ARCHER, "aimer": aimer}
    common = common_device(games, {})
    assert [axis.name for axis in common.device.axes] == ["x", "y"]
    assert [branch.name for branch in common.device.branches] == ["string", "button1"]
    layout = make_layouts("hybrid", common.device)[""]  # parts: string, button1, x, y
    conditions = [
        Conditions(layout, common.used_as("archer", ARCHER), no_axes=[1], no_branches=[1]),
        Conditions(layout, common.used_as("aimer", aimer), no_branches=[0]),
    ]
    counts = ConditionsOfGames(conditions, np.array([0, 1, 1])).counts(np.array([[2, 0], [0, 0], [0, 1]]))
    assert counts.astype(int).tolist() == [[1, 0, 1, 0], [0, 1, 0, 0], [0, 1, 1, 1]]
