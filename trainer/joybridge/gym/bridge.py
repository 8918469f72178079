"""What all environments share: the session with a simulator, and the players in it."""

import weakref
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.client.own_games import choose_game
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_value, drawn, fixed
from joybridge.contract.limits import max_pictures
from joybridge.contract.spec import choose_parameters
from joybridge.contract.tensors import Array
from joybridge.gym.player import EnvPlayer
from joybridge.gym.settings import EnvSettings, Seat, check_seed
from joybridge.layouts import list_roles, make_acts
from joybridge.plugins import load

TURN_BASED_FPS = 5.0  # frames per second of games without a clock


class Bridge:
    """A session, its simulator if that was started for it, and the players."""

    def __init__(self, settings: EnvSettings, *, single: bool, split: bool) -> None:
        """Open the session; BridgeVectorEnv describes the errors.

        single: only one player is allowed, and `sensors` and `reward_weights` are its; otherwise they are by player.
        split: one player per agent of the game, not one in all lanes of a behavior.
        """
        name, places = choose_game(settings.game, settings.games, settings.simulator)
        with ExitStack() as resources:
            address = settings.simulator or resources.enter_context(simulator_process(places))
            session = Session(
                address,
                name,
                arenas=settings.arenas,
                seed=check_seed(settings.seed),
                options=settings.options,
                parameters=fixed(settings.parameters or {}),
                distributions=drawn(settings.parameters or {}),
            )
            self.session = resources.enter_context(session)
            self.spec = self.session.spec
            self._others = None
            if settings.others:
                seat_others = load("joybridge.opponents", "table")
                self._others = seat_others(settings.others, name, self.spec, settings.arenas, check_seed(settings.seed))
            self.players = self._make_players(settings, single=single, split=split)
            self._drawable = self._choose_drawn(settings.render_mode)
            self._drawing = False  # whether `render` has been called since the last reset
            self._pictures: list[Array] = []  # of all arenas after the last step
            self.fresh = True  # the current episodes have not been played yet
            self.playing = False
            # Called by `close`, when the environment is garbage collected, or when the interpreter exits; only once.
            self.close = weakref.finalize(self, resources.pop_all().close)

    def _make_players(self, settings: EnvSettings, *, single: bool, split: bool) -> dict[str, EnvPlayer]:
        """Return the players by name. Raises ConfigError."""
        seats = {}
        for role in list_roles(settings.layout, self.spec):
            agents = self.spec.behaviors[role.behavior].agents_per_arena if split else 1
            if self._others is not None and role.behavior == 0:
                seats[role.name] = Seat(role, 0)
            for agent in range(agents if self._others is None else 0):
                seats[f"{role.name}_{agent}" if agents > 1 else role.name] = Seat(role, agent if agents > 1 else None)
        if single and len(seats) > 1:
            raise ConfigError(
                f"{self.spec.name} with layout {settings.layout!r} has {len(seats)} agents ({', '.join(seats)}), and "
                "this environment is for one; use joybridge.gym.BridgeParallelEnv, or let `others` hold all seats but "
                "one"
            )
        if single:
            (name,) = seats
            settings = replace(
                settings, sensors={name: settings.sensors}, reward_weights={name: settings.reward_weights or {}}
            )
        for argument in ("sensors", "reward_weights"):
            for name in getattr(settings, argument) or {}:
                if name not in seats:
                    raise ConfigError(f"{argument}: there is no agent {name!r}; there are {', '.join(seats)}")
        return {
            name: EnvPlayer(
                name, seat, self.spec.behaviors[seat.role.behavior], settings, "" if single else f"[{name!r}]"
            )
            for name, seat in seats.items()
        }

    def _choose_drawn(self, render_mode: str | None) -> range:
        """Return the arenas to draw. Raises ConfigError if they cannot be drawn."""
        if render_mode is None:
            return range(0)
        if not self.spec.HasField("picture"):
            raise ConfigError(f"{self.spec.name} cannot be drawn: its spec has no picture; leave out render_mode")
        if self.session.arenas > (most := max_pictures(self.spec)):
            raise ConfigError(f"render_mode: {self.session.arenas} arenas, at most {most} can be drawn")
        return range(self.session.arenas)

    def metadata(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """Return an environment's metadata with the game's frames per second."""
        seconds = self.spec.tick_seconds * self.spec.decision_interval
        return {**known, "render_fps": 1.0 / seconds if seconds else TURN_BASED_FPS}

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> int | None:
        """Begin new episodes in all arenas; return the seed as an int of Python. Raises ConfigError or SpecError."""
        self._require_open()
        seed = None if seed is None else check_seed(seed)
        if seed is not None or parameters or not self.fresh:
            for name, value in parameters.items():
                check_value(name, value)
                if isinstance(value, Mapping):
                    raise ConfigError(
                        f"reset: parameters.{name} is {value!r}, expected a number; give a distribution where the "
                        "environment is made"
                    )
            chosen = choose_parameters(self.spec.parameters, parameters, self.spec.name)
            self.session.reset(seed, chosen)
            self._pictures = []
        self.fresh, self.playing, self._drawing = False, True, False
        if self._others:
            if seed is not None:
                self._others.reseed(seed)
            self._others.begin(self.session.steps)
        for player in self.players.values():
            player.begin(self.session.steps[player.index])
        return seed

    def play(self, moves: Iterable[tuple[EnvPlayer, Any]]) -> None:
        """Play one decision in every arena; lanes without an action rest. Raises ActionError."""
        self._require_open()
        if not self.playing:
            raise ResetNeeded("no episode is being played; call reset first")
        acts = make_acts(self.spec, self.session.arenas)
        for step, act in zip(self.session.steps, acts, strict=True):
            for column, mask in enumerate(step.masks or ()):
                act.choices[:, column] = mask.argmax(axis=1)  # the first choice that is allowed
        for player, actions in moves:
            player.write(actions, acts[player.index])
        if self._others:
            self._others.act(self.session.steps, acts)
        steps, self._pictures = self.session.step_and_draw(acts, self._drawable if self._drawing else ())
        if self._others:
            self._others.sit(steps)
        for player in self.players.values():
            player.push(steps[player.index])
        self.fresh = all(step.ends.all() for step in steps)

    def render(self) -> list[Array] | None:
        """Return the pictures of all arenas after the last step; black if it was not drawn, None without render_mode.

        A simulator draws in a step, and drawing is slow. So it draws from the first call until the next reset only.
        """
        if not self._drawable:
            return None
        self._drawing = True
        if self._pictures:
            return [picture.copy() for picture in self._pictures]
        size = (self.spec.picture.height, self.spec.picture.width, 3)
        return [np.zeros(size, np.uint8) for _ in self._drawable]

    def _require_open(self) -> None:
        if not self.close.alive:
            raise ClosedEnvironmentError("the environment is closed; make a new one")


def only_parameters(options: Mapping[str, Any] | None) -> Mapping[str, float]:
    """Return the parameters in the options of a reset. Raises ConfigError for other options."""
    for name in options or {}:
        if name != "parameters":
            raise ConfigError(f"reset: unknown option {name!r}, expected parameters")
    parameters: Mapping[str, float] = (options or {}).get("parameters", {})
    if not isinstance(parameters, Mapping):
        raise ConfigError(f"reset: parameters is {parameters!r}, expected values by name")
    return parameters


def batch_of_one(action: Any) -> Any:
    """Return the action of one lane as a batch of one."""
    if isinstance(action, Mapping):
        return {kind: np.asarray(part)[None] for kind, part in action.items()}
    return np.asarray(action)[None]
