"""A pygame program as a game: an arena is a process, a fork of the program as it was at its first frame."""

import hashlib
import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import numpy as np

from joybridge.adapters.pygame_programs.first_play import Number
from joybridge.adapters.pygame_programs.form import Look, make_form
from joybridge.adapters.pygame_programs.players import Played, Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.settings import PygameSettings
from joybridge.adapters.pygame_programs.tape import MAX_PICTURE_PIXELS, TapeWriter, note_of
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.simulator import quiet_step, spec
from joybridge.simulator.batched_game import ArenaError, BatchedGame, check_range
from joybridge.v1 import bridge_pb2 as pb

log = logging.getLogger("simulator")

MAX_ARENAS = 128  # of a session: each is a process of 10 to 20 MB
MAX_EPISODES = 2**40  # of an arena, for forged snapshots


class PygameGame(BatchedGame):
    """Some arenas of one program. `adapt` creates the subclass for each program."""

    settings: ClassVar[PygameSettings]
    look: ClassVar[Look]
    processes: ClassVar[ProgramProcesses]
    frame_seconds: ClassVar[float]
    exact: ClassVar[bool]  # whether its snapshots are
    numbers: ClassVar[list[Number]]  # in its texts: what may be a reward
    end_texts: ClassVar[list[str]]  # of its sources: what may be an end

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec of the program as the first look has shown it."""
        form, limit = make_form(cls.look, options), int(cls.settings.number("max_decisions"))
        snapshot = 64 + limit * form.act_bytes if cls.exact else 0
        return spec(
            cls,
            [form.player()],
            decision_interval=form.interval,
            tick_seconds=cls.frame_seconds,
            max_episode_decisions=limit,
            max_arenas=1 if cls.settings.window else MAX_ARENAS,
            picture=cls.look.picture(),
            snapshot_bytes_per_arena=snapshot,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena. Raises GameError."""
        self._spec = self.describe(options)
        self._player = self._spec.behaviors[0]
        device, limit = self._player.device, self._spec.max_episode_decisions
        self._options, self._form = options, make_form(self.look, options)
        self._tapes: dict[int, TapeWriter] = {}  # by arena, if they are wanted
        told = self._form.inside(
            self.settings.number("seconds"),
            hashes="tapes" in self.settings.texts,
            skip_drawing=self.settings.skip_drawing,
        )
        self._players = Players(self.processes, self._form, told, arenas)
        self._first_arena = first_arena
        self._seed = np.array([seed], np.uint64)
        self._episodes = np.zeros(arenas, np.int64)  # that have begun since the seed was set
        self._closed = False  # whether the window is, because an episode is over
        self._trusted = np.zeros(arenas, bool)  # whether the last episode of the arena has come to its end
        self._lengths = np.zeros(arenas, np.int32)  # decisions of the present episode
        self._axes = np.zeros((arenas, limit, len(device.axes)), np.float32)  # of the present episode
        self._choices = np.zeros((arenas, limit, len(device.branches)), np.int32)
        self._key = hashlib.blake2b(repr(sorted(options.items())).encode()).digest()
        try:
            self.reset(seed, parameters)
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        if seed is not None:
            self._seed[0] = seed
            self._episodes[:] = 0
            self._trusted[:] = False
        self._seen, self._closed = self._begin(range(len(self._episodes))), False

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [quiet_step(self._stack(self._seen), len(self._player.channels))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision, all at once. Where the episode ends, the next one begins.

        If the program fails in an arena in which an episode has ended well before, that costs the running episode.
        """
        arenas = range(len(self._episodes))
        if self._closed:
            self._seen, self._closed = self._begin(arenas), False
        self._axes[arenas, self._lengths], self._choices[arenas, self._lengths] = acts[0].axes, acts[0].choices
        shown, size = self.drawn_by_tick, self.look.picture()
        for arena in arenas:
            with suppress(ArenaError):  # what is received says so
                if arena == shown:
                    self._players.keep(shown, *size)
                self._players.act(arena, self._act(arena, self._lengths[arena]))
        played, failed = [], np.zeros(len(arenas), bool)
        for arena in arenas:
            try:
                played.append(self._players.receive(arena))
            except ArenaError as error:
                played.append(self._forgive(arena, error))
                failed[arena] = True
        self.tick_pictures = [] if shown is None or failed[shown] else self._players.ticks(shown, *size)
        self._lengths += 1
        ends = [a for a in arenas if played[a].over or failed[a] or self._lengths[a] == self._axes.shape[1]]
        self._trusted[ends] = ~failed[ends]
        self._seen = list(played)
        self._close_tapes(np.flatnonzero(failed).tolist())
        self._note_on_tapes(played)
        if ends and self.settings.window:
            self._closed = True  # the next window opens if there is a next decision
        elif ends:
            for arena, first in zip(ends, self._begin(ends), strict=True):
                self._seen[arena] = first
        step = quiet_step(self._stack(self._seen), 0)
        step.rewards = np.stack([one.rewards for one in played])
        if ends:
            step.ended = np.array(ends, np.int32)
            step.terminated[ends] = [played[arena].over for arena in ends]
            step.truncated[ends] = [not played[arena].over for arena in ends]
            step.final_observations = self._stack([played[arena] for arena in ends])
            step.interrupted = failed[ends] if failed.any() else None
            if self._player.metrics:
                step.metrics = np.stack([played[arena].metrics for arena in ends])
        return [step]

    def _forgive(self, arena: int, error: ArenaError) -> Played:
        """Return what was seen last in an arena in which the program has failed, if that was not its first episode.

        Raises the error otherwise: the author must see it, and a program that always fails teaches nothing.
        """
        if not self._trusted[arena]:
            raise error
        text = "%s: the program failed in arena %d after %d decisions: %s; its episode is cut, and the next one begins"
        log.error(
            text, self.name, self._first_arena + arena, self._lengths[arena], error.text, exc_info=error.__cause__
        )
        last = self._seen[arena]
        rewards, metrics = np.zeros_like(last.rewards), np.zeros_like(last.metrics)
        return last._replace(over=False, rewards=rewards, metrics=metrics, hashes=last.hashes[:0])

    def draw(self, arena: int) -> Array:
        """Return the display of one arena, uint8 [height, width, 3]."""
        return self._players.draw(arena, *self.look.picture())

    def save(self) -> dict[str, Array]:
        """Return what was decided since the present episodes began: the program does the same again.

        The processes leave copies behind that stand where they stand, from which a session continues at once as long
        as this server keeps them.
        """
        for arena in np.flatnonzero(self._lengths):
            self._players.branch(int(arena), self._name(int(arena)))
        return {
            "seed": self._seed.copy(),
            "episodes": self._episodes.copy(),
            "lengths": self._lengths.copy(),
            "axes": self._axes.copy(),
            "choices": self._choices.copy(),
            "seen": np.array([_hash(seen) for seen in self._seen], np.uint64),
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Continue from what `save` returned. Raises ValueError for a state that the program cannot be in."""
        limit = self._axes.shape[1]
        check_range("episodes", state["episodes"], 1, MAX_EPISODES)
        check_range("lengths", state["lengths"], 0, limit - 1)
        check_range("axes", state["axes"], -1.0, 1.0)
        for column, branch in enumerate(self._player.device.branches):
            check_range(f"choices of {branch.name}", state["choices"][..., column], 0, len(branch.choices) - 1)
        self._seed, self._episodes, self._lengths = (state[name].copy() for name in ("seed", "episodes", "lengths"))
        self._axes, self._choices = state["axes"].copy(), state["choices"].copy()
        self._trusted = self._episodes > 1
        arenas = range(len(self._episodes))
        self._close_tapes(arenas)  # a tape has an episode from its beginning
        for arena in arenas:
            self._seen[arena] = self._players.restore(arena, self._name(arena)) or self._repeat(arena)
            if _hash(self._seen[arena]) != state["seen"][arena]:
                raise ValueError(
                    f"arena {arena} does not show the picture of the snapshot: the program does not do the same again; "
                    "serve it with snapshots=false"
                )

    def close(self) -> None:
        """End the processes of the arenas."""
        self._close_tapes(list(self._tapes))
        self._players.end(range(len(self._episodes)))

    def _note_on_tapes(self, played: Sequence[Played]) -> None:
        """Append what each arena has just played to its tape, if it has one."""
        for arena, tape in self._tapes.items():
            act = self._act(arena, self._lengths[arena] - 1)
            tape.add(act, played[arena].hashes, self._players.draw(arena, *self.look.picture(MAX_PICTURE_PIXELS)))

    def _close_tapes(self, arenas: Sequence[int]) -> None:
        for arena in arenas:
            if tape := self._tapes.pop(arena, None):
                tape.close()

    def _new_tape(self, arena: int) -> TapeWriter:
        seed = self._episode_seed(arena)
        path = Path(self.settings.texts["tapes"]) / f"{self.name}-{seed:016x}.tape"
        return TapeWriter(path, note_of(self._form, self.settings, self._options, seed))

    def _begin(self, arenas: Sequence[int]) -> list[Played]:
        self._episodes[arenas] += 1
        self._lengths[arenas], self._axes[arenas], self._choices[arenas] = 0, 0.0, 0
        self._close_tapes(arenas)
        if "tapes" in self.settings.texts:
            self._tapes |= {arena: self._new_tape(arena) for arena in arenas}
        return self._players.begin(arenas, [self._episode_seed(arena) for arena in arenas])

    def _repeat(self, arena: int) -> Played:
        """Play the present episode of an arena again up to where it is."""
        (seen,) = self._players.begin([arena], [self._episode_seed(arena)])
        if length := int(self._lengths[arena]):
            acts = b"".join(self._act(arena, decision) for decision in range(length))
            seen = self._players.replay(arena, acts, length)
        if seen.over:
            raise ValueError(f"the episode of arena {arena} is over before its {length} decisions")
        return seen

    def _act(self, arena: int, decision: int) -> bytes:
        return bytes(self._axes[arena, decision]) + bytes(self._choices[arena, decision])

    def _episode_seed(self, arena: int) -> int:
        """Return the seed of the present episode of an arena, below 2**64."""
        key = [int(self._seed[0]), self._first_arena + arena, int(self._episodes[arena])]
        return int(np.random.SeedSequence(key).generate_state(1, np.uint64)[0])

    def _name(self, arena: int) -> bytes:
        """Return the name of the state of an arena: a hash of all on which it depends."""
        length = self._lengths[arena]
        acts = self._axes[arena, :length].tobytes() + self._choices[arena, :length].tobytes()
        seed = self._episode_seed(arena).to_bytes(8, "little")
        return hashlib.blake2b(self._key + seed + acts, digest_size=32).digest()

    def _stack(self, seen: Sequence[Played]) -> list[Array]:
        return [np.stack([one.sensors[index] for one in seen]) for index in range(len(self._player.sensors))]


def _hash(seen: Played) -> int:
    """Return a number that differs where observations do."""
    data = b"".join(sensor.tobytes() for sensor in seen.sensors)
    return int.from_bytes(hashlib.blake2b(data, digest_size=8).digest(), "little")
