"""Addresses of simulators: how command lines take them, and the line with which a server reports its own."""

import argparse
import re
import socket
from ipaddress import ip_address

__all__ = ["DEFAULT_ADDRESS", "READY", "address", "is_address", "is_local"]

DEFAULT_ADDRESS = "127.0.0.1:5005"
READY = "joybridge simulator listening on "  # a server prints this and its address as one line once it can be reached
_HIGHEST_PORT = 65535


def address(text: str) -> str:
    """Return an address, HOST:PORT or unix:PATH, unchanged. Raises ArgumentTypeError for a malformed one."""
    host, _, port = text.rpartition(":")
    named = text.startswith("unix:") and text != "unix:"
    if named and not hasattr(socket, "AF_UNIX"):
        raise argparse.ArgumentTypeError(f"got {text!r}, but Python has no Unix sockets on this system; use HOST:PORT")
    if named or (host and host != "unix" and port.isdecimal() and int(port) <= _HIGHEST_PORT):
        return text
    wanted = f"HOST:PORT with a port from 0 to {_HIGHEST_PORT}, as in {DEFAULT_ADDRESS}, or unix:PATH"
    raise argparse.ArgumentTypeError(f"got {text!r}, expected {wanted}")


def is_address(text: str) -> bool:
    """Return whether a text is the address of a simulator, and no name of a game."""
    return text.startswith("unix:") or re.fullmatch(r".+:\d+", text) is not None


def is_local(address: str) -> bool:
    """Return whether only programs on this machine can connect to an address. Raises OSError for an unknown host."""
    if address.startswith("unix:"):
        return True
    host = address.rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        found = {str(place[0]) for *_, place in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError) as error:  # UnicodeError: no name of a host can be written so
        raise OSError(f"there is no host {host!r}: {getattr(error, 'strerror', error)}") from error
    return all(ip_address(one.partition("%")[0]).is_loopback for one in found)
