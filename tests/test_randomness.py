"""Random streams: what a stream depends on, the order of its draws, and its snapshot."""

import math

import numpy as np
import pytest

from joybridge.simulator.randomness import (
    BLOCK,
    NORMAL_DRAWS,
    integer,
    normal,
    open_streams,
    reserve,
    restore_streams,
    save_streams,
    uniform,
)


def test_a_stream_depends_on_seed_and_arena_number_and_not_on_the_batch():
    one, many = open_streams(5, 40, 1), open_streams(5, 0, 64)
    blocks = set()
    for _ in range(3):
        assert one.values[0].tobytes() == many.values[40].tobytes()
        blocks.add(one.values.tobytes())
        for streams in (one, many):
            streams.cursor[:] = BLOCK
            reserve(streams, 1)
    assert len(blocks) == 3 and len({values.tobytes() for values in many.values}) == 64
    assert open_streams(6, 40, 1).values.tobytes() not in blocks


def test_a_stream_moves_on_alone_to_its_next_block_when_it_is_short():
    streams = open_streams(1, 0, 3)
    before = streams.values.copy()
    streams.cursor[:] = [0, BLOCK - 10, BLOCK - 9]
    reserve(streams, 10)
    assert streams.block.tolist() == [0, 0, 1] and streams.cursor.tolist() == [0, BLOCK - 10, 0]
    assert (streams.values[:2] == before[:2]).all() and (streams.values[2] != before[2]).any()


def test_draws_are_taken_in_order_and_scaled():
    streams = open_streams(1, 0, 2)
    first, second, third = streams.values[1, :3].tolist()
    assert uniform(streams, 1, -2.0, 5.0) == -2 + 7 * first
    assert integer(streams, 1, 3) == int(3 * second) and integer(streams, 1, 7) == int(7 * third)
    assert streams.cursor.tolist() == [0, 3]
    assert streams.values.min() >= 0.0 and streams.values.max() < 1.0
    assert streams.values.mean() == pytest.approx(0.5, abs=0.05)


def test_a_restored_stream_continues_where_it_was():
    streams, other = open_streams(7, 3, 2), open_streams(8, 0, 2)
    streams.cursor[:], streams.block[:] = [5, 100], [0, 3]
    restore_streams(streams, save_streams(streams))
    restore_streams(other, {name: values.copy() for name, values in save_streams(streams).items()})
    assert other.values.tobytes() == streams.values.tobytes() and other.cursor.tolist() == [5, 100]
    wanted = open_streams(7, 4, 1)
    for _ in range(3):
        wanted.cursor[:] = BLOCK
        reserve(wanted, 1)
    assert other.values[1].tobytes() == wanted.values[0].tobytes()


def test_normal_numbers_have_the_moments_of_a_normal_distribution():
    streams = open_streams(3, 0, 40)
    drawn = []
    for _ in range(2000):
        reserve(streams, NORMAL_DRAWS)
        drawn.append([normal(streams, arena) for arena in range(40)])
    numbers = np.array(drawn)
    moments = [(numbers**power).mean() for power in (1, 2, 3, 4)]
    np.testing.assert_allclose(moments, [0.0, 1.0, 0.0, 3.0], atol=0.1)


def test_a_normal_number_is_that_of_box_and_muller_to_1e_12():
    streams = open_streams(3, 0, 1)
    pairs = np.random.default_rng(0).random((BLOCK // 2, 2))
    streams.values[0] = pairs.ravel()
    expected = [math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v) for u, v in pairs]
    np.testing.assert_allclose([normal(streams, 0) for _ in pairs], expected, rtol=0.0, atol=1e-12)
