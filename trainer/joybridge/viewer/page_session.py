"""Play with one page: take its messages, and play a decision whenever the game's clock or the page says so."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from websockets.sync.server import ServerConnection

from joybridge.client.errors import SimulatorLost
from joybridge.contract.errors import JoybridgeError
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Arena, Settings
from joybridge.viewer.messages import (
    Act,
    Clock,
    MessageError,
    encode_picture,
    error_message,
    game_message,
    read_message,
    turn_message,
)
from joybridge.viewer.simulator import Simulator

if TYPE_CHECKING:  # it needs torch
    from joybridge.viewer.others import Others
    from joybridge.viewer.run_opponent import Rival

Against = Callable[[str, Settings], "AbstractContextManager[Rival]"]  # takes the address of the simulator
LoadOthers = Callable[[pb.GameSpec, Settings], "Others"]

LATE = 2  # decisions that are made up for, after a delay
RETRY_SECONDS = 0.5  # between two attempts to reach a lost simulator


@dataclass(frozen=True)
class PageGame:
    """What is played with a page."""

    game: str
    timeout: float  # seconds to wait for an answer of the simulator
    against: Against | None = None  # opens the rival of each session
    demos: Path | None = None  # the folder in which each session is recorded
    others: LoadOthers | None = None  # loads the policies that hold the other seats


def play(page: ServerConnection, simulator: Simulator, what: PageGame, settings: Settings) -> None:
    """Play a game with a page until the page goes away, which raises ConnectionClosed.

    Begin under `settings`, and again with those that the page asks for. A simulator that is lost is tried again until
    it answers.
    """
    while True:
        try:
            address = simulator.reach()
            with (
                closing(Arena(address, what.game, settings, what.timeout, what.demos)) as arena,
                what.against(address, settings) if what.against else nullcontext() as rival,
            ):
                if what.others:
                    arena.seat(what.others(arena.spec, settings))
                settings = _play_arena(page, arena, rival)
        except SimulatorLost as error:
            page.send(error_message("lost", error))
            settings = _wait_for_start(page, RETRY_SECONDS) or settings
        except JoybridgeError as error:
            page.send(error_message("refused", error))
            settings = _wait_for_start(page, None) or settings


def _wait_for_start(page: ServerConnection, seconds: float | None) -> Settings | None:
    """Return the settings that the page asks for; None if it does not within so many seconds."""
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        try:
            message = _receive(page, None, None if end is None else end - time.monotonic())
        except TimeoutError:
            return None
        if isinstance(message, Settings):
            return message


def _play_arena(page: ServerConnection, arena: Arena, rival: "Rival | None") -> Settings:
    """Play until the page asks for other settings, which are returned.

    A decision needs an act of the page for its turn, so nothing is played that the page has not seen. The pace of the
    game comes before its pictures: when it is late, every other one is left out.
    """
    interval = arena.spec.tick_seconds * arena.spec.decision_interval
    act: Act | None = None
    running, due, drew = False, 0.0, False
    page.send(game_message(arena, 0 if arena.others else None))
    page.send(turn_message(arena, None, rival))
    while True:
        now = time.monotonic()
        ticking = running and interval > 0
        if act is None or not (act.decide or ticking):
            wait = None
        elif act.decide or now >= due:
            drew = not (drew and ticking and now > due + interval)
            arena.play(act.pressed, act.seat, draw=drew)
            if rival:
                rival.play()
            page.send(turn_message(arena, act.id, rival))
            for picture in (arena.picture, rival.picture if rival else None):
                if picture is not None:
                    page.send(encode_picture(picture))
            act, due = None, max(due, now - LATE * interval) + interval
            continue
        else:
            wait = due - now
        try:
            message = _receive(page, arena, wait)
        except TimeoutError:
            continue
        if isinstance(message, Settings):
            return message
        if isinstance(message, Clock):
            running, due = message.running, time.monotonic()
        elif isinstance(message, Act) and message.turn == arena.turn:
            act = message


def _receive(page: ServerConnection, arena: Arena | None, seconds: float | None) -> Settings | Clock | Act | None:
    """Return the next message of the page, None for one that is refused. Raises TimeoutError and ConnectionClosed."""
    data = page.recv(None if seconds is None else max(0.0, seconds))
    try:
        return read_message(data, arena)
    except MessageError as error:
        page.send(error_message("refused", error))
        return None
