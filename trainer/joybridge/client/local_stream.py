"""The rest of a session over a Unix socket, with the interface of `ClientStream`.

See LOCAL TRANSPORT in bridge.proto.
"""

import time
from contextlib import suppress

from joybridge.client.errors import SimulatorError
from joybridge.client.responses import Reader, parse
from joybridge.client.stream import ClientStream
from joybridge.contract.local_socket import FrameError, LocalSocket
from joybridge.v1 import bridge_pb2 as pb

LOOK_SECONDS = 0.25  # without a message, until a wait looks at the stream


class LocalStream:
    """The messages of a session that a Play stream has started. All methods block. An interrupt loses a message."""

    def __init__(self, stream: ClientStream, reader: Reader, path: str, largest: int) -> None:
        """Connect to the socket of the session. largest: bytes of a response. Raises OSError."""
        self._stream, self._reader = stream, reader
        self._socket = LocalSocket(path, largest)
        self._pending: pb.PlayRequest | None = None  # whose response is on its way

    def send(self, request: pb.PlayRequest) -> None:
        """Send a request without waiting for the response; `receive` returns it."""
        if self._pending is not None:
            self.receive()  # a response that was not received, because an interrupt came after `send`, is dropped
        if self._socket.unread:
            raise self._reader.surplus()
        self._pending = request
        try:
            self._socket.send(request.SerializeToString(), self._reader.seconds)
        except TimeoutError:
            raise self._reader.too_late(request) from None
        except OSError:
            pass  # the session has ended; receiving raises the reason

    def receive(self) -> pb.PlayResponse:
        """Return the response to the last `send`. Raises SimulatorError."""
        request, self._pending = self._pending, None
        if request is None:
            raise SimulatorError("receive() without send(): no response is on its way")
        data = None
        try:
            data = self._wait()
        except TimeoutError:
            raise self._reader.too_late(request) from None
        except FrameError as error:
            raise SimulatorError(f"the simulator at {self._stream.address} broke the contract: {error}") from error
        except OSError:
            pass  # the session has ended
        if data is None:
            raise self._stream.reason(request)
        return parse(pb.PlayResponse, data, self._stream.address)

    def ask(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Send a request and return its response. Raises SimulatorError."""
        self.send(request)
        return self.receive()

    def _wait(self) -> bytes | None:
        """Return the next message, None if the session has ended. Raises TimeoutError, FrameError and OSError.

        The socket of a process that was stopped stays open. The stream, whose server answers pings, then ends.
        """
        until = time.monotonic() + self._reader.seconds
        while True:
            left = until - time.monotonic()
            try:
                return self._socket.receive(min(left, LOOK_SECONDS))
            except TimeoutError:
                if left <= LOOK_SECONDS:
                    raise
                if self._stream.has_ended():
                    return None

    def close(self) -> None:
        """End the session. Finalizers may call this."""
        with suppress(OSError):
            self._socket.close()
        self._stream.close()
