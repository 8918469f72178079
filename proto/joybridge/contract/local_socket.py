"""The Unix socket that carries the messages of a session, and a client's end; see LOCAL TRANSPORT in bridge.proto.

A small message costs each end one system call to send it, and one or two to receive it.
"""

import math
import os
import select
import socket
import struct
import time
import weakref
from pathlib import Path

from joybridge.contract.errors import JoybridgeError

__all__ = ["LENGTH", "FrameError", "LocalSocket", "MessageSocket"]

LENGTH = struct.Struct("<I")  # stands before each message
_READ_BYTES = 1 << 16  # that are read at once, at least
_MAX_WAIT_SECONDS = 1e6  # of a wait, as poll has 31 bits of milliseconds


class FrameError(JoybridgeError):
    """What arrived on the socket is not a message. size: the bytes that it is said to have."""

    def __init__(self, size: int, largest: int) -> None:
        super().__init__(f"a message of {size} bytes, expected at most {largest}")
        self.size = size


class MessageSocket:
    """A connected Unix socket, as messages. All methods block. Times may be infinite."""

    def __init__(self, connected: socket.socket, largest: int) -> None:
        """Take a socket that blocks. largest: bytes of a message that is received."""
        self._largest = largest
        self._buffer = memoryview(bytearray(_READ_BYTES))
        self._received = 0  # bytes of the buffer
        self._socket = connected
        self._readable = select.poll()
        self._readable.register(connected, select.POLLIN)
        weakref.finalize(self, connected.close)

    def send(self, message: bytes, seconds: float = math.inf) -> None:
        """Send a message. Raises TimeoutError if the other end does not read it in time, and OSError."""
        data = LENGTH.pack(len(message)) + message
        try:
            sent = self._socket.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            sent = 0
        if sent < len(data):
            self._socket.settimeout(None if seconds == math.inf else seconds)
            self._socket.sendall(memoryview(data)[sent:])
            self._socket.settimeout(None)

    def receive(self, seconds: float = math.inf) -> bytes | None:
        """Return the next message, None at the end. Raises TimeoutError if it is not complete in time, OSError."""
        until = time.monotonic() + seconds
        if not self._read(LENGTH.size, until):
            return None
        (size,) = LENGTH.unpack_from(self._buffer)
        if size > self._largest:
            raise FrameError(size, self._largest)
        end = LENGTH.size + size
        if not self._read(end, until):
            return None
        message = bytes(self._buffer[LENGTH.size : end])
        self._received -= end
        if self._received:
            self._buffer[: self._received] = bytes(self._buffer[end : end + self._received])
        return message

    @property
    def unread(self) -> bool:
        """Whether something has arrived that `receive` has not returned."""
        if self._received or not self._readable.poll(0):
            return self._received > 0
        try:
            return bool(self._socket.recv(1, socket.MSG_PEEK))
        except OSError:  # the connection has ended
            return False

    def half_close(self) -> None:
        """Tell the other end that no more messages come. Raises OSError."""
        self._socket.shutdown(socket.SHUT_WR)

    def end(self) -> None:
        """End the connection, also for a thread that waits for a message. Raises OSError."""
        self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection. May be called again."""
        self._socket.close()

    def _read(self, size: int, until: float) -> bool:
        """Read until so many bytes are there. Return False if the other end closed the socket before."""
        if size > len(self._buffer):
            larger = memoryview(bytearray(size))
            larger[: self._received] = self._buffer[: self._received]
            self._buffer = larger
        while self._received < size:
            if until < math.inf:
                left = max(until - time.monotonic(), 0.0)
                if not self._readable.poll(min(left, _MAX_WAIT_SECONDS) * 1000.0):
                    raise TimeoutError
            count = self._socket.recv_into(self._buffer[self._received :])
            if not count:
                return False
            self._received += count
        return True


class LocalSocket(MessageSocket):
    """A client's connection to the Unix socket of a session."""

    def __init__(self, path: str, largest: int) -> None:
        """Connect. largest: bytes of a message that is received.

        Raises OSError, also if the folder of the socket is open to others: it is then not what a server has made.
        """
        folder = Path(path).parent.stat()
        if folder.st_uid != os.getuid() or folder.st_mode & 0o077:
            raise PermissionError(f"the folder of {path} must belong to this user alone")
        client = socket.socket(socket.AF_UNIX)
        try:
            client.setblocking(False)  # a server that takes no connection is an OSError, no wait
            client.connect(path)
            client.setblocking(True)
        except BaseException:
            client.close()
            raise
        super().__init__(client, largest)
