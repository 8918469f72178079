"""Random acts of a device."""

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.v1 import bridge_pb2 as pb


def press_at_random(device: pb.Device, act: ActArrays, rng: np.random.Generator) -> None:
    """Fill an act with random axes and choices, each value as likely as the others."""
    for column, axis in enumerate(device.axes):
        values = rng.uniform(axis.low, axis.high, len(act.axes)).astype(np.float32)
        act.axes[:, column] = np.clip(values, axis.low, axis.high)
    for column, branch in enumerate(device.branches):
        act.choices[:, column] = rng.integers(0, len(branch.choices), len(act.choices))


def obey_masks(act: ActArrays, step: StepArrays, rng: np.random.Generator) -> None:
    """Replace forbidden choices by random allowed ones."""
    for column, mask in enumerate(step.masks or ()):
        for lane in np.flatnonzero(~mask[np.arange(len(mask)), act.choices[:, column]]):
            act.choices[lane, column] = rng.choice(np.flatnonzero(mask[lane]))
