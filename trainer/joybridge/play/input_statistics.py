"""Measures of what agents do with their devices, which tell how much it is like what a person's hand does.

They are computed from the decisions alone, in any game: what a device got in each decision that counts. Where a lane
waits, nothing is measured and no time passes. Every episode begins with nothing pressed.

A click is a decision in which a branch newly has a choice other than the one that does nothing. Two axes that belong
together (see `device_names`) are a pointer. If they set its movement, the sum of the movements is its path, as if it
had no bounds; else its path is where the axes are. Movements are shares of full deflection, places of an axis's range.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joybridge.config.metrics import Row
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.layouts.device_names import AxisPair, pair_axes, rest_choice
from joybridge.v1 import bridge_pb2 as pb

WIDTH = 0.05  # of what is aimed at, for Fitts's law: a share of the range, or seconds at full deflection
MANY = 1000  # decisions that rates are about where the game has no clock
TANGENT = math.tan(math.pi / 8)  # a diagonal is within 22.5 degrees where the shorter side is at least this share
ISOTROPIC = 0.5  # share of all directions that are within 22.5 degrees of a diagonal
EXACT = 1e-9  # variances below this share of the mean square are rounding errors


@dataclass(frozen=True)
class Inputs:
    """Measures of one behavior. Those that nothing is known about are left out."""

    decisions: int  # that were measured, of all lanes
    decision_seconds: float  # 0: the game has no clock
    pointers: dict[str, str]  # what the axes of each pointer set: its movement, its position, or a stick
    measures: Row  # by name, followed by a dot and the name of a branch, a pointer or an axis


class InputMeasures:
    """Collects the measures of all lanes of one behavior."""

    def __init__(self, behavior: pb.Behavior, decision_seconds: float, lanes: int) -> None:
        """Begin at an episode's first decision in every lane. decision_seconds: game time, 0: there is no clock."""
        device = behavior.device
        self._seconds, self._decisions = decision_seconds, 0
        self._clicks = _Clicks(device.branches, lanes)
        width = WIDTH / decision_seconds if decision_seconds else 1.0
        self._motions = [_Motion(device.axes, pair, lanes, width) for pair in pair_axes(device.axes)]

    def add(self, before: StepArrays, act: ActArrays, after: StepArrays) -> None:
        """Count one decision of all lanes: what was observed, what the device got, and what followed."""
        counts = before.decides
        self._decisions += int(counts.sum())
        clicked, pauses = self._clicks.add(act.choices, counts)
        for motion in self._motions:
            motion.add(act.axes, counts, clicked, pauses)
        if len(after.ended):
            self._clicks.forget(after.ended)
            for motion in self._motions:
                motion.forget(after.ended)

    def result(self) -> Inputs:
        """Return the measures of everything so far."""
        measures: Row = {}
        if self._decisions:
            unit = "seconds" if self._seconds else "decisions"
            measures |= self._clicks.measures(self._decisions, self._seconds, unit)
            for motion in self._motions:
                found = motion.measures(unit, self._seconds or 1.0)
                measures |= {f"{name}.{motion.name}": value for name, value in found.items()}
            per, share = ("second", self._seconds) if self._seconds else (f"{MANY}_decisions", 1 / MANY)
            for motion in self._motions:
                rates = motion.reversals / (self._decisions * share)
                measures |= {
                    f"reversals_per_{per}.{name}": float(rate) for name, rate in zip(motion.names, rates, strict=True)
                }
        pointers = {motion.name: motion.sets for motion in self._motions if motion.is_pointer}
        return Inputs(self._decisions, self._seconds, pointers, measures)


class _Clicks:
    """How often each branch is clicked, how long after its last click, and how long it is held; column 0 is any."""

    def __init__(self, branches: Sequence[pb.Branch], lanes: int) -> None:
        self._names = ["", *(f".{branch.name}" for branch in branches)]
        self._rest = np.array([_rest(branch) for branch in branches], np.int32)
        self._last = np.tile(self._rest, (lanes, 1))  # choices
        self._since = np.zeros((lanes, len(self._names)), np.int32)  # decisions since a click; 0: none in this episode
        self._counts = np.zeros(len(self._names), np.int64)
        self._intervals = [np.zeros((2, 0), np.int32)]  # columns and decisions
        self._held = np.zeros(self._last.shape, np.int32)  # decisions that a choice has been held; 0: the one at rest
        self._holds = [np.zeros((2, 0), np.int32)]  # columns and decisions, of what has been let go

    def add(self, choices: Array, counts: Array) -> tuple[Array, Array]:
        """Return which lanes click, and how many decisions after the last click, 0 for the first one; [lanes] each."""
        clicks = np.zeros(self._since.shape, bool)
        clicks[:, 1:] = (choices != self._rest) & (choices != self._last) & counts[:, None]
        clicks[:, 0] = clicks[:, 1:].any(axis=1)
        self._hold(choices, counts)
        self._last[counts] = choices[counts]
        self._counts += clicks.sum(axis=0)
        pauses = self._since[:, 0].copy()
        lanes, columns = np.nonzero(clicks & (self._since > 0))
        if len(lanes):
            self._intervals.append(np.stack([columns.astype(np.int32), self._since[lanes, columns]]))
        self._since += (self._since > 0) & counts[:, None]
        self._since[clicks] = 1
        return clicks[:, 0], pauses

    def _hold(self, choices: Array, counts: Array) -> None:
        """Count for how long choices are held. What is still held at the end of an episode is left out."""
        changed = (choices != self._last) & counts[:, None]
        lanes, columns = np.nonzero(changed & (self._held > 0))
        if len(lanes):
            self._holds.append(np.stack([columns.astype(np.int32) + 1, self._held[lanes, columns]]))
        self._held += (self._held > 0) & counts[:, None]
        self._held[changed] = (choices != self._rest)[changed]

    def forget(self, lanes: Array) -> None:
        self._last[lanes] = self._rest
        self._since[lanes] = self._held[lanes] = 0

    def measures(self, decisions: int, seconds: float, unit: str) -> Row:
        if len(self._names) == 1:
            return {}
        per, many = ("minute", 60 / seconds) if seconds else (f"{MANY}_decisions", MANY)
        rates = self._counts / decisions * many
        found = {f"clicks_per_{per}{name}": float(rate) for name, rate in zip(self._names, rates, strict=True)}
        for what, parts in (("click_interval", self._intervals), ("hold", self._holds)):
            columns, times = np.concatenate(parts, axis=1)
            for index, name in enumerate(self._names):
                if len(own := times[columns == index]):
                    low, middle = np.percentile(own, [5, 50]) * (seconds or 1)
                    found |= {f"{what}_median_{unit}{name}": float(middle), f"{what}_p5_{unit}{name}": float(low)}
        return found


