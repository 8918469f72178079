"""Messages that are small on the wire and large in memory, or larger than they may be: to a server and to a client."""

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any, NamedTuple

import grpc

from joybridge.client.client import Session, describe
from joybridge.contract.errors import JoybridgeError
from joybridge.v1 import bridge_pb2 as pb
from tools.chaos.outcome import Outcome
from tools.chaos.process import Simulator, forget_peak, mebibytes

SIZE = 100 << 20  # bytes
SERVICE = "joybridge.v1.SimulatorService"
METHODS = {
    f"/{SERVICE}/ListGames": "unary_unary",
    f"/{SERVICE}/DescribeGame": "unary_unary",
    f"/{SERVICE}/Play": "stream_stream",
    "/grpc.health.v1.Health/Check": "unary_unary",
    "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo": "stream_stream",
}
WAYS = {"gzip": grpc.Compression.Gzip, "deflate": grpc.Compression.Deflate, "plain": grpc.Compression.NoCompression}
# MiB of memory that a message may take. gRPC may receive all of one that is too large before it refuses it, but that
# costs its sender as many bytes.
LIMITS = {"gzip": 50.0, "deflate": 50.0, "plain": 50.0 + SIZE / 2**20}
GAME = "orchard"


class Burst(NamedTuple):
    """What a bomb did."""

    way: str
    target: str
    used: float  # MiB of memory, at most
    refused: bool


def bombs(folder: Path, faults: int) -> Outcome:
    """Send bombs of compressed zeros to each call of a server and to a client, all of them so many times."""
    with Simulator() as simulator:
        spec = describe(simulator.address, GAME, {})
        bursts = [burst for _ in range(faults) for burst in _at_server(simulator)]
    with multiprocessing.get_context("spawn").Pool(1) as pool:  # a client whose memory is its own
        pool.apply(_visit, (simulator.address,))  # which is gone; this imports what a client needs
        bursts += [burst for _ in range(faults) for burst in _at_client(pool, spec)]
    most = {way: max(burst.used for burst in bursts if burst.way == way) for way in WAYS}
    problems = [str(burst) for burst in bursts if burst.used > LIMITS[burst.way] or not burst.refused]
    figures = ", ".join(f"{way} {used:.0f} MiB" for way, used in most.items())
    return Outcome(len(bursts), problems, f"messages of {SIZE >> 20} MiB took at most: {figures}")


def _at_server(simulator: Simulator) -> Iterator[Burst]:
    process = simulator.process.pid
    for way, compression in WAYS.items():
        for method, streams in METHODS.items():
            forget_peak(process)
            before = mebibytes(process)
            with grpc.insecure_channel(simulator.address, [("grpc.max_send_message_length", -1)]) as channel:
                call = getattr(channel, streams)(method)
                data = bytes(SIZE)
                try:
                    if streams == "unary_unary":
                        call(data, compression=compression, timeout=60.0)
                    else:
                        list(call(iter([data]), compression=compression, timeout=60.0))
                    refused = False
                except grpc.RpcError as error:
                    refused = error.code() in (grpc.StatusCode.UNIMPLEMENTED, grpc.StatusCode.RESOURCE_EXHAUSTED)
            yield Burst(way, method, mebibytes(process, "VmHWM") - before, refused)


def _at_client(pool: Pool, spec: pb.GameSpec) -> Iterator[Burst]:
    for way, compression in WAYS.items():
        for method in ("DescribeGame", "Play"):
            with _hostile(spec, compression, method) as address:
                used, error = pool.apply(_visit, (address,))
            yield Burst(way, f"client, {method}: {error!r}", used, bool(error))


@contextmanager
def _hostile(spec: pb.GameSpec, compression: grpc.Compression, bomb: str) -> Iterator[str]:
    """Yield the address of a server that answers one call with a bomb."""

    def describe_game(request: bytes, context: Any) -> bytes:
        return bytes(SIZE) if bomb == "DescribeGame" else pb.DescribeGameResponse(spec=spec).SerializeToString()

    def play(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
        next(requests)
        yield bytes(SIZE)

    handlers = {
        "DescribeGame": grpc.unary_unary_rpc_method_handler(describe_game),
        "Play": grpc.stream_stream_rpc_method_handler(play),
    }
    with ThreadPoolExecutor(4) as threads:
        options = [("grpc.max_send_message_length", -1)]
        server = grpc.server(threads, options=options, compression=compression)
        server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(SERVICE, handlers)])
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.stop(None).wait()


def _visit(address: str) -> tuple[float, str]:
    """Open a session in this process. Return how much memory it took in MiB, and the error."""
    forget_peak(os.getpid())
    before = mebibytes(os.getpid())
    try:
        Session(address, GAME, arenas=2, seed=0, timeout=20.0).close()
        error = ""
    except JoybridgeError as caught:
        error = str(caught)
    return mebibytes(os.getpid(), "VmHWM") - before, error
