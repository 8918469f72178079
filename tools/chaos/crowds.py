"""Crowds of connections and silent streams: they take no place, and nothing of them is left at the server."""

import asyncio
import random
import socket
import struct
from contextlib import suppress
from pathlib import Path

import grpc

from joybridge.client.client import Session
from joybridge.client.interruptible_loop import EVENT_LOOP
from joybridge.layouts import make_acts
from tools.chaos.outcome import Outcome
from tools.chaos.process import Simulator, mebibytes, open_files, threads, wait_until

AT_ONCE = 200
SESSIONS = 64  # the server's limit
SPARE = 4  # files and threads that may have come besides: of pools that grow once
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"  # how HTTP/2 begins


async def connect(address: str, number: int) -> None:
    """Open a connection that is no client's: silent, half of a greeting, garbage, or reset at once."""
    host, _, port = address.rpartition(":")
    with suppress(OSError):
        reader, writer = await asyncio.open_connection(host, int(port))
        match number % 4:
            case 0:
                pass
            case 1:
                writer.write(PREFACE[:12])
            case 2:
                writer.write(random.Random(number).randbytes(200))
            case _:
                end: socket.socket = writer.get_extra_info("socket")
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with suppress(TimeoutError):
            await asyncio.wait_for(reader.read(1), 0.5)
        writer.close()
        await writer.wait_closed()


async def open_streams(address: str, count: int) -> int:
    """Open Play streams without a Start; return how many the server ends for that."""
    async with grpc.aio.insecure_channel(address) as channel:
        play = channel.stream_stream("/joybridge.v1.SimulatorService/Play")
        codes = await asyncio.gather(*(play(timeout=60.0).code() for _ in range(count)))
    return codes.count(grpc.StatusCode.DEADLINE_EXCEEDED)


async def crowd(address: str, first: int, end: int) -> int:
    """Make connections, half of them streams; return how many streams were not ended by the server."""
    streams = (end - first) // 2
    ended = asyncio.create_task(open_streams(address, streams))
    await asyncio.gather(*(connect(address, number) for number in range(first + streams, end)))
    return streams - await ended


def open_sessions(address: str) -> None:
    """Open as many sessions as the server allows, and close them. Raises SimulatorError if one is refused."""
    sessions = [Session(address, "orchard", arenas=1, seed=number) for number in range(SESSIONS)]
    for session in sessions:
        session.close()


def crowds(folder: Path, faults: int) -> Outcome:
    """Open connections, half of them Play streams without a Start, while a session plays."""
    problems = []
    with Simulator("--start-seconds", "1", "--sessions", str(SESSIONS + 1)) as simulator:
        process = simulator.process.pid
        with Session(simulator.address, "orchard", arenas=2, seed=1) as session:
            acts = make_acts(session.spec, 2)
            open_sessions(simulator.address)
            EVENT_LOOP.run(crowd, simulator.address, 0, min(faults, AT_ONCE))  # pools grow, modules are imported
            files, workers, memory = open_files(process), threads(process), mebibytes(process)
            for first in range(0, faults, AT_ONCE):
                if left := EVENT_LOOP.run(crowd, simulator.address, first, min(faults, first + AT_ONCE)):
                    problems.append(f"{left} streams from {first} on were not ended")
                session.step(acts)
            open_sessions(simulator.address)
            wait_until(lambda: open_files(process) <= files and threads(process) <= workers, 10.0)
            more_files, more_threads = open_files(process) - files, threads(process) - workers
        figures = (
            f"files {files} {more_files:+}, threads {workers} {more_threads:+}, {SESSIONS} sessions could be opened "
            f"afterwards, the server's memory {mebibytes(process) - memory:+.0f} MiB"
        )
    if more_files > SPARE or more_threads > SPARE:
        problems.append("files or threads are left")
    return Outcome(faults, problems, figures)
