"""Reading many agents as arrays gives what reading them one by one does, whatever their fields are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joybridge.adapters.unity.actions import ActionRecords
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.adapters.unity.reader import MAX_LENGTHS, AgentReader
from joybridge.adapters.unity.slots import Slots
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.simulator.batched_game import GameError
from tests.support.unity_player import agent, hybrid, vector

pytestmark = pytest.mark.nightly

FIRST = agent(0, vector(0, 0, name="place"), vector(*range(4), shape=[1, 2, 2], name="map"))


def reader():
    return AgentReader(BehaviorForm(ml.BehaviorParameters(name="walker", action_spec=hybrid(1, 3, 2)), FIRST, 1, []))


numbers = st.floats(width=32, allow_nan=False, allow_infinity=False)
masks = st.sampled_from([b"", b"\1\0\0\1\0", b"\0\0\0\0\0", b"\0\1\1\1\0", b"\1"])


@st.composite
def agents(draw):
    count = draw(st.integers(0, 6))
    alike = draw(st.booleans())  # with the same fields
    shared = {key: draw(st.booleans()) for key in ("reward", "group_reward", "done", "group_id")}
    found = []
    for _ in range(count):
        has = shared if alike else {key: draw(st.booleans()) for key in shared}
        fields = {key: draw(numbers) for key in ("reward", "group_reward") if has[key]}
        fields |= {"done": draw(st.booleans())} if has["done"] else {}
        fields |= {"group_id": draw(st.integers(-1, 300))} if has["group_id"] else {}
        place = vector(draw(numbers), draw(numbers), name="place")
        view = vector(*(draw(numbers) for _ in range(4)), shape=[1, 2, 2], name=draw(st.sampled_from(["map", "m"])))
        found.append(
            agent(
                draw(st.integers(-(2**31), 2**31 - 1) | st.integers(0, 300)),
                place,
                view,
                action_mask=draw(masks),
                interrupted=draw(st.booleans()),
                **fields,
            )
        )
    return found


@given(st.lists(agents(), min_size=1, max_size=4))
def test_agents_are_read_as_protobuf_reads_them(messages):
    one = reader()  # learns from message to message
    for sent in messages:
        read = one.read(ml.AgentList(agents=sent).SerializeToString())
        assert read.ids.tolist() == [each.id for each in sent]
        assert read.done.tolist() == [each.done for each in sent]
        assert read.interrupted.tolist() == [each.interrupted for each in sent]
        assert read.rewards.tolist() == [[each.reward, each.group_reward] for each in sent]
        assert read.allowed.tolist() == [
            [not flag for flag in each.action_mask] if len(each.action_mask) == 5 else [True] * 5 for each in sent
        ]
        place = b"".join(each.observations[0].floats.data for each in sent)
        assert read.observations[0].tobytes() == place
        view = b"".join(each.observations[1].floats.data for each in sent)
        assert read.observations[1].shape == (len(sent), 2, 2, 1) and read.observations[1].tobytes() == view


@given(agents(), st.data())
def test_damaged_agents_are_refused_or_read(sent, data):
    one = reader()
    damaged = bytearray(ml.AgentList(agents=sent).SerializeToString())
    one.read(bytes(damaged))
    for _ in range(data.draw(st.integers(1, 4)) if damaged else 0):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    del damaged[data.draw(st.integers(0, len(damaged))) :]
    try:
        read = one.read(bytes(damaged))
    except GameError:
        return
    assert len(read.ids) == len(ml.AgentList.FromString(bytes(damaged)).agents)


def test_a_number_that_ends_before_those_of_other_agents_do_is_not_read_with_them():
    one = reader()
    long = ml.AgentList(agents=[agent(300, *FIRST.observations)]).SerializeToString()
    assert one.read(long).ids.tolist() == [300]
    with pytest.raises(GameError, match=r"expected 2, as at first|no message of ML-Agents"):
        one.read(long.replace(b"\x50\xac\x02", b"\x50\x05\x78"))


def test_a_size_without_an_end_is_refused_at_once():
    for data in (b"\x0a" + b"\x80" * 3_000_000, b"\x0a\x00\x0a" + b"\xff" * 3_000_000):
        with pytest.raises(GameError, match="the list of agents is damaged"):
            reader().read(data)


def test_a_player_that_varies_its_messages_without_end_takes_no_memory():
    one = reader()
    for length in range(MAX_LENGTHS + 20):
        place = vector(1, 2, name="p" * length)
        one.read(ml.AgentList(agents=[agent(1, place, FIRST.observations[1])]).SerializeToString())
    assert len(one._layouts) <= MAX_LENGTHS


@given(st.integers(0, 6), st.lists(st.integers(1, 70_000), max_size=4), st.integers(0, 5), st.data())
def test_actions_are_read_by_protobuf_as_they_were_written(continuous, sizes, count, data):
    axes = np.array([[data.draw(numbers) for _ in range(continuous)] for _ in range(count)], np.float32)
    choices = [[data.draw(st.integers(0, size - 1)) for size in sizes] for _ in range(count)]
    records = ActionRecords(hybrid(continuous, *sizes))
    packed = records.pack(axes.reshape(count, continuous), np.array(choices, np.int32).reshape(count, len(sizes)))
    written = ml.ActionList.FromString(packed).actions
    assert [list(each.discrete) for each in written] == choices
    assert b"".join(each.continuous for each in written) == axes.tobytes()


@pytest.mark.parametrize(
    ("ended", "asking", "places"),
    [
        ([0, 1, 2], [3, 5], [0, 2]),  # the second one waits; its number is left out
        ([2, 0], [3, 4], [2, 0]),
        ([1], [9], [1]),  # not the number that is expected
        ([], [7], [-1]),
        ([0, 2], [8, 9, 10], [0, 2, -1]),
    ],
)
def test_agents_take_the_places_of_those_before_them(ended, asking, places):
    slots = Slots(3)
    slots.clear()
    slots.begin([2, 0, 1])
    assert slots.find([0, 1, 2]) == [0, 1, 2]
    slots.end(ended)
    slots.begin(asking)
    assert slots.find(asking) == places