def _rest(branch: pb.Branch) -> int:
    """Return the choice that is no click: the one that does nothing, or -1, no choice at all."""
    if len(branch.choices) == 2:
        return 0
    choice = rest_choice(branch.choices)
    return -1 if choice is None else choice


class _Motion:
    """How one axis moves, or two that are a pointer."""

    def __init__(self, axes: Sequence[pb.Axis], pair: AxisPair, lanes: int, width: float) -> None:
        self._axes = [axis for axis in pair.axes if axis is not None]
        own = [axes[axis] for axis in self._axes]
        self.name = "+".join(axis.name for axis in own)
        self.names = [f"{self.name}.{side}" for side in "xy"] if pair.span else [axis.name for axis in own]
        self.sets, self.is_pointer, self._span = pair.sets, len(own) == 2, math.radians(pair.span)
        self._low, self._high = (np.array([getattr(axis, end) for axis in own]) for end in ("low", "high"))
        self._width = width if self.sets == "movement" else WIDTH
        shape = lanes, len(own)
        self._place, self._known = np.zeros(shape), np.zeros(lanes, bool)  # where the axes were, if they were anywhere
        self._way = np.zeros(shape, np.int8)  # in which each axis has moved last: -1 or 1; 0: it has not
        self._offset, self._length = np.zeros(shape), np.zeros(lanes)  # from the last click; along the path
        self.reversals = np.zeros(len(own), np.int64)
        self._total = self._diagonal = 0.0  # lengths of all paths
        self._straight = self._path = 0.0  # lengths between clicks
        self._fit = np.zeros((3, 3))  # sums of products of 1, bits and decisions

    def add(self, axes: Array, counts: Array, clicked: Array, pauses: Array) -> None:
        steps = self._steps(axes[:, self._axes].astype(float), counts)
        way = np.sign(steps).astype(np.int8)
        self.reversals += (way * self._way < 0).sum(axis=0)
        self._way = np.where(way == 0, self._way, way)
        if not self.is_pointer:
            return
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        sides = np.abs(steps)
        self._total += float(lengths.sum())
        self._diagonal += float(lengths[sides.min(axis=1) >= TANGENT * sides.max(axis=1)].sum())
        self._offset += steps
        self._length += lengths
        ends = clicked & (pauses > 0)
        if ends.any():
            straight, path = np.hypot(*self._offset[ends].T), self._length[ends]
            self._straight += float(straight.sum())
            self._path += float(path.sum())
            moved = straight > 0
            bits = np.log2(straight[moved] / self._width + 1)
            rows = np.stack([np.ones(len(bits)), bits, pauses[ends][moved]])
            self._fit += rows @ rows.T
        self._offset[clicked], self._length[clicked] = 0.0, 0.0

    def _steps(self, values: Array, counts: Array) -> Array:
        """Return how far each lane moves, [lanes, axes]; 0 in lanes that wait."""
        if self.sets == "movement":
            steps = values / np.maximum(np.abs(self._low), np.abs(self._high))
            if self._span:
                angle = self._span * (2 * values[:, 0] - self._low[0] - self._high[0]) / (self._high - self._low)[0]
                steps = steps[:, 1:] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            moved: Array = steps * counts[:, None]
            return moved
        place = values / (self._high - self._low)
        moved = (place - self._place) * (counts & self._known)[:, None]
        self._place[counts] = place[counts]
        self._known |= counts
        return moved

    def forget(self, lanes: Array) -> None:
        self._known[lanes] = False
        self._way[lanes] = 0
        self._offset[lanes], self._length[lanes] = 0.0, 0.0

    def measures(self, unit: str, seconds: float) -> Row:
        """Return what is known of a pointer; seconds: of a decision, or 1 where the unit is decisions."""
        found: Row = {}
        if self._path:
            found["path_efficiency"] = self._straight / self._path
        spread = self._fit - np.outer(self._fit[0], self._fit[0]) / max(self._fit[0, 0], 1)
        if spread[1, 1] > EXACT * self._fit[1, 1]:
            found[f"fitts_{unit}_per_bit"] = float(spread[1, 2] / spread[1, 1]) * seconds
            if spread[2, 2] > EXACT * self._fit[2, 2]:
                found["fitts_r2"] = float(spread[1, 2] ** 2 / (spread[1, 1] * spread[2, 2]))
        if self._total:
            found["diagonal_bias"] = self._diagonal / self._total - ISOTROPIC
        return found
