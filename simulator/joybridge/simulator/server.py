"""The server: its address, its companions (health and reflection), gRPC's options, and how it ends."""

import asyncio
import faulthandler
import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from types import FrameType

import grpc
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from joybridge.contract.address import READY
from joybridge.contract.credentials import NO_COMPRESSION
from joybridge.contract.limits import request_bytes
from joybridge.contract.memory import keep_memory
from joybridge.process import leave
from joybridge.simulator.authentication import ServerCredentials, TokenInterceptor
from joybridge.simulator.catalog import Catalog, specs
from joybridge.simulator.game_thread import game_threads
from joybridge.simulator.service import Limits, Service
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

log = logging.getLogger("simulator")

SERVICE = pb.DESCRIPTOR.services_by_name["SimulatorService"].full_name
GRACE_SECONDS = 1.0  # for calls to end after a signal
GAME_SECONDS = 0.5  # for games to end after that
STDERR = 2  # the descriptor, because a game may have closed or replaced `sys.stderr`
ENDING = (signal.SIGINT, signal.SIGTERM)
STUCK_SECONDS = 4.0  # for all of it, before the process ends wherever it is
SILENT_MS, ANSWER_MS = 8_000, 5_000  # without a byte of a client, until it is asked whether it is there; for its answer
# How long the thread of a game may run Python code while the event loop waits. Beside four games in endless loops, a
# call takes 15 ms with this and 70 ms with Python's default of 5 ms (medians on a busy machine with two cores).
SWITCH_SECONDS = 0.001


async def serve(games: Catalog, address: str, limits: Limits, protection: ServerCredentials, with_parent: bool) -> None:
    """Serve until SIGINT or SIGTERM or, with_parent, until standard input closes.

    Prints the bound address as one line. Raises OSError if it cannot bind.
    """
    sys.setswitchinterval(SWITCH_SECONDS)
    keep_memory()
    stop = _stop_event(with_parent)
    server = grpc.aio.server(interceptors=[TokenInterceptor(protection.token)], options=_options(games))
    service = Service(games, limits)
    rpc.add_SimulatorServiceServicer_to_server(service, server)
    healthy = health.aio.HealthServicer()
    health_pb2_grpc.add_HealthServicer_to_server(healthy, server)
    reflection.enable_server_reflection([SERVICE, health.SERVICE_NAME, reflection.SERVICE_NAME], server)
    bound = _bind(server, address, protection)
    await server.start()
    for name in ("", SERVICE):
        await healthy.set(name, health_pb2.HealthCheckResponse.SERVING)
    print(f"{READY}{bound}", flush=True)
    sweeper = asyncio.create_task(service.sweep())
    await stop.wait()
    sweeper.cancel()
    await healthy.enter_graceful_shutdown()
    sessions = service.end_streams()
    if sessions and not with_parent:  # the program that started this one shut it down
        log.info("shutting down: %d open sessions end with UNAVAILABLE", sessions)
    await server.stop(GRACE_SECONDS)
    service.release_streams()
    _end_games()
    faulthandler.cancel_dump_traceback_later()


def _bind(server: grpc.aio.Server, address: str, protection: ServerCredentials) -> str:
    """Listen on an address and return it with its real port. Raises OSError."""
    if _taken(address):
        raise OSError(f"cannot listen on {address}: another server listens there")
    before = os.umask(0o177)  # a unix socket is for this user alone
    try:
        port = protection.bind(server, address)
    except RuntimeError as error:
        raise OSError(f"cannot listen on {address}: it is in use or not an address of this machine") from error
    finally:
        os.umask(before)
    return address if address.startswith("unix:") else f"{address.rsplit(':', 1)[0]}:{port}"


def _taken(address: str) -> bool:
    """Return whether a server listens on a unix socket: gRPC would replace its path without an error."""
    if not address.startswith("unix:"):
        return False
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(address.removeprefix("unix:"))
        except OSError:  # no file there, or one that a killed server left
            return False
    return True


def _stop_event(with_parent: bool) -> asyncio.Event:
    """Return the event that ends the server: SIGINT, SIGTERM or, with_parent, the end of standard input."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()

    def end() -> None:
        with suppress(RuntimeError):  # the loop is closed already
            loop.call_soon_threadsafe(stop.set)

    ear, mouth = socket.socketpair()
    mouth.setblocking(False)
    for number in ENDING:
        signal.signal(number, _leave_it_to_the_thread)
    signal.set_wakeup_fd(mouth.detach())  # for as long as the process runs
    Thread(target=_listen_for_signals, args=[ear, end], daemon=True).start()
    if with_parent:
        try:
            loop.add_reader(sys.stdin, stop.set)  # readable only when it closes, because nothing is written to it
        except NotImplementedError:  # Windows
            Thread(target=_read_to_the_end, args=[end], daemon=True).start()
        except (PermissionError, ValueError) as error:
            raise OSError("--with-parent watches standard input, which must be a pipe or a terminal") from error
    return stop


def _leave_it_to_the_thread(number: int, frame: FrameType | None) -> None:
    """Handle a signal by doing nothing: Python writes its number into the socket, wherever the main thread hangs."""


def _listen_for_signals(ear: socket.socket, end: Callable[[], object]) -> None:
    """Call `end` at each signal; if the event loop is stuck, end the process all the same, with its stacks in the log.

    This is a thread's work because a handler runs between two instructions of Python in the main thread, and never
    where a signal comes just before a system call that does not return.
    """
    while number := ear.recv(1):
        if number[0] in ENDING:
            faulthandler.dump_traceback_later(STUCK_SECONDS, exit=True, file=STDERR)
            end()


def _read_to_the_end(end: Callable[[], object]) -> None:
    """Wait until standard input closes."""
    with suppress(OSError):
        while os.read(0, 1024):
            pass
    end()


def _end_games() -> None:
    """Wait shortly for games that still work, then end the process with their stacks in the log."""
    limit = time.monotonic() + GAME_SECONDS
    for thread in game_threads():
        thread.end()  # also where the event loop ended before the session did: a thread without a function then ends
        thread.join(max(0.0, limit - time.monotonic()))
    if hanging := game_threads():
        for thread in hanging:
            log.error("the server ends although a game is still working:\n%s", thread.stack())
        leave(0)  # Python waits for no thread, but it may crash if a thread runs compiled code while it ends


def _options(games: Catalog) -> list[tuple[str, int]]:
    """Return gRPC's options: the largest message that a spec allows, and pings that detect lost clients."""
    largest = max(request_bytes(spec, spec.max_arenas) for game in games.values() for spec in specs(game))
    return [
        NO_COMPRESSION,
        ("grpc.max_receive_message_length", largest),
        ("grpc.max_send_message_length", -1),  # no limit: the checks of requests bound the size of responses
        ("grpc.keepalive_time_ms", SILENT_MS),
        ("grpc.keepalive_timeout_ms", ANSWER_MS),
        ("grpc.http2.ping_timeout_ms", ANSWER_MS),  # by default a minute, whatever keepalive_timeout_ms says
        ("grpc.http2.min_recv_ping_interval_without_data_ms", 5_000),
        ("grpc.so_reuseport", 0),  # otherwise two servers could listen on one port and share its connections
    ]
