"""The types of tensors: arrays in Python, dtypes on the wire."""

from typing import Any

import numpy as np
import numpy.typing as npt

from joybridge.contract.errors import MessageError
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["NUMPY_TYPES", "Array", "TensorError"]

Array = npt.NDArray[Any]

NUMPY_TYPES: dict[pb.Dtype, np.dtype[Any]] = {
    pb.DTYPE_FLOAT32: np.dtype("<f4"),
    pb.DTYPE_INT32: np.dtype("<i4"),
    pb.DTYPE_UINT8: np.dtype("u1"),
    pb.DTYPE_BOOL: np.dtype("?"),
}


class TensorError(MessageError):
    """A tensor does not fit its field. The text names the field, what was received and what was expected."""
