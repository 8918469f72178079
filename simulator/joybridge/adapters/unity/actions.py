"""The actions of one behavior as the bytes of an ActionList (communicator.proto), without a loop over agents."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.records import FLOAT, Part, layout, length, varint


class ActionRecords:
    """Writes actions."""

    def __init__(self, actions: ml.ActionSpec) -> None:
        """Lay out the record of an action."""
        self.continuous, self.branches = actions.continuous_actions, len(actions.branch_sizes)
        self._widths = [len(varint(max(0, size - 1))) for size in actions.branch_sizes]
        parts: list[Part] = []
        if self.continuous:
            parts += [b"\x32" + varint(4 * self.continuous), ("continuous", (FLOAT, (self.continuous,)))]
        if self.branches:
            parts += [b"\x3a" + varint(sum(self._widths))]
            parts += [(f"branch {index}", ("u1", (width,))) for index, width in enumerate(self._widths)]
        self._dtype, self._template = layout([b"\x0a" + varint(length(parts)), *parts])

    def pack(self, axes: Array, choices: Array) -> bytes:
        """Return an ActionList. axes: float32 [agents, continuous]; choices: int32 [agents, branches]."""
        records = np.frombuffer(bytearray(self._template * len(axes)), self._dtype)
        if self.continuous:
            records["continuous"] = axes
        for index, width in enumerate(self._widths):
            more = np.array([0x80] * (width - 1) + [0])  # the bit that says that another byte follows
            records[f"branch {index}"] = (choices[:, index, None] >> 7 * np.arange(width)) & 0x7F | more
        return records.tobytes()

    def rest(self, agents: int) -> bytes:
        """Return an ActionList of zeros, which is what trainers of ML-Agents send for agents without an action."""
        return self.pack(np.zeros((agents, self.continuous), FLOAT), np.zeros((agents, self.branches), np.int32))
