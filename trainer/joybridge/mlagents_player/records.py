"""The agents of one behavior as the bytes of an AgentList (communicator.proto), without a loop over agents.

The agents of a behavior have sensors of the same shapes, so their messages have the same length and differ only in some
columns: a NumPy record per agent, whose constant bytes are written once.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.mlagents.records import FLOAT, Part, layout, length, packed, varint
from joybridge.v1 import bridge_pb2 as pb

ID_BYTES = 5  # an id as a varint, padded to this length
_SHIFTS = 7 * np.arange(ID_BYTES)
_MORE = np.array([0x80] * (ID_BYTES - 1) + [0])  # the bit of a varint's bytes that says that another one follows
_IMAGE = (1, 2, 2)  # properties of the dimensions of an image: none, and equivariant to translations


class AgentRecords:
    """Writes agents of one behavior."""

    def __init__(self, behavior: pb.Behavior, *, masked: bool = False) -> None:
        """Lay out the record of an agent, with a mask or without one, where all choices are allowed."""
        self._images = [is_image(sensor) for sensor in behavior.sensors]
        choices = sum(len(branch.choices) for branch in behavior.device.branches)
        parts: list[Part] = [b"\x3d", ("reward", FLOAT), b"\x40", ("done", "u1"), b"\x48", ("interrupted", "u1")]
        parts += [b"\x50", ("id", ("u1", (ID_BYTES,)))]
        if masked:
            parts += [b"\x5a" + varint(choices), ("mask", ("u1", (choices,)))]
        for index, sensor in enumerate(behavior.sensors):
            observation = list(_observation(f"sensor {index}", sensor))
            parts += [b"\x6a" + varint(length(observation)), *observation]
        parts = [b"\x0a" + varint(length(parts)), *parts]
        self.dtype, self._template = layout(parts)

    def pack(
        self,
        observations: Sequence[Array],
        rewards: Array,
        ids: Array,
        masks: Sequence[Array] | None = None,
        interrupted: Array | None = None,
    ) -> bytes:
        """Return an AgentList.

        observations: per sensor [agents, *shape]; rewards, ids [agents]; masks: per branch [agents, choices], True:
        allowed. interrupted [agents]: given for agents whose episodes have ended.
        """
        records = np.frombuffer(bytearray(self._template * len(ids)), self.dtype)
        records["reward"] = rewards
        records["id"] = (ids[:, None] >> _SHIFTS) & 0x7F | _MORE
        if interrupted is not None:
            records["done"], records["interrupted"] = 1, interrupted
        if masks is not None:
            records["mask"] = ~np.concatenate(masks, axis=1)
        for index, (values, image) in enumerate(zip(observations, self._images, strict=True)):
            if image:
                values = values.transpose(0, 3, 1, 2) / np.float32(255)
            records[f"sensor {index}"] = values.reshape(len(ids), -1)
        return records.tobytes()


def scale_axes(axes: Array, low: Array, high: Array) -> Array:
    """Return axes of ML-Agents, which lie in -1..1, within the bounds of a device; float32 [rows, axes]."""
    first, last = low.astype(np.float64), high.astype(np.float64)
    unit = (low == -1.0) & (high == 1.0)
    scaled = np.where(unit, axes, first + (axes + np.float64(1.0)) * (last - first) / 2)
    return np.clip(scaled.astype(np.float32), low, high)


def is_image(sensor: pb.Sensor) -> bool:
    """Return whether a sensor is sent as an image, channels first, 0 to 1; all others are sent as vectors."""
    return sensor.dtype == pb.DTYPE_UINT8 and len(sensor.shape) == 3


def _observation(column: str, sensor: pb.Sensor) -> Iterator[Part]:
    """Yield the parts of an Observation: its shape, its values, its name and the properties of its dimensions."""
    count = element_count(sensor)
    height, width, channels = sensor.shape if is_image(sensor) else (0, 0, 0)
    shape = (channels, height, width) if channels else (count,)
    yield packed(0x0A, shape)
    yield b"\x22" + varint(1 + len(varint(4 * count)) + 4 * count) + b"\x0a" + varint(4 * count)
    yield column, (FLOAT, (count,))
    name = sensor.name.encode()
    yield b"\x42" + varint(len(name)) + name + packed(0x32, _IMAGE if channels else (1,))
