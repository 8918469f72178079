"""Play with the pages of a room: take their messages, and play a decision whenever the game's clock or they say so."""

import logging
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from websockets.sync.server import ServerConnection

from joybridge.client.errors import SimulatorLost
from joybridge.config.errors import ConfigError
from joybridge.contract.errors import JoybridgeError
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Arena, Pressed, Settings
from joybridge.viewer.messages import (
    Act,
    Clock,
    Discard,
    Message,
    MessageError,
    encode_picture,
    error_message,
    game_message,
    people_message,
    read_message,
    recorded_message,
    turn_message,
)
from joybridge.viewer.room import PageLeft, Room
from joybridge.viewer.simulator import Simulator

if TYPE_CHECKING:  # they need torch
    from joybridge.policy.players import Players
    from joybridge.viewer.rated import RatedMatches
    from joybridge.viewer.run_opponent import Rival

log = logging.getLogger("joybridge.trainer")

Against = Callable[[str, Settings], "AbstractContextManager[Rival]"]  # takes the address of the simulator

LATE = 2  # decisions that are made up for, after a delay
RETRY_SECONDS = 0.5  # between two attempts to reach a lost simulator


@dataclass(frozen=True)
class PageGame:
    """What is played with the pages of a room."""

    game: str
    timeout: float  # seconds to wait for an answer of the simulator
    people: int = 1  # how many pages hold a seat each; 1: every page plays an arena of its own, and may take any seat
    against: Against | None = None  # opens the rival of each session
    demos: Path | None = None  # the folder in which each session is recorded
    others: "Callable[[pb.GameSpec, Settings], Players] | None" = None  # loads who hold the other seats
    rated: "Callable[[pb.GameSpec, Settings], RatedMatches] | None" = None  # opens the log of the matches


def welcome(simulator: Simulator, what: PageGame, settings: Settings) -> Callable[[ServerConnection], None]:
    """Return a function that takes a page until it goes away. Pages begin under these settings."""

    def open_room() -> Room:
        room = Room(what.people)
        Thread(target=play, args=(room, simulator, what, settings), daemon=True).start()
        return room

    if what.people > 1:
        return open_room().enter
    return lambda page: open_room().enter(page)


def play(room: Room, simulator: Simulator, what: PageGame, settings: Settings) -> None:
    """Play a game with the pages of a room; return when the only page has gone away.

    Begin under `settings`, and again with those that a page asks for. Where there are places for several pages, wait
    for all of them, and again whenever one has gone away. A simulator that is lost is tried again until it answers.
    A defect closes the pages, and the room takes others.
    """
    while True:
        try:
            room.gather()
            settings = _play_session(room, simulator, what, settings)
        except PageLeft:
            if room.places == 1:
                return
        except Exception:
            log.exception("a game with %d pages has ended by a defect of Joybridge", room.places)
            room.close()
            if room.places == 1:
                return


def _play_session(room: Room, simulator: Simulator, what: PageGame, settings: Settings) -> Settings:
    """Play an arena until a page asks for other settings, and return them, or the same ones to try again."""
    try:
        address = simulator.reach()
        with (
            closing(Arena(address, what.game, settings, what.timeout, what.demos)) as arena,
            what.against(address, settings) if what.against else nullcontext() as rival,
        ):
            if len(arena.scores.seats) < room.places:
                raise ConfigError(f"{room.places} people play, and the game has {len(arena.scores.seats)} seats")
            if what.others:
                arena.seat(what.others(arena.spec, settings))
            if what.rated:
                arena.rated = what.rated(arena.spec, settings)
            return _play_arena(room, arena, rival, what.demos)
    except SimulatorLost as error:
        room.send_all(error_message("lost", error))
        return _wait_for_start(room, RETRY_SECONDS) or settings
    except JoybridgeError as error:
        room.send_all(error_message("refused", error))
        return _wait_for_start(room, None) or settings


