"""Requests that are no messages, very large ones and random ones, over real streams: none does more than end its own.

What is wrong in a message that can be read is the conformance kit's business, in test_check.py.
"""

from collections.abc import Iterator
from typing import Any

import grpc
import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from grpc import StatusCode
from grpc_health.v1 import health_pb2, health_pb2_grpc
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from joybridge.contract.codec import ActArrays, lane_count, pack_act
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_games
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import PLACES
from tests.support.wire import ANY_LENGTH, PLAY, SAVE, SECONDS, Player, act, encode, reset, start

pytestmark = pytest.mark.no_cover  # what is tested is the server, another process, which is not measured

EXPECTED = {
    StatusCode.INVALID_ARGUMENT,
    StatusCode.FAILED_PRECONDITION,
    StatusCode.NOT_FOUND,
    StatusCode.RESOURCE_EXHAUSTED,
}
ARENAS = 3
GAMES = ["hybrid", "duel", "shooting_birds"]
CATALOG = load_games(PLACES)
SPECS = {name: CATALOG[name].describe(choose_options(CATALOG[name].options, {}, name)) for name in GAMES}


def valid_act(game: str) -> pb.PlayRequest:
    """Return actions that a session may begin with."""
    behaviors = []
    for kind in SPECS[game].behaviors:
        middle = np.array([(axis.low + axis.high) / 2 for axis in kind.device.axes], np.float32)
        lanes = lane_count(kind, ARENAS)
        arrays = ActArrays(np.tile(middle, (lanes, 1)), np.zeros((lanes, len(kind.device.branches)), np.int32))
        behaviors.append(pack_act(arrays))
    return act(*behaviors)


# -------------------------------------------------------------------------------------------------- the wire

VARINT, FIXED64, LENGTH, GROUP, FIXED32 = 0, 1, 2, 3, 5
WIRE_TYPES = {
    FieldDescriptor.TYPE_MESSAGE: {LENGTH},
    FieldDescriptor.TYPE_STRING: {LENGTH},
    FieldDescriptor.TYPE_BYTES: {LENGTH},
    FieldDescriptor.TYPE_UINT32: {VARINT},
    FieldDescriptor.TYPE_UINT64: {VARINT},
    FieldDescriptor.TYPE_ENUM: {VARINT},
    FieldDescriptor.TYPE_BOOL: {VARINT},
}
CONTENT = {VARINT: b"\x01", FIXED64: bytes(8), LENGTH: b"\x01\x01", GROUP: b"", FIXED32: bytes(4)}
REQUEST_PATHS: dict[
    str, tuple[Any, list[int]]
] = {  # every message that a request can hold, and the fields that lead to it
    "PlayRequest": (pb.PlayRequest, []),
    "PlayRequest.start": (pb.Start, [1]),
    "PlayRequest.start.snapshot": (pb.Snapshot, [1, 7]),
    "PlayRequest.start.version": (pb.Version, [1, 8]),
    "PlayRequest.act": (pb.Act, [2]),
    "PlayRequest.act.behaviors": (pb.BehaviorAct, [2, 1]),
    "PlayRequest.act.behaviors.axes": (pb.Tensor, [2, 1, 1]),
    "PlayRequest.act.behaviors.choices": (pb.Tensor, [2, 1, 2]),
    "PlayRequest.reset": (pb.Reset, [3]),
    "PlayRequest.save": (pb.Save, [4]),
}


def varint(number: int) -> bytes:
    data = b""
    while number > 127:
        data, number = data + bytes([number & 127 | 128]), number >> 7
    return data + bytes([number])


def tag(number: int, wire_type: int) -> bytes:
    return varint(number << 3 | wire_type)


def wrap(data: bytes, path: list[int]) -> bytes:
    """Return `data` as the content of the message at a path of fields."""
    for number in reversed(path):
        data = tag(number, LENGTH) + varint(len(data)) + data
    return data


def unknown_fields(message: Any) -> Iterator[bytes]:
    """Yield fields that a message does not have: known numbers with a wrong wire type, and unknown numbers."""
    for field in message.DESCRIPTOR.fields:
        repeated = isinstance(getattr(message(), field.name), type(pb.Tensor().shape))
        right = WIRE_TYPES[field.type] | ({LENGTH} if repeated else set())
        for wire_type in CONTENT.keys() - right:
            closing = tag(field.number, 4) if wire_type == GROUP else b""
            yield tag(field.number, wire_type) + CONTENT[wire_type] + closing
    for number in (15, 16, 2047, 19_999, 2**29 - 1):
        for wire_type in (VARINT, FIXED64, LENGTH, FIXED32):
            yield tag(number, wire_type) + CONTENT[wire_type]


def extended(message: Any, path: list[int], more: bytes) -> bytes:
    """Return the bytes of a message with fields added to the message at a path; the first one of a list."""
    if not path:
        return bytes(message.SerializeToString()) + more
    field = message.DESCRIPTOR.fields_by_number[path[0]]
    value = getattr(message, field.name)
    first, *others = value if field.name == "behaviors" else [value]
    data = wrap(extended(first, path[1:], more), path[:1])
    data += b"".join(wrap(other.SerializeToString(), path[:1]) for other in others)
    rest = type(message)()
    rest.CopyFrom(message)
    rest.ClearField(field.name)
    return bytes(rest.SerializeToString()) + data


