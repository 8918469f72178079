"""Who may call a server: encryption, the token, and calls whose bytes are no message."""

import hmac
import inspect
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import grpc
from google.protobuf.message import DecodeError

from joybridge.contract.address import is_local
from joybridge.contract.credentials import AUTHORIZATION, CredentialsError, bearer, read_pem, read_token
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.statuses import status
from joybridge.contract.text import printable
from joybridge.v1 import bridge_pb2 as pb

HEALTH = "/grpc.health.v1.Health/"  # load balancers call it without a token


class ServerCredentialsError(JoybridgeError):
    """A server would be open to strangers, or cannot be protected as asked for."""


@dataclass(frozen=True)
class ServerCredentials:
    """What a client needs to call a server: its certificate, the token, both or nothing."""

    certificate: bytes | None = None  # PEM, with the chain; None: no TLS
    key: bytes = field(default=b"", repr=False)
    token: str = field(default="", repr=False)

    def bind(self, server: Any, address: str) -> int:
        """Make a grpc.aio server listen on an address and return the port. Raises RuntimeError."""
        if self.certificate is None:
            return int(server.add_insecure_port(address))
        credentials = grpc.ssl_server_credentials([(self.key, self.certificate)])
        return int(server.add_secure_port(address, credentials))


def load_server_credentials(
    address: str, certificate: Path | None, key: Path | None, token: Path | None
) -> ServerCredentials:
    """Read the files of a server's protection.

    Raises ServerCredentialsError if an address needs more, CredentialsError, OSError.
    """
    if (certificate is None) != (key is None):
        raise ServerCredentialsError("TLS needs both --tls-cert and --tls-key")
    if not is_local(address) and (certificate is None or token is None):
        raise ServerCredentialsError(
            f"{address} can be reached from other machines, which needs --tls-cert, --tls-key and --token-file; "
            "give them, or listen on 127.0.0.1 or unix:PATH"
        )
    secret = "" if token is None else read_token(token)
    if certificate is None or key is None:
        return ServerCredentials(token=secret)
    return ServerCredentials(*_read_pair(certificate, key), secret)


def _read_pair(certificate: Path, key: Path) -> tuple[bytes, bytes]:
    """Return the contents of both files. Raises CredentialsError unless TLS can use them together."""
    pair = read_pem(certificate, "CERTIFICATE"), read_pem(key, "PRIVATE KEY")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        raise CredentialsError(
            f"{certificate} and {key} are no certificate and its key without a password ({reason}); make both again"
        ) from error
    return pair


def _no_password() -> str:
    """Answer instead of a person: a server cannot ask for the password of its key."""
    raise ValueError("the key has a password")


class TokenInterceptor(grpc.aio.ServerInterceptor):  # type: ignore[misc]  # gRPC has no types
    """Refuses calls without the token (UNAUTHENTICATED) and bytes that are no message (INVALID_ARGUMENT)."""

    def __init__(self, token: str) -> None:
        """Require the token for every call but health; "": none."""
        self._wanted = bearer(token).encode() if token else b""

    async def intercept_service(self, continuation: Callable[[Any], Awaitable[Any]], call: Any) -> Any:
        """Return the handler of a call; gRPC calls this for each."""
        if self._wanted and not call.method.startswith(HEALTH) and not self._has_token(call.invocation_metadata):
            return grpc.stream_stream_rpc_method_handler(_refuse)
        handler = await continuation(call)
        return handler and _checking_messages(handler)

    def _has_token(self, metadata: Any) -> bool:
        sent = [value for key, value in metadata if key == AUTHORIZATION]
        return len(sent) == 1 and hmac.compare_digest(sent[0].encode(), self._wanted)


async def _refuse(requests: Any, context: Any) -> None:
    text = "this server requires a token; give the client its file with --token-file"
    await context.abort(*status(pb.REASON_NO_TOKEN, text))


def _checking_messages(handler: Any) -> Any:
    """Return a handler that refuses bytes that are no message. By default gRPC logs a traceback and sends UNKNOWN."""

    def parse(data: bytes) -> Any:
        try:
            return handler.request_deserializer(data)
        except DecodeError as error:
            return error

    async def unary(request: Any, context: Any) -> Any:
        await _check(request, context)
        method = handler.unary_stream if handler.response_streaming else handler.unary_unary
        return await method(request, context)

    async def stream(requests: Any, context: Any) -> AsyncIterator[Any]:
        async def checked() -> AsyncIterator[Any]:
            async for request in requests:
                await _check(request, context)
                yield request

        async for response in handler.stream_stream(checked(), context):
            yield response

    if not handler.request_streaming:
        make = (
            grpc.unary_stream_rpc_method_handler if handler.response_streaming else grpc.unary_unary_rpc_method_handler
        )
        return make(unary, parse, handler.response_serializer)
    if inspect.isasyncgenfunction(handler.stream_stream):  # reflection; Play reads its requests itself
        return grpc.stream_stream_rpc_method_handler(stream, parse, handler.response_serializer)
    return handler


async def _check(request: Any, context: Any) -> None:
    if isinstance(request, DecodeError):
        text = printable(f"the request is not a message of this method: {request}")
        await context.abort(*status(pb.REASON_MALFORMED_MESSAGE, text))
