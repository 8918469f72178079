"""ndarray <-> Tensor: the one door through which arrays enter and leave messages.

`unpack` checks dtype, shape, byte length and finiteness and names the field, so nothing below it needs to.
"""

import math
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from joybridge.v1 import bridge_pb2 as pb

Array = npt.NDArray[Any]

NUMPY_TYPES: dict[pb.DType, np.dtype[Any]] = {
    pb.FLOAT32: np.dtype("<f4"),
    pb.INT32: np.dtype("<i4"),
    pb.UINT8: np.dtype("u1"),
    pb.BOOL: np.dtype("?"),
}
_DTYPES = {numpy_type: dtype for dtype, numpy_type in NUMPY_TYPES.items()}


class TensorError(ValueError):
    """A tensor that is not what its field demands; the text names the field, what came and what was wanted."""


def dtype_of(array: Array) -> "pb.DType":
    """Return the wire dtype of an array. Raises TensorError for a type that the contract does not carry."""
    try:
        return _DTYPES[array.dtype.newbyteorder("<") if sys.byteorder == "big" else array.dtype]
    except KeyError:
        known = ", ".join(str(t) for t in _DTYPES)
        raise TensorError(f"an array of {array.dtype} cannot be sent; convert it to one of {known}") from None


def pack(array: Array) -> pb.Tensor:
    """Return `array` as a Tensor. Raises TensorError for a type that the contract does not carry."""
    dtype = dtype_of(array)
    return pb.Tensor(dtype=dtype, shape=array.shape, data=array.astype(NUMPY_TYPES[dtype], copy=False).tobytes())


def unpack(tensor: pb.Tensor, dtype: pb.DType, shape: tuple[int, ...], field: str) -> Array:
    """Return the array in `tensor`, read-only, after checking that it is what `field` demands.

    Raises TensorError if dtype, shape or byte length differ, if a float is NaN or infinite, or if a
    boolean is neither 0 nor 1.
    """
    if tensor.dtype != dtype:
        raise TensorError(f"{field}: dtype is {_dtype_name(tensor.dtype)}, expected {_dtype_name(dtype)}")
    if tuple(tensor.shape) != shape:
        raise TensorError(f"{field}: shape is {_cut(list(tensor.shape))}, expected {list(shape)}")
    numpy_type = NUMPY_TYPES[dtype]
    wanted = math.prod(shape) * numpy_type.itemsize
    if len(tensor.data) != wanted:
        raise TensorError(f"{field}: {len(tensor.data)} bytes of data, expected {wanted} for shape {list(shape)}")
    if dtype == pb.BOOL:
        raw = np.frombuffer(tensor.data, np.uint8)
        if raw.size and raw.max() > 1:
            raise TensorError(f"{field}: a boolean is {raw.max()}, expected 0 or 1")
    array = np.frombuffer(tensor.data, numpy_type).reshape(shape)
    if dtype == pb.FLOAT32 and not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise TensorError(f"{field}: value {array[tuple(index)]} at {index}, expected finite numbers")
    return array


def _dtype_name(dtype: pb.DType) -> str:
    return pb.DType.Name(dtype) if dtype in pb.DType.values() else f"unknown ({dtype})"


def _cut(shape: list[int]) -> str:
    return str(shape) if len(shape) <= 8 else f"{len(shape)} sizes long"
