"""The pace of what a page watches, which it may hold."""

import time

from websockets.sync.server import ServerConnection

from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.messages import Clock, MessageError, read_message

LOOK_SECONDS = 2.0  # between two looks at what may have changed
SLOWEST = 0.5  # s between decisions of a game without a clock


def interval(spec: pb.GameSpec) -> float:
    """Return the seconds between two decisions."""
    return spec.tick_seconds * spec.decision_interval or SLOWEST


def pause(page: ServerConnection, due: float, running: bool) -> bool:
    """Wait until a time, or until the page sends something; return whether it lets the game run."""
    try:
        message = read_message(page.recv(max(0.0, due - time.monotonic())), None)
    except TimeoutError:
        return running
    except MessageError:
        return running
    return message.running if isinstance(message, Clock) else running
