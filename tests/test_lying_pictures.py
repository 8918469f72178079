"""A server that sends what is no image of its spec, in many ways: each is a sentence, and ends the session."""

from contextlib import closing
from itertools import product

import pytest

import joybridge.commands.train as trainer
from joybridge.client.client import Session
from joybridge.client.errors import SimulatorError
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers import LONGEST, BrokenServer, Gauntlet, Honest, serving

IMAGE = 2  # number of the sensor: gray, 2 x 2 pixels
PLACES = ["first", "later", "ended"]  # in Started, in the step after a decision, as the last one of an episode


def data(change):
    """Return a lie that changes the bytes."""

    def lie(images):
        images[IMAGE].data = change(images[IMAGE].data)

    return lie


def dtype(number):
    """Return a lie about the type."""

    def lie(images):
        images[IMAGE].dtype = number

    return lie


def shape(*sizes, fill=0):
    """Return a lie about the shape. fill: bytes for each lane; 0: as there were."""

    def lie(images):
        tensor = images[IMAGE]
        lanes = tensor.shape[0]
        del tensor.shape[:]
        tensor.shape.extend([lanes if size is None else size for size in sizes])
        tensor.data = bytes(fill * lanes) or tensor.data

    return lie


def twice(images):
    images.append(images[IMAGE])


def missing(images):
    del images[IMAGE]


def exchanged(images):
    images[IMAGE].CopyFrom(images[IMAGE - 1])


FLOATS = pb.DTYPE_FLOAT32
LIES = {
    "floats": (dtype(FLOATS), "dtype is DTYPE_FLOAT32, expected DTYPE_UINT8"),
    "integers": (dtype(pb.DTYPE_INT32), "dtype is DTYPE_INT32, expected DTYPE_UINT8"),
    "booleans": (dtype(pb.DTYPE_BOOL), "dtype is DTYPE_BOOL, expected DTYPE_UINT8"),
    "no type": (dtype(0), "dtype is DTYPE_UNSPECIFIED, expected DTYPE_UINT8"),
    "unknown type": (dtype(99), "dtype is unknown (99), expected DTYPE_UINT8"),
    "no channel": (shape(None, 2, 2), "shape is [1, 2, 2], expected [1, 2, 2, 1]"),
    "flattened": (shape(None, 4), "shape is [1, 4], expected [1, 2, 2, 1]"),
    "a row": (shape(None, 1, 4, 1), "shape is [1, 1, 4, 1], expected [1, 2, 2, 1]"),
    "in color": (shape(None, 2, 2, 3, fill=12), "shape is [1, 2, 2, 3], expected [1, 2, 2, 1]"),
    "channels first": (shape(None, 1, 2, 2), "shape is [1, 1, 2, 2], expected [1, 2, 2, 1]"),
    "larger": (shape(None, 5, 2, 1, fill=10), "shape is [1, 5, 2, 1], expected [1, 2, 2, 1]"),
    "no lane": (shape(0, 2, 2, 1), "shape is [0, 2, 2, 1], expected [1, 2, 2, 1]"),
    "another lane": (shape(2, 2, 2, 1, fill=8), "shape is [2, 2, 2, 1], expected [1, 2, 2, 1]"),
    "no shape": (shape(), "shape is [], expected [1, 2, 2, 1]"),
    "huge": (shape(2**32 - 1, 2**32 - 1), "shape is [4294967295, 4294967295], expected [1, 2, 2, 1]"),
    "many sizes": (shape(*[1] * 10_000), "expected [1, 2, 2, 1]"),
    "no bytes": (data(lambda old: b""), "0 bytes of data, expected 4 for shape [1, 2, 2, 1]"),
    "a byte less": (data(lambda old: old[:-1]), "3 bytes of data, expected 4 for shape [1, 2, 2, 1]"),
    "a byte more": (data(lambda old: old + b"x"), "5 bytes of data, expected 4 for shape [1, 2, 2, 1]"),
    "many bytes": (data(lambda old: bytes(2**15)), "32768 bytes of data, expected 4 for shape [1, 2, 2, 1]"),
    "twice": (twice, "5 tensors, expected 4, one per sensor"),
    "missing": (missing, "3 tensors, expected 4, one per sensor"),
    "another sensor": (exchanged, "dtype is DTYPE_INT32, expected DTYPE_UINT8"),
}


def liar(lie, place):
    """Return a server that lies in one place of its steps."""

    class Liar(Honest):
        def first(self, step):
            if place == "first":
                lie(step.behaviors[0].observations)

        def later(self, step):
            player = step.behaviors[0]
            if place == "later":
                lie(player.observations)
            elif place == "ended" and player.HasField("ended"):
                lie(player.ended.final_observations)

    return BrokenServer(set(), session=Liar)


def play(address):
    """Play until an episode must have ended."""
    with closing(Session(address, Gauntlet.name, arenas=1, seed=0)) as session:
        acts = make_acts(session.spec, 1)
        acts[0].axes[:, 1] = 1.0
        for _ in range(LONGEST):
            session.step(acts)


@pytest.mark.parametrize(("name", "place"), list(product(LIES, PLACES)))
def test_a_picture_that_is_none_is_named_with_what_came_and_what_was_expected(name, place):
    lie, message = LIES[name]
    with serving(liar(lie, place)) as address, pytest.raises(SimulatorError) as caught:
        play(address)
    text = str(caught.value)
    field = "ended.final_observations" if place == "ended" else "observations"
    assert text.startswith(f"the simulator at {address} broke the contract: player.{field}")
    assert message in text and "\n" not in text and len(text) < 400


@pytest.mark.parametrize("place", PLACES)
def test_a_training_that_is_sent_no_picture_ends_with_this_sentence(place, tmp_path, capsys, signals):
    lie, message = LIES["in color"]
    (tmp_path / "config.yaml").write_text("game: gauntlet\narenas: 1\n")
    with serving(liar(lie, place)) as address:
        command = ["train", str(tmp_path / "config.yaml"), "--run", str(tmp_path / "run"), "--simulator", address]
        assert trainer.main(command) == 1
    errors = capsys.readouterr().err
    assert message in errors and "Traceback" not in errors


def test_a_picture_of_many_megabytes_is_not_even_read():
    lie = data(lambda old: bytes(2**24))
    with (
        serving(liar(lie, "later")) as address,
        pytest.raises(SimulatorError, match="message larger than max") as caught,
    ):
        play(address)
    assert str(caught.value).startswith(f"error from the simulator at {address}: ")
