"""The server's end of the Unix socket that carries the messages of a session; see LOCAL TRANSPORT in bridge.proto.

The thread of the session's game reads and writes it, so a message passes neither an event loop nor another thread.
"""

import shutil
import socket
import tempfile
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Self

from joybridge.contract.local_socket import FrameError, MessageSocket
from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb

LONGEST = 1e6  # seconds that a socket can wait, eleven days; who may wait longer waits without a limit
_NEAR = ("unix:", "ipv4:127.", "ipv6:[::1]", "ipv6:%5B::1%5D")  # how gRPC writes clients of the same machine


class LocalListener:
    """Listens for the client of one session, once. Its methods block, but for `offer`, `end` and `close`."""

    def __init__(self, largest: int, seconds: float) -> None:
        """Listen. largest: bytes of a request. seconds: how long it waits for the client. Raises OSError."""
        self._largest, self._seconds = largest, seconds
        self._lock = Lock()  # held to change what `end` ends
        self._ended = False
        self._client: MessageSocket | None = None
        self._folder = Path(tempfile.mkdtemp(prefix="joybridge-"))  # only this user may enter it
        self.path = str(self._folder / "session")
        try:
            self._listener = _listen(self.path, seconds)
        except OSError:
            shutil.rmtree(self._folder)
            raise

    @classmethod
    def offer(cls, peer: str, largest: int, seconds: float) -> Self | None:
        """Return a socket for a client with this gRPC address, or None if it cannot have one.

        largest: bytes of a request. seconds: how long it waits for the client to connect.
        """
        if not peer.startswith(_NEAR) or not hasattr(socket, "AF_UNIX"):
            return None
        try:
            return cls(largest, seconds)
        except OSError:  # such as no place for temporary files, or a path that is too long
            return None

    def accept(self) -> bool:
        """Wait for the client, take its connection and no other. Return False if the socket has been ended.

        Raises Refusal if the client does not connect in time.
        """
        try:
            connection, _ = self._listener.accept()
        except TimeoutError:
            with self._lock:
                self._stop_listening()  # before the client hears of it, so it finds nothing left
            text = f"no connection to the socket (see --start-seconds) for {self._seconds:g} s; open a new stream"
            raise Refusal(pb.REASON_IDLE, text) from None
        except OSError:
            return False
        connection.setblocking(True)
        with self._lock:
            self._client = MessageSocket(connection, self._largest)
            self._stop_listening()
            return not self._ended

    def read(self) -> pb.PlayRequest | None:
        """Return the next request, None at the end. Raises DecodeError if it is no message, Refusal if too large."""
        assert self._client is not None
        try:
            data = self._client.receive()
        except FrameError as error:
            text = f"a request of {error.size} bytes, expected at most {self._largest} bytes for this session"
            raise Refusal(pb.REASON_MESSAGE_TOO_LARGE, text) from None
        except OSError:
            return None
        return None if data is None else pb.PlayRequest.FromString(data)

    def write(self, response: pb.PlayResponse) -> bool:
        """Send a response. Return False if the client has gone."""
        assert self._client is not None
        try:
            self._client.send(response.SerializeToString())
        except OSError:
            return False
        return True

    def end(self) -> None:
        """End the connection, also for the thread that waits for the client. Nothing that was written is lost."""
        with self._lock, suppress(OSError):
            self._ended = True
            if self._client is not None:
                self._client.end()
                return
            with socket.socket(socket.AF_UNIX) as waking:  # a thread that waits for a connection hears of nothing else
                waking.setblocking(False)
                waking.connect(self.path)

    def close(self) -> None:
        """Free what the socket holds. No thread may use it any more."""
        self._stop_listening()
        if self._client is not None:
            self._client.close()

    def _stop_listening(self) -> None:
        self._listener.close()
        with suppress(OSError):
            shutil.rmtree(self._folder)


def _listen(path: str, seconds: float) -> socket.socket:
    """Return a socket that listens at a path. seconds: how long it waits for a client. Raises OSError."""
    listener = socket.socket(socket.AF_UNIX)
    try:
        listener.bind(path)
        listener.listen(1)
        listener.settimeout(seconds if seconds < LONGEST else None)
    except OSError:
        listener.close()
        raise
    return listener
