"""The bounds of the contract, and the largest messages of a session, which both ends use as limits."""

from math import prod

from joybridge.contract.codec import lane_count
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.v1 import bridge_pb2 as pb

__all__ = [
    "MAX_CHOICES",
    "MAX_DESCRIPTION",
    "MAX_ELEMENTS",
    "MAX_ENTRIES",
    "MAX_FLOAT32",
    "MAX_KEY",
    "MAX_LANES",
    "MAX_MESSAGE",
    "MAX_NAME",
    "MAX_PER_ELEMENT",
    "MAX_PICTURES",
    "MAX_PICTURE_BYTES",
    "MAX_PIXELS",
    "MAX_SIZES",
    "MAX_SPEC_BYTES",
    "MAX_VALUES",
    "element_count",
    "max_pictures",
    "request_bytes",
    "response_bytes",
]

MAX_NAME = 100  # characters of a name, a label or a product
MAX_DESCRIPTION = 1000  # characters
MAX_ENTRIES = 1000  # of a list of named things
MAX_KEY = 32  # characters of a key
MAX_CHOICES = 65536  # of a branch
MAX_SIZES = 8  # of the shape of a sensor
MAX_ELEMENTS = 2**24  # of all sensors of a behavior together
MAX_PER_ELEMENT = 65536  # entries of the lists of a sensor that have one per element
MAX_SPEC_BYTES = 4_000_000  # of a GameSpec; gRPC's clients receive 4 MiB by default
MAX_FLOAT32 = (2 - 2**-23) * 2.0**127
MAX_LANES = 2**31 - 1  # of a session: lane numbers are INT32
MAX_PIXELS = 2048  # width or height of a picture
MAX_PICTURES = 64  # pictures one Act may ask for
MAX_PICTURE_BYTES = 2**24  # of these pictures together; a single one of any size is allowed
MAX_VALUES = 100  # of the choice that a parameter is drawn from
DISTRIBUTION_BYTES = 2048  # of one Distribution with its name, generously
MAX_MESSAGE = 2**31 - 1  # bytes; protobuf's own limit, and gRPC's


def element_count(sensor: pb.Sensor) -> int:
    """Return how many numbers one observation of a sensor holds."""
    return int(prod(sensor.shape[:MAX_SIZES]))  # who breaks this bound may not make it long


def max_pictures(spec: pb.GameSpec) -> int:
    """Return how many pictures one Act may ask for, which depends on their size; 0 if the game cannot be drawn."""
    size = 3 * spec.picture.width * spec.picture.height
    return min(MAX_PICTURES, MAX_PICTURE_BYTES // size) if size else 0


def response_bytes(spec: pb.GameSpec, arenas: int, pictures: int = 0) -> int:
    """Return an upper bound of the size of a PlayResponse, for message limits on both ends."""
    total = (1 << 16) + spec.ByteSize()  # names, shapes and tags, generously
    for behavior in spec.behaviors:
        row = 16 + 4 * (len(behavior.channels) + len(behavior.metrics) + len(spec.parameters))
        row += sum(2 * element_count(s) * NUMPY_TYPES[s.dtype].itemsize for s in behavior.sensors)
        row += sum(len(branch.choices) for branch in behavior.device.branches)
        total += row * lane_count(behavior, arenas)
    total += min(pictures, max_pictures(spec)) * (64 + 3 * spec.picture.width * spec.picture.height)
    return min(max(total, (1 << 16) + arenas * spec.snapshot_bytes_per_arena), MAX_MESSAGE)


def request_bytes(spec: pb.GameSpec, arenas: int) -> int:
    """Return an upper bound of the size of a PlayRequest: an Act, or a Start with a snapshot."""
    rows = sum(
        lane_count(b, arenas) * 4 * (len(b.device.axes) + len(b.device.branches) + bool(b.scripts))
        for b in spec.behaviors
    )
    distributions = DISTRIBUTION_BYTES * len(spec.parameters) if spec.parameters_per_episode else 0
    return min((1 << 16) + distributions + max(rows, arenas * spec.snapshot_bytes_per_arena), MAX_MESSAGE)
