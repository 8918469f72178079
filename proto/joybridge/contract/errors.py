"""The bases of the exceptions that Joybridge raises on purpose."""

import re

from joybridge.v1 import bridge_pb2 as pb

__all__ = ["JoybridgeError", "MessageError"]


class JoybridgeError(Exception):
    """The base class: `except JoybridgeError` catches what any part of Joybridge raises on purpose."""

    exit_status = 1  # of a command that ends with it

    @property
    def code(self) -> str:
        """What went wrong, as a word for programs that stays the same: the class as in CONFIG for a ConfigError."""
        words: list[str] = re.findall("[A-Z][a-z]+", type(self).__name__.removesuffix("Error"))
        return "_".join(words).upper()


class MessageError(JoybridgeError, ValueError):
    """The content of a message breaks the contract. The text names the field, what came and what was expected.

    `reason` says for programs what is wrong with a request; it is REASON_UNSPECIFIED for what servers send. `field` is
    the path of the field in the message that was checked, "" if it is not known.
    """

    def __init__(self, text: str, reason: "pb.Reason" = pb.REASON_UNSPECIFIED, field: str = "") -> None:
        super().__init__(text)
        self.reason, self.field = reason, field
