"""Four ways to move a pointer with axes and branches: the option `locomotion` of the two games of the paper.

They are those of the paper's section IV-D. Each gives the agent other axes and branches. In all of them, full
deflection is the pointer's top speed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.simulator import axis, branch, option, sensor
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import cosine, sine
from joybridge.v1 import bridge_pb2 as pb

GRID = 5  # cells per side of the grid around the pointer
TURN = np.pi / 6  # rad per decision at full deflection of the axis "turn"


@dataclass(frozen=True)
class Locomotion:
    """One way to move the pointer: its axes, branches and sensors, and the velocity for an action."""

    description: str
    # (act, heading [lanes]) -> velocity [lanes, 2] in units of the top speed; may change the heading in place
    velocity: Callable[[ActArrays, Array], Array]
    axes: tuple[pb.Axis, ...]
    branches: tuple[pb.Branch, ...] = ()
    sensors: tuple[pb.Sensor, ...] = ()


@compiled
def _polar(angle: Array, speed: Array) -> Array:
    velocity = np.empty((len(angle), 2))
    for i in range(len(angle)):
        velocity[i, 0] = cosine(angle[i]) * speed[i]
        velocity[i, 1] = sine(angle[i]) * speed[i]
    return velocity


def _unit_circle(act: ActArrays, heading: Array) -> Array:
    axes = act.axes.astype(np.float64)
    return _polar(axes[:, 0] * (0.5 * np.pi), axes[:, 1].copy())


def _axes(act: ActArrays, heading: Array) -> Array:
    return act.axes[:, :2].astype(np.float64)


def _steer(act: ActArrays, heading: Array) -> Array:
    axes = act.axes.astype(np.float64)
    heading += axes[:, 0] * TURN
    heading -= 2 * np.pi * np.round(heading / (2 * np.pi))
    return _polar(heading.copy(), axes[:, 1].copy())


def observe_heading(heading: Array) -> Array:
    """Return the values of the sensor "heading" of `steer`, float32 [lanes, 2], for headings in rad [lanes]."""
    return _polar(heading.copy(), np.ones(len(heading))).astype(np.float32)


_STEPS = np.arange(GRID) - GRID // 2
_CELLS = np.array([(x, y) for y in _STEPS for x in _STEPS]) / (GRID // 2)  # velocity per cell, in top speeds
_CELL_NAMES = [f"{x:+d},{y:+d}" for y in _STEPS for x in _STEPS]


def _grid(act: ActArrays, heading: Array) -> Array:
    return _CELLS[act.choices[:, 0]] * act.axes[:, :1].astype(np.float64)


SIGNED_SPEED = "fraction of the top speed; negative: backwards"

LOCOMOTIONS = {
    "unit_circle": Locomotion(
        "an angle within ±90° and a signed speed; a negative speed reverses",
        _unit_circle,
        axes=(
            axis("angle", description="fraction of 90°, counter-clockwise from +x", kind="angle"),
            axis("speed", description=SIGNED_SPEED),
        ),
    ),
    "axes": Locomotion(
        "a velocity along x and one along y",
        _axes,
        axes=(
            axis("velocity_x", description="fraction of the top speed", kind="velocity", way="right"),
            axis("velocity_y", description="fraction of the top speed", kind="velocity", way="up"),
        ),
    ),
    "steer": Locomotion(
        "a turn of the heading, at most 30° per decision, and a signed speed along the heading",
        _steer,
        axes=(
            axis("turn", description="fraction of 30°, counter-clockwise"),
            axis("speed", description=SIGNED_SPEED),
        ),
        sensors=(sensor("heading", [2], -1.0, 1.0, "direction of the heading", elements=["cosine", "sine"]),),
    ),
    "grid": Locomotion(
        f"a cell of a {GRID} × {GRID} grid around the pointer to move towards, faster for cells farther away, and a "
        "speed",
        _grid,
        axes=(axis("speed", 0.0, 1.0, "fraction of the cell's speed"),),
        branches=(branch("cell", _CELL_NAMES, "x,y of the cell, relative to the pointer"),),
    ),
}

LOCOMOTION_OPTION = option(
    "locomotion",
    list(LOCOMOTIONS),
    description="how actions move the pointer: "
    + "; ".join(f"{name}: {locomotion.description}" for name, locomotion in LOCOMOTIONS.items()),
)
