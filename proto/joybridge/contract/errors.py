"""The base of every exception that Joybridge raises on purpose."""

__all__ = ["JoybridgeError"]


class JoybridgeError(Exception):
    """The base class: `except JoybridgeError` catches what any part of Joybridge raises on purpose."""
