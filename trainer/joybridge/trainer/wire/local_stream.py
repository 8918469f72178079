"""The rest of a session over a Unix socket, with the interface of `Stream`. See LOCAL TRANSPORT in bridge.proto."""

from contextlib import suppress

from joybridge.contract.local_socket import FrameError, LocalSocket
from joybridge.trainer.wire.errors import SimulatorError
from joybridge.trainer.wire.exchange import Wait
from joybridge.trainer.wire.stream import Stream, parse
from joybridge.v1 import bridge_pb2 as pb


class LocalStream:
    """The messages of a session that a Play stream has started. All methods block. An interrupt loses a message."""

    def __init__(self, stream: Stream, wait: Wait, path: str, largest: int) -> None:
        """Connect to the socket of the session. largest: bytes of a response. Raises OSError."""
        self._stream, self._wait = stream, wait
        self._socket = LocalSocket(path, largest)
        self._pending = False  # whether the response to the last `send` is on its way

    def send(self, request: pb.PlayRequest) -> None:
        """Send a request without waiting for the response; `receive` returns it."""
        if self._pending:
            self.receive()  # a response that was not received, because an interrupt came after `send`, is dropped
        if self._socket.unread:
            raise self._wait.surplus()
        self._wait.note(request)
        self._pending = True
        try:
            self._socket.send(request.SerializeToString(), self._wait.seconds)
        except TimeoutError:
            raise self._wait.too_late() from None
        except OSError:
            pass  # the session has ended; receiving raises the reason

    def receive(self) -> pb.PlayResponse:
        """Return the response to the last `send`. Raises SimulatorError."""
        if not self._pending:
            raise SimulatorError("receive() without send(): no response is on its way")
        self._pending = False
        data = None
        try:
            data = self._socket.receive(self._wait.seconds)
        except TimeoutError:
            raise self._wait.too_late() from None
        except FrameError as error:
            raise SimulatorError(f"the simulator at {self._stream.address} broke the contract: {error}") from error
        except OSError:
            pass  # the session has ended
        if data is None:
            raise self._stream.reason()
        return parse(pb.PlayResponse, data, self._stream.address)

    def ask(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Send a request and return its response. Raises SimulatorError."""
        self.send(request)
        return self.receive()

    def close(self) -> None:
        """End the session. Finalizers may call this."""
        with suppress(OSError):
            self._socket.close()
        self._stream.close()
