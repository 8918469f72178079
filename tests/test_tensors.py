"""Arrays into Tensors and back, and every Tensor that is refused."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from joybridge.contract.codec import Format, dtype_of, pack
from joybridge.contract.tensors import NUMPY_TYPES, TensorError
from joybridge.v1 import bridge_pb2 as pb

SHAPES = arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5)
ELEMENTS = {
    pb.DTYPE_FLOAT32: st.floats(width=32, allow_nan=False, allow_infinity=False),
    pb.DTYPE_INT32: st.integers(-(2**31), 2**31 - 1),
    pb.DTYPE_UINT8: st.integers(0, 255),
    pb.DTYPE_BOOL: st.booleans(),
}
DTYPES = list(NUMPY_TYPES)
quick = settings(derandomize=True, deadline=None, max_examples=60)


def a_tensor(dtype=pb.DTYPE_FLOAT32, shape=(2, 3), data=None):
    size = math.prod(shape) * NUMPY_TYPES[dtype].itemsize
    return pb.Tensor(dtype=dtype, shape=shape, data=bytes(size) if data is None else data)


def refusal(tensor, dtype=pb.DTYPE_FLOAT32, shape=(2, 3)):
    """Return the text with which a tensor is refused; it must name the field."""
    with pytest.raises(TensorError, match=r"^player\.axes: ") as caught:
        Format(dtype, shape, "player.axes").unpack(tensor)
    return str(caught.value)


# ------------------------------------------------------------------------------------------------ round trips


@pytest.mark.parametrize("dtype", DTYPES, ids=pb.Dtype.Name)
def test_an_array_comes_back_as_it_was(dtype):
    @quick
    @given(arrays.arrays(NUMPY_TYPES[dtype], SHAPES, elements=ELEMENTS[dtype]))
    def check(array):
        tensor = pb.Tensor.FromString(pack(array).SerializeToString())
        back = Format(dtype, array.shape, "field").unpack(tensor)
        assert back.dtype == array.dtype and back.shape == array.shape
        assert back.tobytes() == array.tobytes()  # to the bit: -0.0 stays -0.0

    check()


def test_every_dtype_of_the_contract_has_an_array_type():
    assert set(NUMPY_TYPES) == set(pb.Dtype.values()) - {pb.DTYPE_UNSPECIFIED}
    assert [dtype_of(np.empty(0, NUMPY_TYPES[dtype])) for dtype in DTYPES] == DTYPES


def test_elements_travel_little_endian_and_row_by_row():
    assert pack(np.array([[1, 2], [3, 256]], np.int32)).data == bytes([1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 0, 1, 0, 0])
    assert pack(np.array([1.0], np.float32)).data == b"\x00\x00\x80\x3f"
    assert pack(np.array([True, False])).data == b"\x01\x00"


def test_a_view_travels_as_what_it_shows():
    whole = np.arange(24, dtype=np.int32).reshape(4, 6)
    for view in (whole.T, whole[::2, 1::2], whole[:, ::-1], np.asfortranarray(whole)):
        assert (Format(pb.DTYPE_INT32, view.shape, "field").unpack(pack(view)) == view).all()


def test_an_unpacked_array_cannot_be_written():
    array = Format(pb.DTYPE_FLOAT32, (2, 3), "field").unpack(a_tensor())
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0


@pytest.mark.parametrize("dtype", ["f8", "i8", "u2", "f2", "c8", "S3", "O", ">f4", ">i4"])
def test_an_array_of_a_type_that_the_contract_lacks_cannot_be_packed(dtype):
    with pytest.raises(TensorError, match=r"cannot be sent; convert it to one of float32, int32, uint8, bool"):
        pack(np.zeros(2, dtype))


# ------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("expected", DTYPES, ids=pb.Dtype.Name)
@pytest.mark.parametrize("came", DTYPES, ids=pb.Dtype.Name)
def test_only_the_expected_dtype_is_accepted(expected, came):
    tensor = a_tensor(came)
    if came == expected:
        assert Format(expected, (2, 3), "field").unpack(tensor).shape == (2, 3)
    else:
        text = refusal(tensor, expected)
        assert f"dtype is {pb.Dtype.Name(came)}, expected {pb.Dtype.Name(expected)}" in text


@pytest.mark.parametrize(("dtype", "name"), [(0, "DTYPE_UNSPECIFIED"), (5, "unknown (5)"), (-1, "unknown (-1)")])
def test_a_dtype_that_is_none_is_refused_by_its_name_or_number(dtype, name):
    assert f"dtype is {name}, expected DTYPE_FLOAT32" in refusal(pb.Tensor(dtype=dtype, shape=[2, 3], data=bytes(24)))


@pytest.mark.parametrize(
    "shape", [(), (6,), (3, 2), (2, 3, 1), (1, 2, 3), (2, 4), (3, 3), (0, 3), (2, 2**32 - 1), (2**32 - 1, 2**32 - 1)]
)
def test_another_shape_is_refused_whatever_the_data(shape):
    text = refusal(pb.Tensor(dtype=pb.DTYPE_FLOAT32, shape=shape, data=bytes(24)))
    assert f"shape is {list(shape)}, expected [2, 3]" in text


def test_a_shape_of_very_many_sizes_is_refused_in_few_words():
    text = refusal(pb.Tensor(dtype=pb.DTYPE_FLOAT32, shape=[1] * 100_000, data=bytes(24)))
    assert "shape is 100000 sizes long" in text and len(text) < 100


@pytest.mark.parametrize("dtype", DTYPES, ids=pb.Dtype.Name)
@pytest.mark.parametrize("cut", [lambda n: 0, lambda n: n - 1, lambda n: n + 1, lambda n: 2 * n])
def test_data_of_another_length_is_refused(dtype, cut):
    right = 6 * NUMPY_TYPES[dtype].itemsize
    length = cut(right)
    text = refusal(a_tensor(dtype, data=bytes(length)), dtype)
    assert f"{length} bytes of data, expected {right} for shape [2, 3]" in text


@pytest.mark.parametrize("value", [np.nan, -np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(6))
def test_a_number_that_is_not_finite_is_refused_with_its_place(value, place):
    array = np.zeros((2, 3), np.float32)
    array.flat[place] = value
    text = refusal(pack(array))
    assert f"value {array.flat[place]} at {[place // 3, place % 3]}, expected finite numbers" in text


def test_signalling_and_odd_bit_patterns_of_nan_are_refused():
    for bits in (0x7F800001, 0x7FFFFFFF, 0xFF800001, 0xFFFFFFFF):
        refusal(a_tensor(data=np.array([0, 0, 0, 0, 0, bits], "<u4").tobytes()))


def test_subnormal_and_extreme_numbers_are_numbers():
    extremes = np.array([1e-45, -1e-45, 3.4028235e38, -3.4028235e38, -0.0], np.float32)
    assert Format(pb.DTYPE_FLOAT32, (5,), "field").unpack(pack(extremes)).tobytes() == extremes.tobytes()


@pytest.mark.parametrize("value", [2, 128, 255])
@pytest.mark.parametrize("place", range(6))
def test_a_boolean_that_is_neither_0_nor_1_is_refused(value, place):
    data = bytearray([0, 1, 0, 1, 0, 1])
    data[place] = value
    text = refusal(a_tensor(pb.DTYPE_BOOL, data=bytes(data)), pb.DTYPE_BOOL)
    assert f"a boolean is {value}, expected 0 or 1" in text


@quick
@given(data=st.data(), expected=st.sampled_from(DTYPES), wanted=arrays.array_shapes(max_dims=3, max_side=3))
def test_a_tensor_is_accepted_exactly_if_all_of_it_is_right(data, expected, wanted):
    size = math.prod(wanted) * NUMPY_TYPES[expected].itemsize
    dtype = data.draw(st.just(expected) | st.integers(-3, 9))
    shape = data.draw(st.just(wanted) | st.lists(st.integers(0, 4) | st.integers(0, 2**32 - 1), max_size=4).map(tuple))
    content = data.draw(st.just(bytes(size)) | st.binary(min_size=size, max_size=size) | st.binary(max_size=40))
    tensor = pb.Tensor(dtype=dtype, shape=shape, data=content)
    right = dtype == expected and shape == wanted and len(content) == size
    if right and expected == pb.DTYPE_FLOAT32:
        right = all(math.isfinite(value) for (value,) in struct.iter_unpack("<f", content))
    if right and expected == pb.DTYPE_BOOL:
        right = max(content) <= 1
    if right:
        assert Format(expected, wanted, "field").unpack(tensor).tobytes() == content
    else:
        with pytest.raises(TensorError, match=r"^field: "):
            Format(expected, wanted, "field").unpack(tensor)


@pytest.mark.parametrize("shape", [(0,), (0, 3), (3, 0)])
@pytest.mark.parametrize("dtype", DTYPES, ids=pb.Dtype.Name)
def test_an_array_without_elements_is_an_array(dtype, shape):
    assert Format(dtype, shape, "field").unpack(a_tensor(dtype, shape)).shape == shape
    refusal(a_tensor(dtype, shape, data=b"\x00"), dtype, shape)
