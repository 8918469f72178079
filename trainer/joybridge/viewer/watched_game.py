"""A game of a running simulator, as a page watches it: random decisions, as `joybridge look` draws them."""

import time
from collections.abc import Callable
from contextlib import closing

from websockets.sync.server import ServerConnection

from joybridge.commands.look import decisions_apart
from joybridge.contract.errors import JoybridgeError
from joybridge.viewer.arena import Arena, Settings
from joybridge.viewer.clock import LOOK_SECONDS, Pace, interval
from joybridge.viewer.messages import encode_picture, error_message, game_message, turn_message


def watch_game(page: ServerConnection, reach: Callable[[], str], game: str, settings: Settings, timeout: float) -> None:
    """Show a game to a page until the page goes away, which raises ConnectionClosed.

    reach: returns the address of the simulator if it answers; it is tried again until it does.
    """
    pace = Pace(page)
    while True:
        try:
            with closing(Arena(reach(), game, settings, timeout)) as arena:
                _watch(page, pace, arena)
        except JoybridgeError as error:
            page.send(error_message("lost", error))
        pace.wait(time.monotonic() + LOOK_SECONDS)


def _watch(page: ServerConnection, pace: Pace, arena: Arena) -> None:
    page.send(game_message(arena))
    due = time.monotonic()
    while True:
        pace.wait(due)
        now = time.monotonic()
        if pace.running:
            arena.play_at_random(decisions_apart(arena.spec))
            page.send(turn_message(arena, None, None))
            for picture in arena.pictures:
                page.send(encode_picture(picture))
        due = max(due, now) + interval(arena.spec) if pace.running else now + LOOK_SECONDS
