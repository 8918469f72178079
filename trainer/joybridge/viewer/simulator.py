"""Where sessions are opened: at a running simulator, or at one that is started here, again whenever it is lost."""

from collections.abc import Sequence
from contextlib import ExitStack
from threading import Lock
from typing import Self

from joybridge.client.client import wait_for
from joybridge.client.errors import SimulatorLost
from joybridge.client.launch import simulator_process

ANSWER_SECONDS = 1.0  # for a simulator to answer


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
                    wait_for(self._address, ANSWER_SECONDS, lambda text: None)
                    return self._address
                except SimulatorLost:
                    if self._given is not None:
                        raise
            self._started.close()
            self._address = None  # until another one answers
            self._address = self._started.enter_context(simulator_process(self._games))
            return self._address

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._started.close()