def _wait_for_start(room: Room, seconds: float | None) -> Settings | None:
    """Return the settings that a page asks for; None if none does within so many seconds. Raises PageLeft."""
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        try:
            _, message = _receive(room, None, None if end is None else end - time.monotonic())
        except TimeoutError:
            return None
        if isinstance(message, Settings):
            return message


def _play_arena(room: Room, arena: Arena, rival: "Rival | None", demos: Path | None) -> Settings:
    """Play until a page asks for other settings, which are returned. demos: where it is recorded. Raises PageLeft.

    A decision needs an act of every page for its turn, so nothing is played that a page has not seen, and the game
    waits for everybody. Its pace comes before its pictures: when it is late, only every other decision has one.
    """
    interval = arena.spec.tick_seconds * arena.spec.decision_interval
    acts: dict[int, Act] = {}  # by the place of the page
    running: set[int] = set()  # the places whose pages let the game run
    due, drew = 0.0, False
    told: bool | None = None  # whether the pages know that the episode is discarded
    places = range(room.places)
    for place in places:
        room.send(place, game_message(arena, _seat(room, arena, place), fixed=room.places > 1))
        room.send(place, turn_message(arena, None, rival))
    _tell(room, running)
    while True:
        if demos and told != arena.discarded:
            room.send_all(recorded_message(demos, discarded=arena.discarded))
            told = arena.discarded
        now = time.monotonic()
        ticking = interval > 0 and len(running) == room.places
        decided = len(acts) == room.places and all(act.decide for act in acts.values())
        if not decided and (len(acts) < room.places or not ticking):
            wait = None
        elif decided or now >= due:
            late = ticking and now > due + interval
            drew = not (late and drew)
            arena.play(_pressed(room, arena, acts), draw=drew, ticks=not late)
            if rival:
                rival.play()
            for place in places:
                room.send(place, turn_message(arena, acts[place].id, rival))
            for picture in [*arena.pictures, *(rival.pictures if rival else [])]:
                room.send_all(encode_picture(picture))
            acts, due = {}, max(due, now - LATE * interval) + interval
            continue
        else:
            wait = due - now
        try:
            place, message = _receive(room, arena, wait)
        except TimeoutError:
            continue
        if isinstance(message, Settings):
            return message
        if isinstance(message, Discard):
            arena.discard()
        elif isinstance(message, Clock):
            running = running | {place} if message.running else running - {place}
            due = time.monotonic()
            _tell(room, running)
        elif isinstance(message, Act) and message.turn == arena.turn and not (place in acts and acts[place].decide):
            acts[place] = message  # who has decided waits for the others, and nothing that is pressed meanwhile counts


def _seat(room: Room, arena: Arena, place: int) -> int | None:
    """Return the seat that a page holds at first; None: all."""
    return place if room.places > 1 else 0 if arena.others else None


def _pressed(room: Room, arena: Arena, acts: dict[int, Act]) -> dict[int, Pressed]:
    """Return what is pressed in the seats that people hold: of several people each has a fixed one."""
    if room.places > 1:
        return {place: act.pressed for place, act in acts.items()}
    seats = range(len(arena.scores.seats)) if acts[0].seat is None else [acts[0].seat]
    return dict.fromkeys(seats, acts[0].pressed)


def _tell(room: Room, running: set[int]) -> None:
    """Tell people that play together for whom the game waits."""
    if room.places > 1:
        for place in range(room.places):
            room.send(place, people_message(place, [other for other in range(room.places) if other not in running]))


def _receive(room: Room, arena: Arena | None, seconds: float | None) -> tuple[int, Message | None]:
    """Return the place and the next message, None for one that is refused, or an act when nothing is played any more.

    Raises TimeoutError and PageLeft.
    """
    place, data = room.receive(seconds)
    try:
        return place, read_message(data, arena)
    except MessageError as error:
        room.send(place, error_message("refused", error, playing=arena is not None))
        return place, None
