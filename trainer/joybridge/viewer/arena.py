"""One arena of a game as people play it: its session, its scores and the seats that they do not hold."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from joybridge.client.client import Session, describe
from joybridge.config.game_settings import check_settings
from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.scores import Scores

if TYPE_CHECKING:  # it needs torch
    from joybridge.policy.players import Players
    from joybridge.viewer.rated import RatedMatches


@dataclass(frozen=True)
class Settings:
    """What a page plays, except the game."""

    seed: int
    options: dict[str, str]
    parameters: dict[str, float]


class Pressed(NamedTuple):
    """What a person does with the device of each behavior: the values of its axes and choices of its branches."""

    axes: list[list[float]]
    choices: list[list[int]]


class Arena:
    """An arena, from its first episode until it is closed.

    turn: number of decisions so far. acts: what was played last, per behavior. pictures: uint8 [height, width, 3] each,
    of the ticks of the last decision where the game draws them, or of its end. others: who hold the seats that people
    do not; None: chance does. rated: the log of its matches, if people want to be rated. discarded: whether nobody
    learns from the present episode, or from the last one if no decision has been played since.
    """

    def __init__(self, address: str, game: str, settings: Settings, timeout: float, demos: Path | None = None) -> None:
        """Open a session.

        timeout: seconds to wait for an answer. demos: record what the person plays in this folder. Raises
        SimulatorError, ConfigError and StorageError.
        """
        check_settings(settings.options, settings.parameters, describe(address, game, {}))
        self.session = Session(
            address,
            game,
            arenas=1,
            seed=settings.seed,
            options=settings.options,
            parameters=settings.parameters,
            timeout=timeout,
        )
        self.settings = settings
        self.discarded = False
        self._since = self._last = 0  # decisions of the present episode, and of the one before
        self._demonstration = self.session.record_demonstration(demos) if demos else None
        self.spec = spec = self.session.spec
        self.scores = Scores(spec)
        self.acts = make_acts(spec, 1)
        self.turn = 0
        self.pictures: list[Array] = []
        self.others: Players | None = None
        self.rated: RatedMatches | None = None
        self._rng = np.random.default_rng(settings.seed)

    @property
    def steps(self) -> Sequence[StepArrays]:
        """The present observations, masks and who decides."""
        return self.session.steps

    def seat(self, others: "Players") -> None:
        """Let others hold the seats that people do not. Call this before the first decision."""
        others.begin(self.steps)
        self.others = others

    def play(self, pressed: Mapping[int, Pressed], *, draw: bool = True, ticks: bool = True) -> None:
        """Play one decision. pressed: by people, by the seat that they hold; `others` or chance play in the rest.

        draw: make a picture, if the game can be drawn; with `ticks`, one of every tick, if it can do that. Where a
        choice is forbidden, an allowed one is played. Raises SimulatorError, and StorageError where a match cannot be
        logged.
        """
        if self.rated:
            self.rated.hold(pressed)
        decided = self.others.act(self.steps) if self.others else None  # for all seats: people may take other ones
        for index, (behavior, act, step) in enumerate(zip(self.spec.behaviors, self.acts, self.steps, strict=True)):
            if decided:
                others = decided[index]
                act.axes[:], act.choices[:], act.scripts = others.axes, others.choices, others.scripts
            elif len(pressed) < len(self.scores.seats):
                press_at_random(behavior.device, act, self._rng)
            for seat, given in pressed.items():
                held = self.scores.seats[seat]
                if held.behavior == index:
                    act.axes[held.agent] = _in_range(given.axes[index], behavior.device)
                    act.choices[held.agent] = given.choices[index]
                    if act.scripts is not None:
                        act.scripts[held.agent] = 0
            obey_masks(act, step, self._rng)
        if self._demonstration:
            self.discarded = self.discarded and self._since > 0
            self._demonstration.hold(self._lanes([] if self.discarded else pressed))
        self._step(draw=draw, ticks=ticks)
        self._since += 1
        if any(end["seat"] in pressed for end in self.scores.ended):
            self._since, self._last = 0, self._since

    def discard(self) -> None:
        """Let nobody learn from the present episode, or from the last one if no decision has been played since.

        Raises StorageError.
        """
        if self._demonstration and not self.discarded and (self._since or self._last):
            self._demonstration.discard(self._since or self._last)
            self.discarded = True

    def play_at_random(self, every: int) -> None:
        """Play one random allowed decision; what is pressed changes every so many decisions. Raises SimulatorError."""
        for behavior, act, step in zip(self.spec.behaviors, self.acts, self.steps, strict=True):
            if self.turn % every == 0:
                press_at_random(behavior.device, act, self._rng)
            obey_masks(act, step, self._rng)
        self._step(draw=True, ticks=False)

    def _step(self, *, draw: bool, ticks: bool) -> None:
        session, draw = self.session, draw and self.spec.HasField("picture")
        if draw and ticks:
            steps, self.pictures = session.step_and_draw_ticks(self.acts)
        else:
            steps, self.pictures = session.step_and_draw(self.acts, [0] if draw else [])
        if self.others:
            self.others.store(steps)
        if self.rated:
            self.rated.take(steps)
        self.turn += 1
        self.scores.take(steps)

    def _lanes(self, seats: Collection[int]) -> list[list[int]] | None:
        """Return the lanes of each behavior that are among some seats, None: all."""
        if len(seats) == len(self.scores.seats):
            return None
        held = [self.scores.seats[seat] for seat in seats]
        return [[one.agent for one in held if one.behavior == index] for index in range(len(self.spec.behaviors))]

    def close(self) -> None:
        """End the session; the simulator frees the arena."""
        self.session.close()


def _in_range(values: Sequence[float], device: pb.Device) -> Array:
    low, high = (np.array([getattr(axis, bound) for axis in device.axes], np.float32) for bound in ("low", "high"))
    return np.clip(np.array(values, np.float32), low, high)
