"""The server's end of the Unix socket that carries the messages of a session; see LOCAL TRANSPORT in bridge.proto.

A round trip of gRPC in Python takes several times as long as that of a socket.
"""

import asyncio
import shutil
import socket
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import grpc

from joybridge.contract.local_socket import LENGTH
from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb

_NEAR = ("unix:", "ipv4:127.", "ipv6:[::1]", "ipv6:%5B::1%5D")  # how gRPC writes clients of the same machine


class LocalSocket:
    """Listens for the client of one session, once. It is read and written like the stream of a call."""

    def __init__(self, largest: int, seconds: float) -> None:
        """Prepare a socket. largest: bytes of a request. seconds: how long it waits for the client to connect."""
        self._largest, self._seconds = largest, seconds
        self._folder = Path(tempfile.mkdtemp(prefix="joybridge-"))  # only this user may enter it
        self.path = str(self._folder / "session")
        self._server: asyncio.Server | None = None
        self._connected: asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]]
        self._connected = asyncio.get_running_loop().create_future()

    @classmethod
    async def offer(cls, peer: str, largest: int, seconds: float) -> Self | None:
        """Return a socket for a client with this gRPC address, or None if it cannot have one.

        largest: bytes of a request. seconds: how long it waits for the client to connect.
        """
        if not peer.startswith(_NEAR) or not hasattr(socket, "AF_UNIX"):
            return None
        try:
            local = cls(largest, seconds)
        except OSError:  # there is no place for temporary files
            return None
        try:
            local._server = await asyncio.start_unix_server(local._accept, local.path, start_serving=False)
            await local._server.start_serving()
        except OSError:  # such as a path that is too long
            local.close()
            return None
        except BaseException:  # the session ends
            local.close()
            raise
        return local

    async def read(self) -> Any:
        """Return the next request, or EOF.

        Raises DecodeError if it is no message, and Refusal if it is too large or the client does not connect in time.
        """
        if not self._connected.done():
            await self._wait_for_client()
        reader, _ = self._connected.result()
        try:
            (size,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
            if size > self._largest:
                text = f"a request of {size} bytes, expected at most {self._largest} bytes for this session"
                raise Refusal(pb.REASON_MESSAGE_TOO_LARGE, text)
            data = await reader.readexactly(size)
        except (asyncio.IncompleteReadError, ConnectionError):
            return grpc.aio.EOF
        return pb.PlayRequest.FromString(data)

    async def write(self, response: pb.PlayResponse) -> None:
        """Send a response. Raises ConnectionError if the client has gone."""
        _, writer = await self._connected
        data = response.SerializeToString()
        writer.write(LENGTH.pack(len(data)) + data)
        await writer.drain()

    async def _wait_for_client(self) -> None:
        try:
            async with asyncio.timeout(self._seconds):  # wait_for would lose a cancellation that comes with the client
                await self._connected
        except TimeoutError:
            text = f"no connection to the socket (see --start-seconds) for {self._seconds:g} s; open a new stream"
            raise Refusal(pb.REASON_IDLE, text) from None

    def close(self) -> None:
        """Close the socket."""
        self._stop_listening()
        if self._connected.done() and not self._connected.cancelled():
            _, writer = self._connected.result()
            writer.close()

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take the first connection and no other."""
        if self._connected.done():
            writer.close()
            return
        self._connected.set_result((reader, writer))
        self._stop_listening()

    def _stop_listening(self) -> None:
        if self._server is not None:
            self._server.close()
        with suppress(OSError):
            shutil.rmtree(self._folder)
