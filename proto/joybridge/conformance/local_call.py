"""A Play stream whose messages go over the Unix socket of its session; see LOCAL TRANSPORT in bridge.proto."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread
from typing import Any, Self

from joybridge.conformance.expectations import Unreachable
from joybridge.contract.local_socket import LocalSocket
from joybridge.v1 import bridge_pb2 as pb

MAX_RESPONSE = 1 << 30  # bytes of a response: the checks look at sizes themselves


class LocalCall:
    """The responses of a Play stream, an iterator like gRPC's. It raises grpc.RpcError if the stream ends with one.

    What is sent before a session has started, such as a wrong Start, goes over the stream.
    """

    def __init__(self, open_stream: Callable[[Iterator[Any]], Any], requests: Iterator[Any], seconds: float) -> None:
        """Open the stream. `seconds` is the longest wait for a response."""
        self._requests, self._seconds = requests, seconds
        self._over_stream: SimpleQueue[Any] = SimpleQueue()
        self._responses = open_stream(iter(self._over_stream.get, None))
        self._socket: LocalSocket | None = None
        self._begun = False

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> pb.PlayResponse:
        if not self._begun:
            self._begun = True
            return self._begin()
        if self._socket is not None:
            with suppress(OSError):  # the session has ended
                if (data := self._socket.receive(self._seconds)) is not None:
                    return pb.PlayResponse.FromString(data)
            self._socket.close()
        response: pb.PlayResponse = next(self._responses)
        return response

    def cancel(self) -> None:
        """End the stream and the session."""
        self._responses.cancel()
        self._over_stream.put(None)
        if self._socket is not None:
            with suppress(OSError):
                self._socket.end()
            self._socket.close()

    def _begin(self) -> pb.PlayResponse:
        """Send the first request, and start a thread for the others. Raises Unreachable if there is no socket."""
        request = next(self._requests, None)
        if starts := isinstance(request, pb.PlayRequest) and request.HasField("start"):
            request = pb.PlayRequest(start=request.start)
            request.start.local_transport = True
        self._over_stream.put(request)
        response: pb.PlayResponse = next(self._responses)
        if starts:
            if not response.started.local_socket:
                raise Unreachable("the server offers no local transport; check it without --transport local")
            self._socket = LocalSocket(response.started.local_socket, MAX_RESPONSE)
        Thread(target=self._send, daemon=True).start()
        return response

    def _send(self) -> None:
        for request in self._requests:
            data = request if isinstance(request, bytes) else request.SerializeToString()
            if self._socket is None:
                self._over_stream.put(request)
                continue
            try:
                self._socket.send(data, self._seconds)
            except OSError:  # the session has ended; its status says why
                return
        if self._socket is None:
            self._over_stream.put(None)
        else:
            with suppress(OSError):
                self._socket.half_close()
