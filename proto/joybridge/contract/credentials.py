"""What a client needs to call a protected server: the certificate to trust, and a token. See SECURITY in bridge.proto.

credentials = load_credentials(tls_ca=Path("server.pem"), token_file=Path("token"))
with credentials.channel("games.example:5005") as channel:
    stub = SimulatorServiceStub(channel)
    stub.ListGames(ListGamesRequest(), metadata=credentials.metadata)

A trainer and the environments take the credentials of a simulator with its address:

env = BridgeEnv("archer", simulator=ProtectedAddress("games.example:5005", credentials))
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import grpc

from joybridge.contract.errors import JoybridgeError

__all__ = [
    "AUTHORIZATION",
    "NO_COMPRESSION",
    "Credentials",
    "CredentialsError",
    "ProtectedAddress",
    "add_credentials_arguments",
    "bearer",
    "credentials_of",
    "load_credentials",
    "read_token",
]

AUTHORIZATION = "authorization"  # the metadata key of the token
# Both ends refuse compressed messages: a megabyte of gzip can hold a gigabyte, which gRPC unpacks before it looks at
# the limit of a message.
NO_COMPRESSION = ("grpc.compression_enabled_algorithms_bitset", 1)
# By default, channels to one address share a connection: a call after the loss of a simulator would go into the
# connection on which it was lost.
_OWN_CONNECTION = ("grpc.use_local_subchannel_pool", 1)
_MIN_CHARS, _MAX_CHARS = 16, 1000  # characters of a token


class CredentialsError(JoybridgeError):
    """The file of a token or certificate cannot be used. The message names the file, never its content."""


@dataclass(frozen=True)
class Credentials:
    """How a client calls a server: with TLS, a token, both or neither."""

    certificates: bytes = b""  # PEM: the server's own certificate or its authority's; empty: no TLS
    token: str = field(default="", repr=False)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """The metadata of every call; empty without a token."""
        return ((AUTHORIZATION, bearer(self.token)),) if self.token else ()

    def channel(self, address: str, options: Sequence[tuple[str, Any]] = ()) -> Any:
        """Return a grpc.Channel to a server."""
        return self._channel(grpc, address, options)

    def aio_channel(self, address: str, options: Sequence[tuple[str, Any]] = ()) -> Any:
        """Return a grpc.aio.Channel to a server."""
        return self._channel(grpc.aio, address, options)

    def _channel(self, library: Any, address: str, options: Sequence[tuple[str, Any]]) -> Any:
        options = [NO_COMPRESSION, _OWN_CONNECTION, *options]
        if not self.certificates:
            return library.insecure_channel(address, options)
        return library.secure_channel(address, grpc.ssl_channel_credentials(self.certificates), options)


class ProtectedAddress(str):
    """The address of a server together with the credentials that its clients need.

    It is a string, so all code that handles addresses handles it too. Only the code that calls the server takes the
    credentials from it, with `credentials_of`.
    """

    credentials: Credentials

    def __new__(cls, address: str, credentials: Credentials) -> Self:
        """Make one from HOST:PORT or unix:PATH."""
        protected = super().__new__(cls, address)
        protected.credentials = credentials
        return protected


def credentials_of(address: str) -> Credentials:
    """Return the credentials of an address; of a plain string, those without TLS and token."""
    return address.credentials if isinstance(address, ProtectedAddress) else Credentials()


def add_credentials_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options --tls-ca and --token-file of a client."""
    parser.add_argument(
        "--tls-ca",
        type=Path,
        metavar="FILE",
        help="connect with TLS, and trust the server certificates that this PEM file holds or has signed",
    )
    parser.add_argument("--token-file", type=Path, metavar="FILE", help="the file of the server's token")


def load_credentials(tls_ca: Path | None = None, token_file: Path | None = None) -> Credentials:
    """Read the files of a client. Raises CredentialsError."""
    return Credentials(_read(tls_ca) if tls_ca else b"", read_token(token_file) if token_file else "")


def read_token(path: Path) -> str:
    """Return the token in a file, without the end of its line. Raises CredentialsError, which never shows the token."""
    token = _read(path).strip()
    if not _MIN_CHARS <= len(token) <= _MAX_CHARS or not all(33 <= byte <= 126 for byte in token):
        raise CredentialsError(
            f"{path} holds no token, expected one line of {_MIN_CHARS} to {_MAX_CHARS} ASCII characters without "
            f"spaces; make one with `openssl rand -hex 32 > {path}`"
        )
    return token.decode()


def bearer(token: str) -> str:
    """Return the value of the metadata key `authorization` for a token."""
    return f"Bearer {token}"


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(1 << 20)
    except OSError as error:
        raise CredentialsError(f"cannot read {path}: {error.strerror}") from error
