"""Turn an author's one-arena `Game` into the `BatchedGame` that the server runs.

Everything that an author returns is checked, here and in `timestep_arrays.py`: a mistake raises an ArenaError. A game
that raises an error after it has played for long loses its episode, and is made again.
"""

import logging
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from copy import deepcopy
from math import inf
from typing import Any, ClassVar, NamedTuple

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.limits import MAX_FLOAT32
from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import ArenaError, BatchedGame
from joybridge.simulator.distributions import draw_parameters
from joybridge.simulator.game import Action, Game, TimeStep
from joybridge.simulator.log import say_failures
from joybridge.simulator.timestep_arrays import (
    BehaviorFormat,
    arena_error,
    masks,
    metrics,
    observations,
    require_action,
    require_finite,
    unknown_name,
)
from joybridge.v1 import bridge_pb2 as pb


def batched(game: type[Game]) -> type["GameAdapter"]:
    """Return the BatchedGame class that runs many arenas of a one-arena game."""
    names = ("name", "description", "options", "version", "in_event_loop")
    members = {name: getattr(game, name) for name in names} | {"game": game}
    return type(game.__name__, (GameAdapter,), members)


log = logging.getLogger("simulator")

# Decisions of an arena, since it began or its game last failed, after which a failure costs the episode alone. So a
# mistake that an author looks for, and one that comes again and again, end the session.
TRUSTED = 1000


class End(NamedTuple):
    """The end of an episode of an arena."""

    timesteps: list[TimeStep]  # one per agent
    parameters: list[float]  # with which it was played
    interrupted: bool = False  # by an error of the game


