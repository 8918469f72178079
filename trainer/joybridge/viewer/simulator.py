"""Where sessions are opened: at a running simulator, or at one that is started here, again whenever it is lost."""

from collections.abc import Sequence
from contextlib import ExitStack
from threading import Lock
from typing import Self

from joybridge.client.client import wait_for
from joybridge.client.errors import SimulatorLost
from joybridge.client.launch import simulator_process
from joybridge.client.reachability import why_closed

ANSWER_SECONDS = 1.0  # for a simulator to answer
BUSY_SECONDS = 10.0  # the same, before games that others may play are given up


class Simulator:
    """The simulator of all pages; the end of the block ends one that was started here."""

    def __init__(self, address: str | None, games: Sequence[str]) -> None:
        """address: of one that is running, with its credentials; None: start one, with further games MODULE:CLASS."""
        self._given, self._games = address, games
        self._started = ExitStack()
        self._address = address
        self._lock = Lock()  # pages have threads of their own

    def reach(self) -> str:
        """Return the address at which the simulator answers. Raises SimulatorLost."""
        with self._lock:
            if self._address is not None:
                try:
                    wait_for(self._address, self._patience(self._address), lambda text: None)
                    return self._address
                except SimulatorLost:
                    if self._given is not None:
                        raise
            self._started.close()
            self._address = None  # until another one answers
            self._address = self._started.enter_context(simulator_process(self._games))
            return self._address

    def _patience(self, address: str) -> float:
        """Return how long to wait: longer for one that was started here and lives, as others may play there."""
        host, _, port = address.rpartition(":")
        return BUSY_SECONDS if self._given is None and not why_closed(host, int(port)) else ANSWER_SECONDS

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._started.close()
