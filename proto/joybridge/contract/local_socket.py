"""A client's end of the Unix socket that carries the messages of a session; see LOCAL TRANSPORT in bridge.proto."""

import os
import socket
import struct
import time
import weakref
from pathlib import Path

from joybridge.contract.errors import JoybridgeError

__all__ = ["LENGTH", "FrameError", "LocalSocket"]

LENGTH = struct.Struct("<I")  # stands before each message
_READ_BYTES = 1 << 16  # that are read at once, at least


class FrameError(JoybridgeError):
    """What arrived on the socket is not a message."""


class LocalSocket:
    """A connection to the Unix socket of a session. All methods block."""

    def __init__(self, path: str, largest: int) -> None:
        """Connect. largest: bytes of a message that is received.

        Raises OSError, also if the folder of the socket is open to others: it is then not what a server has made.
        """
        folder = Path(path).parent.stat()
        if folder.st_uid != os.getuid() or folder.st_mode & 0o077:
            raise PermissionError(f"the folder of {path} must belong to this user alone")
        self._largest = largest
        self._received = bytearray()
        self._socket = socket.socket(socket.AF_UNIX)
        weakref.finalize(self, self._socket.close)
        self._socket.setblocking(False)  # a server that takes no connection is an OSError, no wait
        self._socket.connect(path)

    def send(self, message: bytes, seconds: float) -> None:
        """Send a message. Raises TimeoutError if the server does not read it in time, and OSError."""
        self._socket.settimeout(seconds)
        self._socket.sendall(LENGTH.pack(len(message)) + message)

    def receive(self, seconds: float) -> bytes:
        """Return the next message, b"" at the end. Raises TimeoutError if it is not complete in time, OSError."""
        until = time.monotonic() + seconds
        if not self._read(LENGTH.size, until):
            return b""
        (size,) = LENGTH.unpack_from(self._received)
        if size > self._largest:
            raise FrameError(f"the server sent a message of {size} bytes, expected at most {self._largest}")
        end = LENGTH.size + size
        if not self._read(end, until):
            return b""
        message = bytes(self._received[LENGTH.size : end])
        del self._received[:end]
        return message

    @property
    def unread(self) -> bool:
        """Whether something has arrived that `receive` has not returned."""
        if self._received:
            return True
        self._socket.setblocking(False)
        try:
            return bool(self._socket.recv(1, socket.MSG_PEEK))
        except OSError:  # nothing has arrived
            return False

    def half_close(self) -> None:
        """Tell the server that no more messages come. Raises OSError."""
        self._socket.shutdown(socket.SHUT_WR)

    def end(self) -> None:
        """End the connection, also for a thread that waits for a message. Raises OSError."""
        self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection. May be called again."""
        self._socket.close()

    def _read(self, size: int, until: float) -> bool:
        """Read until so many bytes are there. Return False if the server closed the socket before."""
        while (missing := size - len(self._received)) > 0:
            self._socket.settimeout(max(until - time.monotonic(), 1e-6))
            data = self._socket.recv(max(missing, _READ_BYTES))
            if not data:
                return False
            self._received += data
        return True
