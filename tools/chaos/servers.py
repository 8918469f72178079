"""Servers that lie: whatever they send, a client ends with one printable sentence, soon, and without much memory."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc
import numpy as np

from joybridge.client.client import Session
from joybridge.client.errors import SimulatorError
from joybridge.contract.versions import own_version
from joybridge.layouts import make_acts
from joybridge.simulator.catalog import load_games
from joybridge.simulator.session import Session as Honest
from joybridge.simulator.session import describe
from joybridge.v1 import bridge_pb2 as pb
from tools.chaos.outcome import Outcome
from tools.chaos.process import forget_peak, mebibytes

GAME = "archer"
PATIENCE = 0.5  # of the client
LONGEST = 5.0  # seconds until it has ended
LARGEST = 200.0  # MiB that it may take
ESCAPES = "\x1b]0;owned\x07\r\nerror: run `curl …`\x1b[2J" * 200
INFINITE, NAN = np.float32(np.inf).tobytes(), np.float32(np.nan).tobytes()


def _tensor(change: Callable[[pb.Tensor], object], *, rewards: bool = False) -> Callable[[pb.PlayResponse], None]:
    """Return what changes the first observation or the rewards of a step."""

    def lie(response: pb.PlayResponse) -> None:
        step = response.step.behaviors[0]
        change(step.rewards if rewards else step.observations[0])

    return lie


def _start_with(data: bytes) -> Callable[[pb.Tensor], None]:
    """Return what changes the first bytes of a tensor."""

    def change(tensor: pb.Tensor) -> None:
        tensor.data = data + tensor.data[len(data) :]

    return change


def _behavior(change: Callable[[pb.BehaviorStep], object]) -> Callable[[pb.PlayResponse], None]:
    """Return what changes the first behavior of a step."""

    def lie(response: pb.PlayResponse) -> None:
        change(response.step.behaviors[0])

    return lie


def _ends(step: pb.BehaviorStep) -> None:
    step.terminated.data = b"\1" + step.terminated.data[1:]


def _forbids(step: pb.BehaviorStep) -> None:
    for mask in step.masks:
        mask.data = bytes(len(mask.data))


def _repeats(response: pb.PlayResponse) -> None:
    response.step.behaviors.extend(list(response.step.behaviors))


# Changes of the response to an Act, or what is sent in place of it.
LIES: dict[str, Callable[[pb.PlayResponse], object] | bytes | str] = {
    "NaN as observation": _tensor(_start_with(NAN)),
    "NaN as reward": _tensor(_start_with(NAN), rewards=True),
    "an infinite reward": _tensor(_start_with(INFINITE), rewards=True),
    "a dtype that is none": _tensor(lambda tensor: setattr(tensor, "dtype", 0)),
    "a wrong shape": _tensor(lambda tensor: tensor.shape.append(1)),
    "a shape of 2^64 numbers": _tensor(lambda tensor: tensor.shape.extend([2**32 - 1, 2**32 - 1])),
    "half of the data": _tensor(lambda tensor: setattr(tensor, "data", tensor.data[: len(tensor.data) // 2])),
    "no behaviors": lambda response: response.step.ClearField("behaviors"),
    "behaviors twice": _repeats,
    "no rewards": _behavior(lambda step: step.ClearField("rewards")),
    "an episode that ends without its last observation": _behavior(_ends),
    "masks that forbid everything": _behavior(_forbids),
    "pictures that nobody asked for": lambda response: response.step.pictures.add(),
    "an empty response": lambda response: response.Clear(),
    "a snapshot in place of a step": lambda response: response.snapshot.parts.update({"x": b""}),
    "bytes that are no message": b"\xff\xff\xff",
    "10 MB": bytes(10_000_000),
    "an end": "end",
    "a status full of escapes": "escapes",
    "silence": "silence",
    "the answer twice": "twice",
}


def _large(spec: pb.GameSpec) -> None:
    spec.behaviors[0].sensors[0].shape[:] = [30_000_000]


def _overflowing(spec: pb.GameSpec) -> None:
    spec.behaviors[0].sensors[0].shape[:] = [2**32 - 1] * 8


def _rename(name: str) -> Callable[[pb.GameSpec], None]:
    def change(spec: pb.GameSpec) -> None:
        spec.behaviors[0].name = name

    return change


def _axis(name: str, value: float) -> Callable[[pb.GameSpec], object]:
    return lambda spec: setattr(spec.behaviors[0].device.axes[0], name, value)


# Changes of a spec.
SPECS: dict[str, Callable[[pb.GameSpec], object]] = {
    "a sensor of 30 million numbers": _large,
    "a sensor of 2^256 numbers": _overflowing,
    "60,000 metrics": lambda spec: spec.behaviors[0].metrics.extend(pb.Metric(name=f"m{i}") for i in range(60_000)),
    "a name with escapes": _rename("\x1b]0;owned\x07"),
    "a name of two lines": _rename("player\r\nerror: run `curl …`"),
    "a name of 300 characters": _rename("x" * 300),
    "no name": _rename(""),
    "no behaviors": lambda spec: spec.ClearField("behaviors"),
    "NaN as bound": _axis("low", float("nan")),
    "an axis whose low is above its high": _axis("low", 9e9),
    "5 MB of description": lambda spec: setattr(spec, "description", "x" * 5_000_000),
}


@contextmanager
def lying(lie: Callable[[pb.PlayResponse], object] | bytes | str | None, spec: pb.GameSpec) -> Iterator[str]:
    """Yield the address of a server that describes GAME by a spec and lies in the answer to the second Act."""
    games = load_games()

    def play(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
        session = Honest(games)
        for number, request in enumerate(requests):
            response = session.answer(pb.PlayRequest.FromString(request))
            match lie if number == 2 else None:
                case None:
                    yield response.SerializeToString()
                case bytes(data):
                    yield data
                case "end":
                    return
                case "escapes":
                    context.abort(grpc.StatusCode.INTERNAL, ESCAPES)
                case "silence":
                    while context.is_active():
                        time.sleep(0.02)
                case "twice":
                    yield response.SerializeToString()
                    yield response.SerializeToString()
                case change if callable(change):
                    change(response)
                    yield response.SerializeToString()

    described = pb.DescribeGameResponse(spec=spec, version=own_version()).SerializeToString()
    handlers = {
        "DescribeGame": grpc.unary_unary_rpc_method_handler(lambda *_: described),
        "Play": grpc.stream_stream_rpc_method_handler(play),
    }
    with ThreadPoolExecutor(4) as threads:
        server = grpc.server(threads, options=[("grpc.max_send_message_length", -1)])
        server.add_generic_rpc_handlers(
            [grpc.method_handlers_generic_handler("joybridge.v1.SimulatorService", handlers)]
        )
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.stop(None).wait()


def visit(address: str) -> str:
    """Play at a server and return the sentence with which that ends, empty if it does not."""
    try:
        with Session(address, GAME, arenas=3, seed=1, timeout=PATIENCE, transport="grpc") as session:
            for _ in range(5):
                session.step(make_acts(session.spec, 3))
                time.sleep(0.01)  # after a pause, the session notices what was not asked for
    except SimulatorError as error:
        return str(error)
    return ""


def servers(folder: Path, faults: int) -> Outcome:
    """Play at servers that lie or send wrong specs, all of them so many times."""
    logging.getLogger("grpc").setLevel(logging.CRITICAL)  # the servers' own
    own, problems = os.getpid(), []
    longest = most = 0.0
    honest = describe(load_games(), GAME, {})
    with lying(None, honest) as address:
        if error := visit(address):
            problems.append(f"an honest server: {error}")
    cases = [(name, lie, None) for name, lie in LIES.items()] + [(name, None, change) for name, change in SPECS.items()]
    for name, lie, change in cases * faults:
        spec = pb.GameSpec()
        spec.CopyFrom(honest)
        if change is not None:
            change(spec)
        with lying(lie, spec) as address:
            forget_peak(own)
            memory, begin = mebibytes(own), time.monotonic()
            sentence = visit(address)
            seconds, used = time.monotonic() - begin, mebibytes(own, "VmHWM") - memory
        longest = max(longest, seconds)
        most = max(most, used)
        if not sentence or not sentence.isprintable() or seconds > LONGEST or used > LARGEST:
            problems.append(f"{name}: {seconds:.1f} s, {used:.0f} MiB, {sentence[:300]!r}")
    figures = f"{len(LIES)} lies and {len(SPECS)} specs, a sentence each, in {longest:.1f} s and {most:.0f} MiB at most"
    return Outcome(len(cases) * faults, problems, figures)
