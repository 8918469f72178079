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


class Pace:
    """Whether a page lets what it watches run: it may stop that while a game is lost, and before there is one."""

    def __init__(self, page: ServerConnection) -> None:
        """Let it run."""
        self.running = True
        self._page = page

    def wait(self, due: float) -> None:
        """Wait until a time, or until the page sends something."""
        try:
            message = read_message(self._page.recv(max(0.0, due - time.monotonic())), None)
        except (TimeoutError, MessageError):
            return
        if isinstance(message, Clock):
            self.running = message.running
