"""The processes in which the arenas of a session are played, as the server sees them."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np

from joybridge.adapters.pygame_programs.form import Form
from joybridge.adapters.pygame_programs.processes import ProgramFault, ProgramProcesses, said
from joybridge.adapters.pygame_programs.stacks import place_of
from joybridge.adapters.pygame_programs.wire import (
    ACT,
    DRAW,
    FAULT,
    KEEP,
    REPLAY,
    STEP_HEADER,
    TICKS,
    WATCHED,
    as_json,
)
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.simulator.batched_game import ArenaError
from joybridge.simulator.workers.link import Link

SPARE_SECONDS = 1.0  # after which a process that is too slow should have ended by itself


class Played(NamedTuple):
    """What came of a decision in one arena."""

    over: bool  # whether the episode is
    nanoseconds: int  # virtual time
    rewards: Array  # float32 [channels]
    metrics: Array  # float32 [metrics]
    sensors: list[Array]  # one per sensor
    hashes: Array  # uint64, one per frame since the last decision, if they are wanted


class Players:
    """A process per arena. Every wait for one has a limit; one that is too slow, ends or fails raises ArenaError."""

    def __init__(self, processes: ProgramProcesses, form: Form, told: Mapping[str, Any], arenas: int) -> None:
        """told: what the form tells the processes; see Form.inside."""
        self._processes, self._told, self._seconds = processes, told, told["seconds"]
        player = form.player()
        self._links: list[Link | None] = [None] * arenas
        self._numbers = (len(player.channels), len(player.metrics))
        self._sensors = [(NUMPY_TYPES[sensor.dtype], tuple(sensor.shape)) for sensor in player.sensors]

    def begin(self, arenas: Sequence[int], seeds: Sequence[int]) -> list[Played]:
        """Begin an episode in some arenas, and return what is seen there first."""
        self.end(arenas)
        links = self._processes.fork([{"seed": seed, "form": self._told} for seed in seeds])
        for arena, link in zip(arenas, links, strict=True):
            self._links[arena] = link
        return [self.receive(arena) for arena in arenas]

    def act(self, arena: int, act: bytes) -> None:
        """Let an arena play a decision; `receive` returns what comes of it."""
        self._send(arena, ACT, act)

    def play(self, arena: int, acts: Iterable[bytes]) -> Iterator[Played]:
        """Play one decision after the other, and yield what comes of each, until the episode is over."""
        for act in acts:
            self.act(arena, act)
            played = self.receive(arena)
            yield played
            if played.over:
                return

    def watched(self, arena: int) -> Any:
        """Return what was seen: the numbers of the keys that the program reads, or what its texts show."""
        self._send(arena, WATCHED, b"")
        return json.loads(self._receive(arena))

    def replay(self, arena: int, acts: bytes, decisions: int) -> Played:
        """Play many decisions, and return what comes of the last."""
        self._send(arena, REPLAY, acts)
        return self.receive(arena, decisions)

    def receive(self, arena: int, decisions: int = 1) -> Played:
        """Return what came of so many decisions."""
        message = self._receive(arena, decisions)
        over, nanoseconds = STEP_HEADER.unpack_from(message)
        at, parts = STEP_HEADER.size, []
        for dtype, shape in [(np.dtype(np.float32), (count,)) for count in self._numbers] + self._sensors:
            count = int(np.prod(shape))
            parts.append(np.frombuffer(message, dtype, count, at).reshape(shape))
            at += parts[-1].nbytes
        hashes = np.frombuffer(message, np.uint64, offset=at)
        return Played(bool(over), nanoseconds, parts[0], parts[1], parts[2:], hashes)

    def branch(self, arena: int, name: bytes) -> None:
        """Keep the state of an arena under a name, as long as there is memory for it."""
        self._processes.branch(self._link(arena), name)

    def restore(self, arena: int, name: bytes) -> Played | None:
        """Go on from a state that was kept, and return what is seen there; None if it is no longer kept."""
        link = self._processes.fork_branch(name)
        if link is None:
            return None
        self.end([arena])
        self._links[arena] = link
        return self.receive(arena)

    def draw(self, arena: int, width: int, height: int) -> Array:
        """Return a picture of an arena, uint8 [height, width, 3]."""
        self._send(arena, DRAW, as_json([height, width]))
        return np.frombuffer(self._receive(arena), np.uint8).reshape(height, width, 3)

    def keep(self, arena: int, width: int, height: int) -> None:
        """Let an arena keep pictures of the frames of its next decision, for `ticks`."""
        self._send(arena, KEEP, as_json([height, width]))

    def ticks(self, arena: int, width: int, height: int) -> list[Array]:
        """Return pictures of the frames of the last decision but its last, uint8 [height, width, 3] each."""
        self._send(arena, TICKS, b"")
        return list(np.frombuffer(self._receive(arena), np.uint8).reshape(-1, height, width, 3))

    def end(self, arenas: Sequence[int]) -> None:
        """End the processes of some arenas."""
        for arena in arenas:
            link, self._links[arena] = self._links[arena], None
            if link is not None:
                link.close()

    def _link(self, arena: int) -> Link:
        link = self._links[arena]
        assert link is not None
        return link

    def _send(self, arena: int, kind: bytes, message: bytes) -> None:
        try:
            self._link(arena).send(kind, message)
        except OSError:
            self._raise_ended(arena)

    def _receive(self, arena: int, decisions: int = 1) -> bytes:
        try:
            kind, message = self._link(arena).receive(decisions * self._seconds + SPARE_SECONDS)
        except TimeoutError as error:
            raise self._too_slow(arena) from error
        except (EOFError, OSError):
            self._raise_ended(arena)
        if kind == FAULT:
            fault = json.loads(message)
            raise ArenaError(arena, f"the program has failed: {said(fault['text'])}") from ProgramFault(
                fault["traceback"]
            )
        return message

    def _raise_ended(self, arena: int) -> NoReturn:
        """Raise ArenaError for a process that has ended, with where it stood."""
        stack = self._processes.stacks.take()
        place = place_of(stack)
        if "Fatal Python error" in stack:
            why = f"the process of the program has crashed{place}"
        elif stack:
            why = f"the program drew no frame in {self._seconds:g} s{place}; {self._more()}"
        else:
            why = "the process of the program has ended: it was killed, as for lack of memory, or has lost its display"
        raise ArenaError(arena, why) from (ProgramFault(stack) if stack else None)

    def _more(self) -> str:
        return f"seconds={6 * self._seconds:g} allows it more"

    def _too_slow(self, arena: int) -> ArenaError:
        self._link(arena).kill()  # it has not even taken its alarm, as when it is stopped
        return ArenaError(arena, f"the program drew no frame in {self._seconds:g} s; {self._more()}")
