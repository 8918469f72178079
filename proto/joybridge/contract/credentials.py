"""What a client needs to call a protected server: the certificate to trust, and a token. See SECURITY in bridge.proto.

credentials = load_credentials(tls_ca=Path("server.pem"), token_file=Path("token"))
with credentials.channel("games.example:5005") as channel:
    stub = SimulatorServiceStub(channel)
    stub.ListGames(ListGamesRequest(), metadata=credentials.metadata)

A trainer and the environments take the credentials of a simulator with its address:

env = BridgeEnv("archer", simulator=ProtectedAddress("games.example:5005", credentials))
"""

import argparse
import os
import ssl
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import grpc

from joybridge.contract.address import is_local
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.files import read_file

__all__ = [
    "AUTHORIZATION",
    "NO_COMPRESSION",
    "Credentials",
    "CredentialsError",
    "ProtectedAddress",
    "add_credentials_arguments",
    "bearer",
    "check_credentials",
    "credentials_of",
    "load_credentials",
    "read_pem",
    "read_token",
]

AUTHORIZATION = "authorization"  # the metadata key of the token
# Both ends refuse compressed messages: a megabyte of gzip can hold a gigabyte, which gRPC unpacks before it looks at
# the limit of a message.
NO_COMPRESSION = ("grpc.compression_enabled_algorithms_bitset", 1)
# By default, channels to one address share a connection: a call after the loss of a simulator would go into the
# connection on which it was lost.
_OWN_CONNECTION = ("grpc.use_local_subchannel_pool", 1)
MIN_TOKEN_CHARS, MAX_TOKEN_CHARS = 16, 1000
MAX_FILE_BYTES = 2**20  # of a token, a certificate or a key


class CredentialsError(JoybridgeError):
    """A token or certificate cannot be used. The message names its file or where it would go, never its content."""


@dataclass(frozen=True)
class Credentials:
    """How a client calls a server: with TLS, a token, both or neither."""

    certificates: bytes | None = None  # PEM: the server's own certificate or its authority's; None: no TLS
    token: str = field(default="", repr=False)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """The metadata of every call; empty without a token."""
        return ((AUTHORIZATION, bearer(self.token)),) if self.token else ()

    def check(self, address: str) -> None:
        """Raise CredentialsError if the token would travel to a server in clear text."""
        if self.token and self.certificates is None and not _stays_here(address):
            raise CredentialsError(
                f"the token would travel to {address} in clear text; let that server use TLS, and give its certificate "
                "with --tls-ca"
            )

    def channel(self, address: str, options: Sequence[tuple[str, Any]] = ()) -> Any:
        """Return a grpc.Channel to a server. Raises CredentialsError if the token would travel in clear text."""
        return self._channel(grpc, address, options)

    def aio_channel(self, address: str, options: Sequence[tuple[str, Any]] = ()) -> Any:
        """Return a grpc.aio.Channel to a server. Raises CredentialsError if the token would travel in clear text."""
        return self._channel(grpc.aio, address, options)

    def _channel(self, library: Any, address: str, options: Sequence[tuple[str, Any]]) -> Any:
        # A proxy of the environment would see what must not leave this machine, and could not reach it either.
        proxy = [("grpc.enable_http_proxy", 0)] if _stays_here(address) else []
        options = [NO_COMPRESSION, _OWN_CONNECTION, *proxy, *options]
        self.check(address)
        if self.certificates is None:
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


def add_credentials_arguments(parser: argparse._ActionsContainer) -> None:
    """Add the options --tls-ca and --token-file of a client."""
    parser.add_argument(
        "--tls-ca",
        type=Path,
        metavar="FILE",
        help="connect with TLS, and trust the server certificates that this PEM file holds or has signed",
    )
    parser.add_argument("--token-file", type=Path, metavar="FILE", help="the file of the server's token")


def check_credentials(parser: argparse.ArgumentParser, options: argparse.Namespace, simulator: object) -> None:
    """End the program with an error if there are credentials and no running simulator that they are for."""
    if (options.tls_ca or options.token_file) and not simulator:
        parser.error("--tls-ca and --token-file belong to a running simulator; name it with --simulator")


def load_credentials(tls_ca: Path | None = None, token_file: Path | None = None) -> Credentials:
    """Read the files of a client. Raises CredentialsError."""
    certificates = None if tls_ca is None else _read_certificates(tls_ca)
    return Credentials(certificates, "" if token_file is None else read_token(token_file))


def read_token(path: Path) -> str:
    """Return the token in a file, without the end of its line. Raises CredentialsError, which never shows the token."""
    token = _read(path).strip()
    status = path.stat()
    if os.name == "posix" and status.st_uid == os.getuid() and status.st_mode & 0o077:  # as ssh does with keys
        raise CredentialsError(f"{path} holds a token that other users can read; keep it with `chmod 600 {path}`")
    right_size = MIN_TOKEN_CHARS <= len(token) <= MAX_TOKEN_CHARS
    if not right_size or not all(33 <= byte <= 126 for byte in token):
        raise CredentialsError(
            f"{path} holds no token, expected one line of {MIN_TOKEN_CHARS} to {MAX_TOKEN_CHARS} ASCII characters "
            f"without spaces; make one with `(umask 077; openssl rand -hex 32 > {path})`"
        )
    return token.decode()


def read_pem(path: Path, kind: str) -> bytes:
    """Return a PEM file that has at least one block of a kind, such as "CERTIFICATE". Raises CredentialsError."""
    content = _read(path)
    begin, end = f"{kind}-----".encode(), b"-----END "
    if begin not in content or content.count(b"-----BEGIN ") != content.count(end):
        raise CredentialsError(
            f"{path} holds no {kind.lower()} in PEM, expected blocks from -----BEGIN to -----END; write the file again"
        )
    return content


def _read_certificates(path: Path) -> bytes:
    """Return the certificates that a client trusts. Raises CredentialsError."""
    content = read_pem(path, "CERTIFICATE")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(cadata=content.decode("ascii", "replace"))
    except ssl.SSLError as error:
        raise CredentialsError(f"{path} holds a damaged certificate ({error.reason}); get a new copy") from error
    return content


def bearer(token: str) -> str:
    """Return the value of the metadata key `authorization` for a token."""
    return f"Bearer {token}"


def _stays_here(address: str) -> bool:
    """Return whether what is sent to an address cannot leave this machine; no, if its host is unknown."""
    try:
        return is_local(address)
    except OSError:
        return False


def _read(path: Path) -> bytes:
    try:
        return read_file(path, MAX_FILE_BYTES)
    except OSError as error:
        raise CredentialsError(f"cannot read {path}: {error.strerror}") from error
