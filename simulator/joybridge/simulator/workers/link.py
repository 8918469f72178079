"""What the server and a worker say to each other: a kind, a length, and JSON or a message of the contract."""

import math
import os
import signal
import socket
import struct
from contextlib import suppress
from select import select
from time import monotonic  # not by its module: programs may be given another clock there

HEADER = struct.Struct("<cQ")  # kind and length
MAX_MESSAGE_BYTES = 1 << 31  # bytes of a message
READ_BYTES = 1 << 20  # that are read at once, at most
CLOSING_SECONDS = 1.0  # for a worker to close its games when the server has let it go
LOOK_SECONDS = 0.5  # after which a thread that waits may be stopped; see game_thread.py

# To the worker: JSON, but pb.Act for ACT and DISTRIBUTE.
START, RESET, OBSERVE, ACT, DRAW, DISTRIBUTE = b"S", b"R", b"O", b"A", b"D", b"B"
DONE, STEP, PICTURE, FAULT = b"N", b"T", b"P", b"F"  # from it: nothing, pb.Step, pb.Tensor, JSON with what has failed

Frame = tuple[bytes, bytes]  # kind and message


class Link:
    """One end of the connection. It closes with the process at the other end."""

    def __init__(self, connection: socket.socket) -> None:
        """Take a connected socket."""
        self._socket = connection

    def send(self, kind: bytes, message: bytes, seconds: float | None = None) -> None:
        """Send a frame. Raises OSError if the other end is closed, TimeoutError if it does not take it in time."""
        self._socket.settimeout(seconds)
        self._socket.sendall(HEADER.pack(kind, len(message)) + message)

    def receive(self, seconds: float = math.inf) -> Frame:
        """Return the next frame. Raises EOFError if the other end is closed, TimeoutError if nothing comes in time."""
        limit = monotonic() + seconds
        kind, size = HEADER.unpack(self._read(HEADER.size, limit))
        if size > MAX_MESSAGE_BYTES:  # something else has written to the connection
            raise EOFError
        return kind, bytes(self._read(size, limit))

    def waits(self, seconds: float) -> bool:
        """Return whether something comes, or the other end closes, in so many seconds."""
        return bool(select([self._socket], [], [], seconds)[0])

    def kill(self) -> None:
        """Kill the process that has connected to this one, where the system says which one that is (Linux)."""
        if hasattr(socket, "SO_PEERCRED"):
            process, *_ = struct.unpack("iii", self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def _read(self, size: int, limit: float) -> bytearray:
        data = bytearray(size)
        missing = memoryview(data)
        while missing:
            self._socket.settimeout(LOOK_SECONDS)
            try:
                came = self._socket.recv_into(missing[:READ_BYTES])
            except TimeoutError:
                if monotonic() > limit:
                    raise
                continue
            if came == 0:
                raise EOFError
            missing = missing[came:]
        return data
