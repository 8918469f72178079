"""What goes wrong between a trainer and its simulators.

SimulatorError            a simulator refused a request, failed, or broke the contract
├── NoSuchGame            a simulator does not have the game
└── SimulatorLost         a simulator cannot be reached or went away; training can be resumed once it is back
    └── SimulatorShutDown it announced its end, as the contract asks for
"""

from typing import Any

import grpc

from joybridge.contract.errors import JoybridgeError
from joybridge.contract.statuses import details_of
from joybridge.contract.text import printable

__all__ = ["NoSuchGame", "SimulatorError", "SimulatorLost", "SimulatorShutDown"]

_UNANSWERED = ("ping timeout", "keepalive")  # what gRPC says of a connection whose pings are not answered
_LOST = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED, grpc.StatusCode.DEADLINE_EXCEEDED)


class SimulatorError(JoybridgeError):
    """A simulator refused a request, failed, or sent something that breaks the contract.

    `reason` is the name of a Reason in bridge.proto without REASON_, such as "UNKNOWN_GAME", and `field` the path of
    the wrong field of the request. Either is "" if the simulator did not send it.
    """

    reason = ""
    field = ""


class SimulatorLost(SimulatorError):
    """A simulator cannot be reached or went away."""


class NoSuchGame(SimulatorError):
    """A simulator does not have the game."""


class SimulatorShutDown(SimulatorLost):
    """A simulator announced that it is shutting down."""


def from_grpc(error: Any, address: str) -> SimulatorError:
    """Return the error to raise for a grpc.RpcError."""
    code, text = error.code(), printable(error.details() or "without a reason")
    reason, field = details_of(error)
    made: SimulatorError
    if code in _LOST:
        # gRPC itself reports a lost connection as UNAVAILABLE, too. Servers need not send a reason beside the sentence.
        if any(words in text for words in _UNANSWERED):
            text = "it does not even answer pings; it was stopped, or its machine or the connection to it is gone"
        lost = SimulatorShutDown if reason == "SHUTTING_DOWN" or "shutting down" in text else SimulatorLost
        made = lost(f"lost the simulator at {address}: {text} ({code.name})")
    else:
        kind = NoSuchGame if code is grpc.StatusCode.NOT_FOUND else SimulatorError
        made = kind(f"error from the simulator at {address}: {text} ({code.name})")
    made.reason, made.field = reason, field
    return made
