"""The stable names: each `__all__` is complete and documented, and the simulator's is cheap and enough for a game."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import joybridge.simulator
from joybridge.contract.spec import check_spec
from joybridge.simulator import (
    Game,
    axis,
    behavior,
    branch,
    button,
    image,
    metric,
    option,
    parameter,
    render,
    sensor,
    spec,
    transition,
)
from joybridge.v1 import bridge_pb2 as pb


def test_the_package_exports_exactly_what_it_imports_for_authors():
    public = {n for n, value in vars(joybridge.simulator).items() if n[0] != "_" and not isinstance(value, ModuleType)}
    assert joybridge.simulator.__all__ == sorted(public)


def test_render_exports_exactly_what_it_defines():
    tree = ast.parse(Path(render.__file__).read_text(encoding="utf-8"))
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    targets = [node.targets[0] for node in tree.body if isinstance(node, ast.Assign)]
    defined |= {target.id for target in targets if isinstance(target, ast.Name)}
    assert set(render.__all__) == {name for name in defined if name[0] != "_"}


def test_the_packages_docstring_lists_every_public_name():
    assert set(joybridge.simulator.__all__) <= set(str(joybridge.simulator.__doc__).replace(",", " ").split())


PROMISED = [
    "joybridge.adapters.hooks",
    "joybridge.adapters.tapes",
    *(
        f"joybridge.contract.{name}"
        for name in ("address", "codec", "credentials", "errors", "limits", "spec", "tensors", "versions")
    ),
    "joybridge.gym",
    "joybridge.gym.sb3",
    "joybridge.simulator",
    "joybridge.simulator.render",
    "joybridge.simulator.canvas",
    "joybridge.simulator.sight",
    "joybridge.layouts",
    "joybridge.play.agent",
    "joybridge.run.results",
    "joybridge.client.client",
]


def test_the_contributing_guide_names_the_modules_whose_names_are_stable():
    text = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    promise = text[text.index("- the names in `__all__`") :].split("\n\n")[0]
    assert sorted(re.findall(r"`(joybridge[\w.]*)`", promise)) == sorted(PROMISED)


@pytest.mark.parametrize("path", PROMISED)
def test_a_module_exports_every_public_class_and_function_that_it_defines_and_all_have_docstrings(path):
    module = importlib.import_module(path)
    objects = {
        name: value for name, value in vars(module).items() if inspect.isclass(value) or inspect.isfunction(value)
    }
    public = {name for name, value in objects.items() if name[0] != "_" and value.__module__ == path}
    assert public <= set(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        if name in objects and not value.__module__.startswith("joybridge.v1"):  # messages have comments instead
            assert value.__doc__ and not value.__doc__.startswith(f"{name}("), f"{name} has no docstring of its own"


def test_importing_the_package_loads_no_server_no_compiler_and_no_drawing():
    program = "import sys, joybridge.simulator; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(result.stdout.split())
    assert "joybridge.simulator.game" in loaded
    assert loaded.isdisjoint({"grpc", "numba", "pygame", "joybridge.games", "joybridge.simulator.service"})


# ------------------------------------------------------------------------------------------------ parts of a spec


@pytest.mark.parametrize(
    ("dtype", "wire"),
    [
        ("float32", pb.DTYPE_FLOAT32),
        (np.int32, pb.DTYPE_INT32),
        (np.uint8, pb.DTYPE_UINT8),
        (bool, pb.DTYPE_BOOL),
        (np.dtype(">i4"), pb.DTYPE_INT32),
    ],
)
def test_a_sensor_has_the_dtype_that_is_asked_for(dtype, wire):
    assert sensor("image", [2, 3], dtype=dtype) == pb.Sensor(name="image", dtype=wire, shape=[2, 3])


@pytest.mark.parametrize("dtype", [float, np.int64, "U3", None])
def test_a_sensor_of_a_dtype_that_cannot_be_sent_is_refused(dtype):
    with pytest.raises(ValueError, match=r"sensor 'image' has dtype .*, expected one of float32, int32, uint8, bool"):
        sensor("image", [2], dtype=dtype)


def test_bounds_of_a_sensor_are_none_or_one_or_one_per_element():
    assert sensor("a", [2, 2]) == pb.Sensor(name="a", dtype=pb.DTYPE_FLOAT32, shape=[2, 2])
    one = sensor("a", [2, 2], 0, 1.5)
    assert list(one.low) == [0.0] and list(one.high) == [1.5]
    each = sensor("a", [2, 2], [[0, 1], [2, 3]], np.full((2, 2), 4))
    assert list(each.low) == [0.0, 1.0, 2.0, 3.0] and list(each.high) == [4.0] * 4


def test_an_image_is_a_sensor_of_bytes_that_says_its_color():
    eye, map_ = image("eye", 4, 5, channels=3, centered=True), image("map", 4, 5)
    assert (list(eye.shape), eye.image.color, eye.image.centered) == ([4, 5, 3], pb.COLOR_RGB, True)
    assert (list(map_.shape), map_.image.color, map_.image.centered) == ([4, 5, 1], pb.COLOR_GRAY, False)
    assert eye.dtype == pb.DTYPE_UINT8 and (eye.low[:], eye.high[:]) == ([0.0], [255.0])
    with pytest.raises(ValueError, match="image 'eye' has 4 channels, expected 1 for gray or 3 for RGB"):
        image("eye", 4, 5, channels=4)


def test_an_option_defaults_to_its_first_choice():
    assert option("size", ["small", "large"]).default_choice == "small"
    assert option("size", ["small", "large"], default="large").default_choice == "large"


class Whole(Game):
    """Uses every part of a spec."""

    name = "whole"
    description = "Everything at once."
    version = "2b"
    options = (option("size", ["2", "3"], "3", "cells"),)

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[
                sensor("cells", [int(options["size"])], dtype="uint8", elements=["a", "b", "c"]),
                image("eye", 4, 5, "what it sees", channels=3, centered=True),
            ],
            axes=[axis("x", 0.0, 2.0, only_with=("gear", "high"), kind="position", way="down")],
            branches=[branch("gear", ["low", "high"], keys=["left", "7"]), button("jump", key="space")],
            metrics=["plain", metric("explained", "with words")],
        )
        return spec(cls, [player], parameters=[parameter("wind", -1.0, 1.0, 0.5, "to the right")], picture=(4, 2))

    def reset(self):
        return transition({"cells": [0, 0, 0]})

    def step(self, action):
        return transition({"cells": [0, 0, 0]})


def test_a_spec_holds_its_parts():
    made = Whole.describe({"size": "3"})
    check_spec(made)
    (player,) = made.behaviors
    assert made.name == "whole" and made.options == [option("size", ["2", "3"], "3", "cells")]
    assert made.parameters[0].default_value == 0.5 and made.parameters[0].description == "to the right"
    assert [one.name for one in player.metrics] == ["plain", "explained"]
    assert player.metrics[1].description == "with words" and player.channels[0].name == "reward"
    assert (made.picture.width, made.picture.height, made.decision_interval) == (4, 2, 1)
    condition = player.device.axes[0].only_with
    assert made.version == "2b" and (condition.branch, condition.choice) == ("gear", "high")
    assert player.device.axes[0].high == 2.0 and player.device.branches[0].choices == ["low", "high"]
    assert (player.device.axes[0].kind, player.device.axes[0].way) == (pb.AXIS_KIND_POSITION, pb.WAY_DOWN)
    assert [list(one.keys) for one in player.device.branches] == [["ArrowLeft", "Digit7"], ["", "Space"]]


def test_a_kind_and_a_way_that_there_is_not_are_refused():
    with pytest.raises(ValueError, match="axis 'x' has kind 'place', expected one of position, velocity, angle"):
        axis("x", kind="place")
    with pytest.raises(ValueError, match="axis 'x' has way 'north', expected one of right, left, up, down"):
        axis("x", way="north")
