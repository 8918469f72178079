"""Addresses of simulators: how command lines take them, and the line with which a server reports its own."""

import argparse

__all__ = ["DEFAULT_ADDRESS", "READY", "address"]

DEFAULT_ADDRESS = "127.0.0.1:5005"
READY = "joybridge simulator listening on "  # a server prints this and its address as one line once it can be reached
_HIGHEST_PORT = 65535


def address(text: str) -> str:
    """Return an address, HOST:PORT or unix:PATH, unchanged. Raises ArgumentTypeError for a malformed one."""
    host, _, port = text.rpartition(":")
    if text.startswith("unix:") or (host and port.isdecimal() and int(port) <= _HIGHEST_PORT):
        return text
    wanted = f"HOST:PORT with a port from 0 to {_HIGHEST_PORT}, as in {DEFAULT_ADDRESS}, or unix:PATH"
    raise argparse.ArgumentTypeError(f"got {text!r}, expected {wanted}")