class GameAdapter(BatchedGame):
    """Many arenas of one author's game. `batched` creates the subclass for a game."""

    game: ClassVar[type[Game]]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the author's spec. Parameters can be drawn per episode, as each arena is a game of its own."""
        spec = cls.game.describe(options)
        largest = max((max(-one.low, one.high) for one in spec.parameters), default=inf)
        spec.parameters_per_episode = largest <= MAX_FLOAT32
        return spec

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Create the arenas, each with its own random generator, and begin a first episode in each."""
        self.spec = self.describe(options)
        self.first_arena = first_arena
        self.behaviors: list[BehaviorFormat] = []
        for behavior in self.spec.behaviors:
            self.behaviors.append(BehaviorFormat(behavior, sum(one.agents for one in self.behaviors)))
        # One (behavior index, agent number) per agent of an arena, in the order of the author's lists.
        self.agents = [(b, agent) for b, one in enumerate(self.behaviors) for agent in range(one.agents)]
        # Per arena: the parameters, as they are now.
        self.parameters = [{p.name: p.default_value for p in self.spec.parameters} for _ in range(arenas)]
        self.arenas, self.option = arenas, options
        self.games: list[Game] = []
        self.shown: list[list[Array]] = [[] for _ in self.behaviors]  # the last observations, as they were sent
        try:
            self.reset(seed, parameters)
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        for own in self.parameters:
            own.update(parameters)
        if seed is not None:  # create the games again: they may keep state between episodes
            self.close()
            self.episodes = [0] * self.arenas  # that have begun
            self.played = [0] * self.arenas  # decisions since the arena began or its game last failed
            # With the dtype, because NumPy would make floats of a list with a large seed.
            self.keys = [np.array([seed, self.first_arena + arena], np.uint64) for arena in range(self.arenas)]
            for arena, key in enumerate(self.keys):  # one by one: those before one that fails must be closed
                self.games.append(self._make(arena, np.random.Generator(np.random.Philox(key=key))))
        self.timesteps = [self._reset(arena) for arena in range(len(self.games))]
        # Per behavior [lanes, channels]: rewards since the lane's last decision, for lanes that wait.
        self.earned = [
            np.zeros((len(self.games) * behavior.agents, len(behavior.channels)), np.float32)
            for behavior in self.behaviors
        ]

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [self._behavior_step(b, {}) for b in range(len(self.behaviors))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. Where the episode ends, the next one begins in the same step."""
        ended: dict[int, End] = {}
        actions = [self._actions(act, behavior) for act, behavior in zip(acts, self.behaviors, strict=True)]
        for act, behavior, chosen in zip(acts, self.behaviors, actions, strict=True):
            if act.scripts is not None:
                self._play_scripts(act.scripts, behavior, chosen)
        by_agent = [actions[b][agent :: self.behaviors[b].agents] for b, agent in self.agents]
        by_arena = by_agent[0] if len(by_agent) == 1 else map(list, zip(*by_agent, strict=True))
        failures: dict[int, BaseException] = {}
        try:
            for arena, own in enumerate(by_arena):
                try:
                    timesteps, interrupted = self._timesteps(arena, self.games[arena].step, own), False
                    self.played[arena] += 1
                except ArenaError as error:
                    failures[self.first_arena + arena] = self._forgiven(arena, error)
                    timesteps, interrupted = self._renew(arena), True
                self._earn(arena, timesteps)
                if timesteps[0].terminated or timesteps[0].truncated:
                    timesteps = deepcopy(timesteps)  # the next episode may begin in the same arrays
                    ended[arena] = End(timesteps, list(self.parameters[arena].values()), interrupted)
                    timesteps = self._reset(arena)
                self.timesteps[arena] = timesteps
        finally:  # also where an arena fails for good: what came before may be why
            say_failures(self.spec.name, failures)
        return [self._behavior_step(b, ended) for b in range(len(self.behaviors))]

    def draw(self, arena: int) -> Array:
        """Return the author's picture of one arena."""
        try:
            return self.games[arena].draw()
        except BaseException as error:
            raise arena_error(arena, error) from error

    def close(self) -> None:
        """Close the games, also those after one whose `close` raises."""
        with ExitStack() as stack:
            while self.games:
                stack.callback(self.games.pop().close)

    def _make(self, arena: int, rng: np.random.Generator) -> Game:
        """Return a new game for an arena. rng: its random numbers."""
        game = self.game()
        game.option, game.parameter, game.rng = self.option, self.parameters[arena], rng
        return game

    def _forgiven(self, arena: int, error: ArenaError) -> BaseException:
        """Return what the game of an arena has raised, if it costs only the episode.

        Raises the error itself if the arena has not played for long since it began or last failed, or if the error is a
        mistake in what the game returned.
        """
        if self.played[arena] < TRUSTED or not isinstance(error.__cause__, Exception | SystemExit):
            raise error
        self.played[arena] = 0
        return error.__cause__

    def _renew(self, arena: int) -> list[TimeStep]:
        """Make the game of an arena again after it has failed, and return how its episode ends.

        The random numbers go on, so that the same error need not come again.
        """
        old = self.games[arena]
        try:
            old.close()
        except Exception:  # it has failed already
            number = self.first_arena + arena
            log.exception("%s: the failed game of arena %d could not be closed", self.spec.name, number)
        try:
            self.games[arena] = self._make(arena, old.rng)
        except BaseException as another:
            raise arena_error(arena, another) from another
        return [
            TimeStep(
                {
                    sensor.name: column[arena * self.behaviors[b].agents + agent]
                    for sensor, column in zip(self.behaviors[b].sensors, self.shown[b], strict=True)
                },
                truncated=True,
            )
            for b, agent in self.agents
        ]

    def _reset(self, arena: int) -> list[TimeStep]:
        drawn = draw_parameters(self.distributions, self.spec.parameters, self.keys[arena], self.episodes[arena])
        self.parameters[arena].update(drawn)
        self.episodes[arena] += 1
        timesteps = self._timesteps(arena, self.games[arena].reset)
        if timesteps[0].terminated or timesteps[0].truncated:
            raise ArenaError(arena, "reset returned an episode's end, expected transition(...) or waiting(...)")
        return timesteps

    @staticmethod
    def _actions(act: ActArrays, behavior: BehaviorFormat) -> list[Action]:
        """Return the action of every lane by name."""
        names = behavior.actions
        lanes = zip(act.axes.tolist(), act.choices.tolist(), strict=True)
        return [dict(zip(names, axes + choices)) for axes, choices in lanes]  # noqa: B905, for speed

    def _play_scripts(self, scripts: Array, behavior: BehaviorFormat, actions: list[Action]) -> None:
        """Put what the author's scripts do into the actions of a behavior, lane by lane. scripts [lanes]."""
        for lane in np.flatnonzero(scripts).tolist():
            arena, agent = divmod(lane, behavior.agents)
            slot = behavior.slots[agent]
            timestep = self.timesteps[arena][slot]
            if timestep.deciding:
                name = behavior.scripts[scripts[lane] - 1]
                try:
                    action = self.games[arena].script(name, slot)
                    require_action(f"{behavior.name}: script {name!r}", action, behavior, timestep)
                except BaseException as error:
                    raise arena_error(arena, error) from error
                actions[lane] = action

    def _timesteps(self, arena: int, play: Callable[..., Any], *actions: Any) -> list[TimeStep]:
        """Call `reset` or `step` of one arena and return a timestep per agent, checked."""
        try:
            result = play(*actions)
        except BaseException as error:
            raise arena_error(arena, error) from error
        single = isinstance(result, TimeStep)
        if single and len(self.agents) == 1:
            return [result]
        timesteps: list[TimeStep] = [result] if single else result
        if not (isinstance(timesteps, list | tuple) and all(isinstance(one, TimeStep) for one in timesteps)):
            raise ArenaError(arena, f"got {result!r}, expected a TimeStep per agent, for example from transition(...)")
        if len(timesteps) != len(self.agents):
            raise ArenaError(arena, f"got {len(timesteps)} timesteps, expected {len(self.agents)}, one per agent")
        if len({one.terminated or one.truncated for one in timesteps}) != 1:
            raise ArenaError(arena, "the episode ended for some agents only, expected its end for all of them")
        return timesteps

    def _earn(self, arena: int, timesteps: list[TimeStep]) -> None:
        for (b, agent), timestep in zip(self.agents, timesteps, strict=True):
            behavior, earned = self.behaviors[b], self.earned[b]
            try:
                for name, value in timestep.rewards.items():
                    earned[arena * behavior.agents + agent, behavior.channels[name]] += value
            except KeyError as error:
                unknown = unknown_name(f"{behavior.name}: reward channel", error.args[0], behavior.channels)
                raise arena_error(arena, unknown) from error
            except BaseException as error:
                raise arena_error(arena, error) from error

    def _behavior_step(self, b: int, ended: Mapping[int, End]) -> StepArrays:
        """Collect one behavior's lanes into arrays."""
        behavior = self.behaviors[b]
        timesteps = [(arena, own[slot]) for arena, own in enumerate(self.timesteps) for slot in behavior.slots]
        ends = [(arena, end.timesteps[slot]) for arena, end in ended.items() for slot in behavior.slots]
        step = StepArrays(
            observations(behavior, timesteps),
            np.zeros_like(self.earned[b]),
            np.zeros(len(timesteps), bool),
            np.zeros(len(timesteps), bool),
            masks(behavior, timesteps),
        )
        self.shown[b] = step.observations
        if ends:
            lanes = np.arange(len(timesteps), dtype=np.int32).reshape(len(self.games), behavior.agents)
            step.ended = lanes[list(ended)].reshape(-1)
            step.terminated[step.ended] = [timestep.terminated for _, timestep in ends]
            step.truncated[step.ended] = [timestep.truncated for _, timestep in ends]
            step.final_observations = observations(behavior, ends)
            step.metrics = metrics(behavior, ends)
            if any(end.interrupted for end in ended.values()):
                step.interrupted = np.repeat([end.interrupted for end in ended.values()], behavior.agents)
            if self.distributions:
                rows = [end.parameters for end in ended.values() for _ in behavior.slots]
                step.parameters = np.array(rows, np.float32)
        deciding = np.array([timestep.deciding for _, timestep in timesteps])
        if not deciding.all():
            step.deciding = deciding
        due = deciding | step.ends
        require_finite(f"{behavior.name}: a reward", self.earned[b], timesteps)
        step.rewards[due] = self.earned[b][due]
        self.earned[b][due] = 0.0
        return step
