"""Four ways to steer a pointer with axes and branches: the `locomotion` option of the built-in games.

The paper (section IV-D) names them; each changes the device in the spec. In all of them full deflection is
the pointer's top speed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import cosine, sine
from joybridge.v1 import bridge_pb2 as pb

GRID = 5  # cells per side of the grid around the pointer
TURN = np.pi / 6  # rad per decision at full deflection of "steer"


@dataclass(frozen=True)
class Locomotion:
    """One way to steer: its part of the device, and the velocity that its actions command."""

    description: str
    axes: tuple[pb.Axis, ...]
    branches: tuple[pb.Branch, ...]
    # (act, heading [lanes]) -> velocity [lanes, 2] as a share of top speed; may turn the heading in place
    velocity: Callable[[ActArrays, Array], Array]


def _axis(name: str, description: str, low: float = -1.0) -> pb.Axis:
    return pb.Axis(name=name, description=description, low=low, high=1.0)


@compiled
def _polar(angle: Array, speed: Array) -> Array:
    velocity = np.empty((len(angle), 2))
    for i in range(len(angle)):
        velocity[i, 0] = cosine(angle[i]) * speed[i]
        velocity[i, 1] = sine(angle[i]) * speed[i]
    return velocity


def _unit_circle(act: ActArrays, heading: Array) -> Array:
    axes = act.axes.astype(np.float64)
    return _polar(axes[:, 0] * (0.5 * np.pi), axes[:, 1])


def _axes(act: ActArrays, heading: Array) -> Array:
    return act.axes[:, :2].astype(np.float64)


def _steer(act: ActArrays, heading: Array) -> Array:
    axes = act.axes.astype(np.float64)
    heading += axes[:, 0] * TURN
    heading -= 2 * np.pi * np.round(heading / (2 * np.pi))
    return _polar(heading, axes[:, 1])


_STEPS = np.arange(GRID) - GRID // 2
_CELLS = np.array([(x, y) for y in _STEPS for x in _STEPS]) / (GRID // 2)  # share of top speed per cell
_CELL_NAMES = [f"{x:+d},{y:+d}" for y in _STEPS for x in _STEPS]


def _grid(act: ActArrays, heading: Array) -> Array:
    return _CELLS[act.choices[:, 0]] * act.axes[:, :1].astype(np.float64)


LOCOMOTIONS = {
    "unit_circle": Locomotion(
        "an angle within ±90° and a signed speed; a negative speed reverses",
        (_axis("angle", "share of 90°, counter-clockwise from +x"), _axis("speed", "share of top speed; < 0 reverses")),
        (),
        _unit_circle,
    ),
    "axes": Locomotion(
        "a velocity along x and one along y",
        (_axis("velocity_x", "share of top speed"), _axis("velocity_y", "share of top speed")),
        (),
        _axes,
    ),
    "steer": Locomotion(
        "a turn of the heading, at most 30° per decision, and a signed speed along it",
        (_axis("turn", "share of 30°, counter-clockwise"), _axis("speed", "share of top speed; < 0 reverses")),
        (),
        _steer,
    ),
    "grid": Locomotion(
        f"a cell of a {GRID} × {GRID} grid around the pointer to move towards, the faster the farther, and a speed",
        (_axis("speed", "share of the cell's speed", low=0.0),),
        (pb.Branch(name="cell", description="x,y of the cell, counted from the pointer", choices=_CELL_NAMES),),
        _grid,
    ),
}

OPTION = pb.Option(
    name="locomotion",
    description="how the device steers the pointer: "
    + "; ".join(f"{name}: {locomotion.description}" for name, locomotion in LOCOMOTIONS.items()),
    choices=list(LOCOMOTIONS),
    default_choice="unit_circle",
)

HEADING_SENSOR = pb.Sensor(
    name="heading",
    description="the direction that `steer` turns",
    dtype=pb.DTYPE_FLOAT32,
    shape=[2],
    elements=["cosine", "sine"],
    low=[-1.0],
    high=[1.0],
)


def observe_heading(heading: Array) -> Array:
    """Return HEADING_SENSOR's values, float32 [lanes, 2], for headings in rad [lanes]."""
    return _polar(heading, np.ones(len(heading))).astype(np.float32)
