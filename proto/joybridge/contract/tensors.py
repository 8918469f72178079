"""Conversion between NumPy arrays and Tensor messages.

`Format.unpack` checks dtype, shape, number of bytes and finiteness. Code that uses its result checks nothing of this.
"""

import math
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from joybridge.contract.errors import JoybridgeError
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["NUMPY_TYPES", "Array", "Format", "TensorError", "dtype_of", "fill", "pack"]

Array = npt.NDArray[Any]

NUMPY_TYPES: dict[pb.Dtype, np.dtype[Any]] = {
    pb.DTYPE_FLOAT32: np.dtype("<f4"),
    pb.DTYPE_INT32: np.dtype("<i4"),
    pb.DTYPE_UINT8: np.dtype("u1"),
    pb.DTYPE_BOOL: np.dtype("?"),
}
_DTYPES = {numpy_type: dtype for dtype, numpy_type in NUMPY_TYPES.items()}


class TensorError(JoybridgeError, ValueError):
    """A tensor does not fit its field. The text names the field, what was received and what was expected."""


def dtype_of(array: Array) -> "pb.Dtype":
    """Return the wire dtype of an array. Raises TensorError for a dtype that the contract does not have."""
    try:
        return _DTYPES[array.dtype.newbyteorder("<") if sys.byteorder == "big" else array.dtype]
    except KeyError:
        known = ", ".join(str(t) for t in _DTYPES)
        raise TensorError(f"an array of {array.dtype} cannot be sent; convert it to one of {known}") from None


def fill(tensor: pb.Tensor, array: Array) -> None:
    """Put `array` into an empty tensor. Raises TensorError for a dtype that the contract does not have."""
    dtype = dtype_of(array)
    tensor.dtype = dtype
    tensor.shape.extend(array.shape)
    tensor.data = array.astype(NUMPY_TYPES[dtype], copy=False).tobytes()


def pack(array: Array) -> pb.Tensor:
    """Return `array` as a Tensor. Raises TensorError for a dtype that the contract does not have."""
    tensor = pb.Tensor()
    fill(tensor, array)
    return tensor


class Format:
    """The dtype and shape that the tensors of one field must have. It is made once per session."""

    def __init__(self, dtype: "pb.Dtype", shape: tuple[int, ...], field: str) -> None:
        """Require `dtype` and `shape`. Errors name `field`."""
        self.dtype, self.shape, self.field = dtype, shape, field
        self.sizes = list(shape)
        self.numpy_type = NUMPY_TYPES[dtype]
        self.bytes = math.prod(shape) * self.numpy_type.itemsize

    def unpack(self, tensor: pb.Tensor) -> Array:
        """Return the array in `tensor`, read-only, after checking it.

        Raises TensorError if dtype, shape or byte length differ, if a float is NaN or infinite, or if a
        boolean is neither 0 nor 1.
        """
        if tensor.dtype != self.dtype:
            came, wanted = _dtype_name(tensor.dtype), _dtype_name(self.dtype)
            raise TensorError(f"{self.field}: dtype is {came}, expected {wanted}")
        if tensor.shape != self.sizes:
            raise TensorError(f"{self.field}: shape is {_cut(list(tensor.shape))}, expected {self.sizes}")
        data = tensor.data
        if len(data) != self.bytes:
            raise TensorError(
                f"{self.field}: {len(data)} bytes of data, expected {self.bytes} for shape {self.sizes}"
            )  # fmt: skip
        if self.dtype == pb.DTYPE_BOOL and (others := data.translate(None, b"\0\1")):
            raise TensorError(f"{self.field}: a boolean is {max(others)}, expected 0 or 1")
        array: Array = np.ndarray(self.shape, self.numpy_type, data)
        # A finite sum of squares means that all values are finite. It is faster than testing each value.
        if self.dtype == pb.DTYPE_FLOAT32 and not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
            index = np.argwhere(~np.isfinite(array))[0].tolist()
            raise TensorError(f"{self.field}: value {array[tuple(index)]} at {index}, expected finite numbers")
        return array


def _dtype_name(dtype: "pb.Dtype") -> str:
    return pb.Dtype.Name(dtype) if dtype in pb.Dtype.values() else f"unknown ({dtype})"


def _cut(shape: list[int]) -> str:
    return str(shape) if len(shape) <= 8 else f"{len(shape)} sizes long"