def undecodable() -> Iterator[tuple[str, bytes]]:
    whole = start("hybrid", options={"size": "small"}, parameters={"drift": 1.0}).SerializeToString()
    for length in range(1, len(whole)):
        yield f"cut after {length} bytes", whole[:length]
    for bad in (b"\xff", b"\xc3", b"\xed\xa0\x80", b"\xf8\x88\x80\x80\x80", b"a\x80b"):
        text = varint(len(bad)) + bad
        yield f"game {bad!r}", wrap(tag(1, LENGTH) + text, [1])
        yield f"option {bad!r}", wrap(tag(1, LENGTH) + text, [1, 2])
        yield f"choice {bad!r}", wrap(tag(2, LENGTH) + text, [1, 2])
        yield f"parameter {bad!r}", wrap(tag(1, LENGTH) + text, [3, 2])
        yield f"part {bad!r}", wrap(tag(1, LENGTH) + text, [1, 7, 1])
    yield "field 0", b"\x00\x01"
    yield "wire type 6", b"\x0e\x01"
    yield "wire type 7", b"\x0f\x01"
    yield "a group that ends without a beginning", tag(1, 4)
    yield "a group that does not end", tag(9, GROUP)
    yield "a group that ends as another", tag(9, GROUP) + tag(8, 4)
    yield "groups in groups", tag(9, GROUP) * 10_000 + tag(9, 4) * 10_000
    yield "a tag of eleven bytes", b"\xff" * 10 + b"\x01"
    yield "a number of eleven bytes", wrap(tag(5, VARINT) + b"\xff" * 10 + b"\x01", [1])
    yield "a length beyond the end", tag(1, LENGTH) + varint(1000) + b"x"
    yield "a length beyond any message", tag(1, LENGTH) + varint(2**63)
    yield "half a double", wrap(tag(2, FIXED64) + bytes(4), [1, 3])
    yield "half a packed number", wrap(tag(2, LENGTH) + b"\x01\x80", [2])


UNDECODABLE = dict(undecodable())


# -------------------------------------------------------------------------------------------------- the tests


@pytest.fixture(scope="module")
def channel(simulator):
    """Yield the connection on which every stream of this module is opened.

    No stream may do more than end itself: after all of them the server says that it is well, and plays as before.
    """
    with grpc.insecure_channel(simulator, ANY_LENGTH) as channel:
        before = played(simulator)
        yield channel
        assert played(simulator) == before
        check = health_pb2.HealthCheckRequest(service="joybridge.v1.SimulatorService")
        answer = health_pb2_grpc.HealthStub(channel).Check(check, timeout=SECONDS)
        assert answer.status == health_pb2.HealthCheckResponse.SERVING


def played(simulator):
    with Player(simulator, "hybrid") as player:
        return player.play(20)


def play(channel, requests):
    """Send all requests of a stream and return its responses, status and text."""
    stream = channel.stream_stream(PLAY, encode, pb.PlayResponse.FromString)(iter(requests), timeout=SECONDS)
    responses = []
    try:
        for response in stream:
            responses.append(response)
    except grpc.RpcError:
        pass
    return responses, stream.code(), stream.details()


@pytest.mark.parametrize("game", GAMES)
def test_what_the_kinds_are_made_from_is_valid(channel, game):
    responses, code, _ = play(channel, [start(game, ARENAS), valid_act(game), reset(seed=3), valid_act(game)])
    assert code == StatusCode.OK
    assert [response.WhichOneof("response") for response in responses] == ["started", "step", "step", "step"]


@pytest.mark.parametrize("path", REQUEST_PATHS)
def test_unknown_fields_are_ignored_in_every_message_of_a_request(channel, path):
    message, numbers = REQUEST_PATHS[path]
    begun = [start("shooting_birds", ARENAS), valid_act("shooting_birds")]
    (saved,) = (one.snapshot for one in play(channel, [*begun, SAVE])[0] if one.HasField("snapshot"))
    requests = [start("shooting_birds", ARENAS, snapshot=saved), valid_act("shooting_birds"), reset(seed=2), SAVE]
    expected, code, _ = play(channel, requests)
    assert code == StatusCode.OK
    index = max(numbers[0] - 1, 0) if numbers else 0
    more = b"".join(unknown_fields(message))
    responses, code, text = play(
        channel, [*requests[:index], extended(requests[index], numbers, more), *requests[index + 1 :]]
    )
    assert (code, text) == (StatusCode.OK, "")
    assert [without_clock(one) for one in responses] == [without_clock(one) for one in expected]


def without_clock(response: pb.PlayResponse) -> pb.PlayResponse:
    response.step.ClearField("simulate_seconds") if response.HasField("step") else None
    return response


@pytest.mark.parametrize("name", UNDECODABLE)
def test_bytes_that_are_no_request_are_refused(channel, name):
    responses, code, text = play(channel, [UNDECODABLE[name]])
    assert (code, responses) == (StatusCode.INVALID_ARGUMENT, [])
    assert "not a PlayRequest" in text and len(text) < 700


