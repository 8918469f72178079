"""What a policy did last and what it earned, as numbers in front of its frames (`remember_acts`).

A past act is what the policies gave the device, before a hand changed it: a one that says that there is an act, each
axis as -1 to 1 of its range, and a one for the choice of each branch. The reward that followed comes after it, as
sign(r) log(1 + |r|), so that large ones do not drown the rest. Acts are side by side, oldest first, zeros before the
first of an episode. A reward that reaches a lane before its first act followed none, so it is not written down.
"""

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class PastActs:
    """How the last acts of a lane are written down.

    keys: what each number is: of which act, 1 the last, and of which part. size: their count, 0 if none is remembered.
    """

    def __init__(self, device: pb.Device, count: int) -> None:
        """Remember so many acts of a device."""
        self._low, self._high = (np.array([getattr(axis, end) for axis in device.axes]) for end in ("low", "high"))
        self._choices = [np.eye(len(branch.choices), dtype=np.float32) for branch in device.branches]
        choices = [(branch.name, choice) for branch in device.branches for choice in branch.choices]
        parts = ["there", *(("axis", axis.name) for axis in device.axes), *choices, "reward"]
        self.keys = [(act, part) for act in range(count, 0, -1) for part in parts]
        self._width, self.size = len(parts), len(self.keys)

    def note(self, past: Array, act: ActArrays, deciding: Array | None) -> Array:
        """Return what lanes remember after an act whose reward is not known yet, [lanes, size].

        past: what they remembered. deciding: bool [lanes], others remember the same; None: all.
        """
        if not self.size:
            return past
        axes = 2 * (act.axes - self._low) / (self._high - self._low) - 1
        choices = [rows[act.choices[:, branch]] for branch, rows in enumerate(self._choices)]
        there, unknown = np.ones((len(past), 1)), np.zeros((len(past), 1))
        after = np.concatenate([past[:, self._width :], there, axes, *choices, unknown], axis=1, dtype=np.float32)
        return after if deciding is None else np.where(deciding[:, None], after, past)

    def settle(self, past: Array, rewards: Array, step: StepArrays) -> Array:
        """Write the rewards [lanes] that a step brought into `past`, and forget where it ended an episode.

        Return what lanes remembered at the end of these episodes, [ended, size].
        """
        if self.size:
            known = past[:, -self._width] > 0
            if step.deciding is not None:
                known &= step.deciding | step.ends
            past[known, -1] = np.sign(rewards[known]) * np.log1p(np.abs(rewards[known]))
        last = past[step.ended]
        past[step.ended] = 0.0
        return last
