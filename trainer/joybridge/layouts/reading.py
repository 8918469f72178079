"""From what a device was given to the actions of a policy: the reverse of what the parts of a layout do.

What a part cannot express exactly becomes the nearest that it can: the nearest value of an axis, or the joint choice
that has most of the choices.
"""

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.layouts.targets import AxisRange, AxisTable, JointTable, Split, Threshold

ROWS = 1024  # that are compared with all joint choices at once


def read_continuous(part: AxisRange | Threshold | Split, act: ActArrays) -> Array:
    """Return where in -1..1 a continuous action acts like this, [lanes]; in the middle of what acts alike."""
    match part:
        case AxisRange():
            middle, half = (part.low + part.high) / 2, (part.high - part.low) / 2
            share: Array = (act.axes[:, part.axis] - middle) / half
            return np.clip(share, -1.0, 1.0)
        case Threshold(branch, 0.0):
            return np.where(act.choices[:, branch] == 1, 0.5, -0.5)
        case Threshold():
            return np.where(act.choices[:, part.branch] == 1, 0.0, (part.threshold + 1.0) / 2)
        case Split():
            return (act.choices[:, part.branch] + 0.5) / part.choices * 2 - 1


def read_discrete(table: AxisTable | JointTable, act: ActArrays) -> Array:
    """Return the choice of a branch that comes nearest, int64 [lanes]."""
    if isinstance(table, AxisTable):
        order = np.argsort(table.values, kind="stable")
        values = table.values[order]
        return order[np.searchsorted((values[1:] + values[:-1]) / 2, act.axes[:, table.axis])]
    wanted, combination = np.unique(act.choices[:, list(table.branches)], axis=0, return_inverse=True)
    choices = np.zeros(len(act.choices), np.int64)
    for index, row in enumerate(wanted):
        alike = (table.values == row).sum(axis=1)
        best = np.flatnonzero(alike == alike.max())
        lanes = np.flatnonzero(combination.reshape(-1) == index)
        choices[lanes] = best[0] if table.positions is None else best[_nearest(table, best, act.axes[lanes])]
    return choices


def _nearest(table: JointTable, among: Array, axes: Array) -> Array:
    """Return which of some rows of a table has the nearest positions, as shares of their span, [lanes]."""
    assert table.positions is not None
    span = np.ptp(table.positions, axis=0)
    span = np.where(span > 0, span, 1)
    places, wanted = table.positions[among] / span, axes[:, list(table.axes)] / span
    parts = [wanted[first : first + ROWS, None] - places for first in range(0, len(wanted), ROWS)]
    return np.concatenate([np.square(part).sum(axis=2).argmin(axis=1) for part in parts])
