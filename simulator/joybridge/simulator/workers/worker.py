"""A worker: a process that steps some arenas of one session, and ends with the server.

python -m joybridge.simulator.workers.worker PLACE LINK MARK

PLACE: of the game, as in the catalog. LINK: the file descriptor of the connection. MARK: that of a file with the number
of the arena that is played, -1 for none.
"""

import faulthandler
import json
import mmap
import os
import socket
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any, ClassVar

from joybridge.contract.codec import Codec, StepArrays, fill_step, pack
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.memory import keep_memory
from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import ArenaError
from joybridge.simulator.catalog import load_game
from joybridge.simulator.game import TimeStep
from joybridge.simulator.game_adapter import GameAdapter
from joybridge.simulator.workers.link import (
    ACT,
    CLOSING_SECONDS,
    DISTRIBUTE,
    DONE,
    DRAW,
    FAULT,
    OBSERVE,
    PICTURE,
    START,
    STEP,
    Frame,
    Link,
)
from joybridge.v1 import bridge_pb2 as pb

NONE = -1  # no arena is played
# A shell that kills this process and all that its games have started, after its standard input has been closed: by the
# server, or by the system when the server was killed. It does so too if this process hangs in compiled code.
GUARD = f"read -r nothing; sleep {CLOSING_SECONDS:g}; kill -KILL 0"


class MarkedGame(GameAdapter):
    """Notes which arena is played, for the case that it ends or holds up the process."""

    mark: ClassVar[memoryview]

    def draw(self, arena: int) -> Array:
        """Return the author's picture of one arena."""
        self.mark[0] = arena
        return super().draw(arena)

    def _timesteps(self, arena: int, play: Callable[..., Any], *actions: Any) -> list[TimeStep]:
        self.mark[0] = arena
        return super()._timesteps(arena, play, *actions)


class Worker:
    """The arenas of this process."""

    game: GameAdapter

    def __init__(self, place: str, mark: memoryview) -> None:
        """Load the game at a place."""
        self._class = type("WorkedGame", (MarkedGame, load_game(place)), {"mark": mark})
        self._codecs: list[Codec] = []
        self._previous: list[StepArrays] = []

    def answer(self, kind: bytes, message: bytes) -> Frame:
        """Return the answer to a frame. Raises whatever the game does."""
        if kind == ACT:
            acts = pb.Act.FromString(message).behaviors
            known = zip(self._codecs, acts, self._previous, strict=True)
            return self._step(self.game.step([codec.unpack_act(act, previous) for codec, act, previous in known]))
        if kind == OBSERVE:
            return self._step(self.game.observe())
        if kind == DISTRIBUTE:
            self.game.distributions = dict(pb.Act.FromString(message).distributions)
            return DONE, b""
        what = json.loads(message)
        if kind == DRAW:
            return PICTURE, pack(self.game.draw(**what)).SerializeToString()
        if kind == START:
            self.game = self._class(**what)
            spec = self.game.spec
            self._codecs = [Codec(behavior, what["arenas"], len(spec.parameters)) for behavior in spec.behaviors]
        else:
            self.game.reset(**what)
        self._previous = self.game.observe()
        return DONE, b""

    def close(self) -> None:
        """Close the games of the arenas, if they have begun."""
        if hasattr(self, "game"):
            try:
                self.game.close()
            except BaseException:  # nobody hears of it any more
                traceback.print_exc()

    def _step(self, steps: list[StepArrays]) -> Frame:
        self._previous = steps
        message = pb.Step()
        for step in steps:
            fill_step(message.behaviors.add(), step)
        return STEP, message.SerializeToString()


def work(worker: Callable[[], Worker], link: Link, mark: memoryview) -> None:
    """Answer the server until it closes the connection; then close the games."""
    made = None
    while True:
        try:
            frame = link.receive()
        except (EOFError, OSError):
            break
        try:
            made = made or worker()
            answer = made.answer(*frame)
        except BaseException as error:  # a game may call exit()
            answer = FAULT, json.dumps(fault(error)).encode()
        mark[0] = NONE
        with suppress(OSError):  # the server has gone
            link.send(*answer)
    if made is not None:
        made.close()


def fault(error: BaseException) -> dict[str, Any]:
    """Return what the server needs to know about an error. arena: its number in this worker."""
    what = {"arena": NONE, "text": str(error), "traceback": "".join(traceback.format_exception(error))}
    if isinstance(error, ArenaError):
        return what | {"arena": error.arena, "text": error.text}
    return what if isinstance(error, JoybridgeError) else what | {"text": f"{type(error).__name__}: {error}"}


def main() -> None:
    """Run the command line."""
    subprocess.Popen(["/bin/sh", "-c", GUARD], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)  # for the games
    os.close(nothing)
    keep_memory()
    faulthandler.enable()  # the server ends a worker that hangs with SIGABRT
    place, link, mark = sys.argv[1:]
    played = memoryview(mmap.mmap(int(mark), 0)).cast("q")
    work(lambda: Worker(place, played), Link(socket.socket(fileno=int(link))), played)
    os._exit(0)  # threads of environments may not end, and nothing is left to save


if __name__ == "__main__":
    main()
