"""Where pages play: one page alone, or several that hold a seat each of the same arena."""

import time
from contextlib import suppress
from queue import Empty, Queue
from threading import Lock
from typing import NamedTuple

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection

from joybridge.viewer.messages import waiting_message

TAKEN = 4001  # the code with which the WebSocket of a page is closed that has found no place
UNREAD = 64  # messages that are kept until they are received; a page that sends more waits


class Received(NamedTuple):
    """A message of the page at a place."""

    place: int
    data: str | bytes


class PageLeft(Exception):
    """A page has gone away, so its place is free."""


class Room:
    """The places of the pages that play together.

    Every page has a thread, which calls `enter`; another thread plays, and calls all other methods.
    """

    def __init__(self, places: int) -> None:
        """Begin without any page."""
        self.places = places
        self._seated: list[ServerConnection | None] = [None] * places
        self._playing: list[ServerConnection] = []  # those with which the present game began
        # None instead of a message: the page has come, or gone away.
        self._received: Queue[tuple[ServerConnection, str | bytes | None]] = Queue(UNREAD)
        self._lock = Lock()

    def enter(self, page: ServerConnection) -> None:
        """Take the messages of a page until it goes away; send it away at once if no place is free."""
        with self._lock:
            place = self._seated.index(None) if None in self._seated else None
            if place is not None:
                self._seated[place] = page
        if place is None:
            page.close(TAKEN, f"All {self.places} places are taken. This page takes the next one that is free.")
            return
        try:
            self._received.put((page, None))
            for data in page:
                self._received.put((page, data))
        finally:
            self._seated[place] = None
            self._received.put((page, None))

    def gather(self) -> None:
        """Wait until all places are taken; those who wait learn how many are. Raises PageLeft if the only one has."""
        told: list[ServerConnection | None] = []
        while None in (seated := list(self._seated)):
            self._playing = [page for page in seated if page is not None]
            if seated != told:  # a page answers each of these messages
                self.send_all(waiting_message(len(self._playing), self.places))
                told = seated
            page, _ = self._received.get()
            if self.places == 1 and page not in self._seated:
                raise PageLeft
        self._playing = [page for page in seated if page is not None]

    def send(self, place: int, message: str | bytes) -> None:
        """Send a message to the page at a place."""
        with suppress(ConnectionClosed):  # `receive` says so
            self._playing[place].send(message)

    def send_all(self, message: str | bytes) -> None:
        """Send a message to all pages."""
        for place in range(len(self._playing)):
            self.send(place, message)

    def receive(self, seconds: float | None) -> Received:
        """Return the next message. Raises TimeoutError after so many seconds, and PageLeft."""
        end = None if seconds is None else time.monotonic() + seconds
        while True:
            try:
                page, data = self._received.get(timeout=None if end is None else max(0.0, end - time.monotonic()))
            except Empty:
                raise TimeoutError from None
            if page not in self._playing:
                continue  # it has gone away before the present game began
            if data is not None:
                return Received(self._playing.index(page), data)
            if page not in self._seated:
                raise PageLeft

    def close(self) -> None:
        """Close all pages, as nobody plays any more."""
        for page in self._seated:
            if page is not None:
                page.close()
