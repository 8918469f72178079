"""A page of `joybridge play` as the tests open it: its socket, and what it sends and receives."""

import json
from contextlib import contextmanager
from urllib.parse import urlsplit

from websockets.sync.client import connect

from joybridge.viewer.arena import Settings
from joybridge.viewer.page_session import PageGame, welcome
from joybridge.viewer.web import open_website
from tests.support.wire import SECONDS

SETTINGS = Settings(seed=3, options={}, parameters={})


class Page:
    """What a page does, without a browser."""

    def __init__(self, url, **headers):
        place = urlsplit(url)
        self._socket = connect(
            f"ws://{place.netloc}{place.path}socket",
            origin=headers.pop("origin", f"http://{place.netloc}"),
            additional_headers=headers,
            compression=None,
        ).__enter__()
        self.id = 0

    def send(self, kind, **values):
        self._socket.send(json.dumps({"type": kind, **values}))

    def send_anything(self, data):
        self._socket.send(data)

    def take(self, *kinds):
        """Return the next message of one of these types; a turn has its picture."""
        return self.take_within(SECONDS, *kinds)

    def take_within(self, seconds, *kinds):
        """Return the next message of one of these types, each of which comes within so many seconds."""
        while True:
            message = json.loads(self._socket.recv(seconds))
            for drawn in (message, message.get("rival")) if message["type"] == "turn" else ():
                if drawn:
                    drawn["pictures"] = [self._socket.recv(SECONDS) for _ in range(drawn["pictures"])]
            if message["type"] in kinds:
                return message

    def begin(self):
        """Return the game and the first turn."""
        self.game = self.take("game")
        self.turn = self.take("turn")
        return self.game, self.turn

    def act(self, axes, choices, *, decide=True, seat=None):
        """Decide and return the turn that follows."""
        self.id += 1
        turn = self.turn["turn"]
        self.send("act", turn=turn, id=self.id, seat=seat, axes=axes, choices=choices, decide=decide)
        self.turn = self.take("turn")
        assert (self.turn["turn"], self.turn["played"]) == (turn + 1, self.id)
        return self.turn

    def close(self):
        self._socket.close()


@contextmanager
def website(source, game, settings=SETTINGS, **more):
    with open_website(0, welcome(source, PageGame(game, SECONDS, **more), settings)) as url:
        yield url