MANY = 10_000
VERY_MANY = {
    "options": start("hybrid", options={f"option {number}": "x" for number in range(MANY)}),
    "parameters": start("hybrid", parameters={f"parameter {number}": 1.0 for number in range(MANY)}),
    "parts": start("shooting_birds", snapshot=pb.Snapshot(parts={str(number): b"" for number in range(MANY)})),
    "bytes of a part": start("shooting_birds", snapshot=pb.Snapshot(parts={"arenas": bytes(100 * MANY)})),
    "behaviors": act(*[pb.BehaviorAct()] * MANY),
    "pictures": act(*valid_act("hybrid").act.behaviors, draw=[0] * MANY),
}


@pytest.mark.parametrize("what", VERY_MANY)
@pytest.mark.promise("X4")
def test_very_many_of_anything_are_refused_in_few_words(channel, what):
    begun = [start("hybrid", ARENAS)] if VERY_MANY[what].HasField("act") else []
    responses, code, text = play(channel, [*begun, VERY_MANY[what]])
    assert (code, len(responses)) == (StatusCode.INVALID_ARGUMENT, len(begun))
    assert text and len(text) < 700


# ------------------------------------------------------------------------------------------------ random ones

fuzz = settings(
    derandomize=True, deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
SEEDS = [
    start("hybrid", options={"size": "large"}, parameters={"drift": 0.5}),
    start("shooting_birds", first_arena=2, snapshot=pb.Snapshot(parts={"arenas": b"0123"})),
    *(valid_act(game) for game in GAMES),
    reset(seed=2, parameters={"drift": 0.5}),
    SAVE,
]


def assert_answered_or_refused(channel, requests):
    responses, code, text = play(channel, requests)
    if code == StatusCode.OK:
        assert len(responses) == len(requests)
    else:
        assert code in EXPECTED and text and len(text) < 700


@fuzz
@given(st.lists(st.binary(max_size=64), min_size=1, max_size=3))
def test_random_bytes_are_answered_or_refused(channel, messages):
    assert_answered_or_refused(channel, messages)


@st.composite
def mutations(draw):
    """Return the bytes of a valid request with some of them changed, removed, repeated or put in."""
    data = bytearray(draw(st.sampled_from(SEEDS)).SerializeToString())
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(data)))
        match draw(st.integers(0, 3)):
            case 0:
                data[place : place + 1] = draw(st.binary(min_size=1, max_size=1))
            case 1:
                del data[place : place + draw(st.integers(1, 8))]
            case 2:
                data[place:place] = draw(st.binary(min_size=1, max_size=8))
            case 3:
                data[place:place] = data[max(0, place - draw(st.integers(1, 16))) : place]
    return bytes(data)


@fuzz
@given(st.booleans(), mutations())
@pytest.mark.promise("P1")
def test_mutated_requests_are_answered_or_refused(channel, begun, message):
    assert_answered_or_refused(channel, [start("hybrid", ARENAS), message] if begun else [message])


NAMES = st.sampled_from(["hybrid", "size", "small", "drift", "masks", "arenas"]) | st.text(max_size=4)
TENSORS = st.builds(
    pb.Tensor,
    dtype=st.integers(-1, 6),
    shape=st.lists(st.sampled_from([0, 1, 2, 3, 2**32 - 1]), max_size=3),
    data=st.binary(max_size=32) | st.just(bytes(24)),
)
ACTS = st.builds(
    pb.Act,
    behaviors=st.lists(st.builds(pb.BehaviorAct, axes=st.none() | TENSORS, choices=st.none() | TENSORS), max_size=2),
    draw=st.lists(st.integers(0, 3), max_size=3),
)
STARTS = st.builds(
    pb.Start,
    game=st.sampled_from(GAMES) | NAMES,
    options=st.dictionaries(NAMES, NAMES, max_size=2),
    parameters=st.dictionaries(NAMES, st.floats(), max_size=2),
    arenas=st.integers(0, 4),
    seed=st.integers(0, 2**64 - 1),
    first_arena=st.integers(0, 2**32 - 1),
    snapshot=st.none() | st.builds(pb.Snapshot, parts=st.dictionaries(NAMES, st.binary(max_size=9), max_size=2)),
)
RESETS = st.builds(
    pb.Reset,
    seed=st.none() | st.integers(0, 2**64 - 1),
    parameters=st.dictionaries(NAMES, st.floats(), max_size=2),
)
REQUESTS = (
    st.builds(pb.PlayRequest, start=STARTS)
    | st.builds(pb.PlayRequest, act=ACTS)
    | st.builds(pb.PlayRequest, reset=RESETS)
    | st.sampled_from([*SEEDS, pb.PlayRequest()])
)


@fuzz
@given(st.sampled_from(GAMES), st.lists(REQUESTS, min_size=1, max_size=4))
def test_random_sessions_are_answered_or_refused(channel, game, requests):
    assert_answered_or_refused(channel, [start(game, ARENAS), *requests])
    assert_answered_or_refused(channel, requests)
