"""Turn an author's one-arena `Game` into the `BatchedGame` that the server runs.

Everything that an author returns is checked here: a mistake raises a GameError that names the arena.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.simulator.batched_game import BatchedGame, GameError
from joybridge.simulator.game import Action, Game, TimeStep
from joybridge.v1 import bridge_pb2 as pb


def batched(game: type[Game]) -> type["GameAdapter"]:
    """Return the BatchedGame class that runs many arenas of a one-arena game."""
    names = ("name", "description", "options", "in_event_loop")
    members = {name: getattr(game, name) for name in names} | {"game": game}
    return type(game.__name__, (GameAdapter,), members)


Rows = list[tuple[int, TimeStep]]  # timesteps, each with the number of its arena


class GameAdapter(BatchedGame):
    """Many arenas of one author's game. `batched` creates the subclass for a game."""

    game: ClassVar[type[Game]]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the author's spec."""
        return cls.game.describe(options)

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Create the arenas, each with its own random generator, and begin a first episode in each."""
        self.spec = self.describe(options)
        self.first_arena = first_arena
        # One (behavior index, agent number) per agent of an arena, in the order of the author's lists.
        counts = [behavior.agents_per_arena for behavior in self.spec.behaviors]
        self.agents = [(b, agent) for b, count in enumerate(counts) for agent in range(count)]
        self.parameters = {p.name: p.default_value for p in self.spec.parameters}
        self.arenas, self.option = arenas, options
        self.reset(seed, parameters)

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        self.parameters.update(parameters)
        if seed is not None:  # create the games anew: they may keep state between episodes
            self.games = [self.game() for _ in range(self.arenas)]
            for arena, game in enumerate(self.games):
                game.option, game.parameter = self.option, self.parameters
                # With the dtype, because NumPy would make floats of a list with a large seed.
                key = np.array([seed, self.first_arena + arena], np.uint64)
                game.rng = np.random.Generator(np.random.Philox(key=key))
        self.timesteps = [self._reset(arena) for arena in range(len(self.games))]
        # Per behavior [lanes, channels]: rewards since the lane's last decision, for lanes that wait.
        self.earned = [
            np.zeros((len(self.games) * behavior.agents_per_arena, len(behavior.channels)), np.float32)
            for behavior in self.spec.behaviors
        ]

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [self._behavior_step(b, {}) for b in range(len(self.spec.behaviors))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. Where the episode ends, the next one begins in the same step."""
        ended: dict[int, list[TimeStep]] = {}
        for arena, game in enumerate(self.games):
            actions = [self._action(acts[b], b, a, arena) for b, a in self.agents]
            timesteps = self._timesteps(arena, game.step, actions[0] if len(actions) == 1 else actions)
            with _naming(arena):
                self._earn(arena, timesteps)
            if timesteps[0].terminated or timesteps[0].truncated:
                ended[arena] = timesteps
                timesteps = self._reset(arena)
            self.timesteps[arena] = timesteps
        return [self._behavior_step(b, ended) for b in range(len(self.spec.behaviors))]

    def draw(self, arena: int) -> Array:
        """Return the author's picture of one arena."""
        with _naming(arena):
            return self.games[arena].draw()

    def _reset(self, arena: int) -> list[TimeStep]:
        timesteps = self._timesteps(arena, self.games[arena].reset)
        if timesteps[0].terminated or timesteps[0].truncated:
            raise GameError(f"arena {arena}: reset returned an episode's end, expected transition(...) or waiting(...)")
        return timesteps

    def _action(self, act: ActArrays, b: int, agent: int, arena: int) -> Action:
        """Return one agent's action by name."""
        device = self.spec.behaviors[b].device
        lane = arena * self.spec.behaviors[b].agents_per_arena + agent
        action: Action = {axis.name: float(v) for axis, v in zip(device.axes, act.axes[lane], strict=True)}
        action |= {branch.name: int(v) for branch, v in zip(device.branches, act.choices[lane], strict=True)}
        return action

    def _timesteps(self, arena: int, play: Callable[..., Any], *actions: Any) -> list[TimeStep]:
        """Call `reset` or `step` of one arena and return a timestep per agent, checked."""
        with _naming(arena):
            result = play(*actions)
        timesteps: list[TimeStep] = [result] if isinstance(result, TimeStep) else result
        if not (isinstance(timesteps, list | tuple) and all(isinstance(one, TimeStep) for one in timesteps)):
            raise GameError(
                f"arena {arena}: got {result!r}, expected a TimeStep per agent, for example from transition(...)"
            )
        if len(timesteps) != len(self.agents):
            raise GameError(
                f"arena {arena}: got {len(timesteps)} timesteps, expected {len(self.agents)}, one per agent"
            )
        if len({one.terminated or one.truncated for one in timesteps}) != 1:
            raise GameError(f"arena {arena}: the episode ended for some agents only, expected its end for all of them")
        return timesteps

    def _earn(self, arena: int, timesteps: list[TimeStep]) -> None:
        for (b, agent), timestep in zip(self.agents, timesteps, strict=True):
            behavior = self.spec.behaviors[b]
            names = [channel.name for channel in behavior.channels]
            _require_known(f"{behavior.name}: reward channel", timestep.rewards, names)
            for name, value in timestep.rewards.items():
                self.earned[b][arena * behavior.agents_per_arena + agent, names.index(name)] += value

    def _behavior_step(self, b: int, ended: Mapping[int, list[TimeStep]]) -> StepArrays:
        """Collect one behavior's lanes into arrays."""
        behavior = self.spec.behaviors[b]
        slots = [slot for slot, (index, _) in enumerate(self.agents) if index == b]
        timesteps = [(arena, self.timesteps[arena][slot]) for arena in range(len(self.games)) for slot in slots]
        ends = [(arena, ended[arena][slot]) for arena in ended for slot in slots]
        lanes = np.arange(len(timesteps)).reshape(len(self.games), len(slots))
        step = StepArrays(
            self._observations(behavior, timesteps), np.zeros_like(self.earned[b]), np.zeros(len(timesteps), bool),
            np.zeros(len(timesteps), bool), self._masks(behavior, timesteps),
        )  # fmt: skip
        ended_lanes = lanes[list(ended)].reshape(-1)
        step.terminated[ended_lanes] = [timestep.terminated for _, timestep in ends]
        step.truncated[ended_lanes] = [timestep.truncated for _, timestep in ends]
        deciding = np.array([timestep.deciding for _, timestep in timesteps])
        if not deciding.all():
            step.deciding = deciding
        due = deciding | step.terminated | step.truncated
        _require_finite(f"{behavior.name}: a reward", self.earned[b], timesteps)
        step.rewards[due] = self.earned[b][due]
        self.earned[b][due] = 0.0
        if ends:
            step.ended = ended_lanes.astype(np.int32)
            step.final_observations = self._observations(behavior, ends)
            step.metrics = self._metrics(behavior, ends)
        return step

    @staticmethod
    def _observations(behavior: pb.Behavior, timesteps: Rows) -> list[Array]:
        columns = []
        for sensor in behavior.sensors:
            where = f"{behavior.name}: sensor {sensor.name!r}"
            column = np.empty((len(timesteps), *sensor.shape), NUMPY_TYPES[sensor.dtype])
            for row, (arena, timestep) in enumerate(timesteps):
                if sensor.name not in timestep.observation:
                    raise GameError(f"arena {arena}: {where} is in the spec but not in the observation")
                value = timestep.observation[sensor.name]
                if np.shape(value) != column.shape[1:]:
                    came, wanted = list(np.shape(value)), list(sensor.shape)
                    raise GameError(f"arena {arena}: {where} has shape {came}, expected {wanted}")
                try:
                    column[row] = value
                except Exception as error:  # it is no number, or too large for the dtype
                    raise GameError(f"arena {arena}: {where}: {type(error).__name__}: {error}") from error
            _require_finite(where, column, timesteps)
            columns.append(column)
        return columns

    @staticmethod
    def _masks(behavior: pb.Behavior, timesteps: Rows) -> list[Array] | None:
        if not any(timestep.masks for _, timestep in timesteps):
            return None
        choices = {branch.name: len(branch.choices) for branch in behavior.device.branches}
        for arena, timestep in timesteps:
            with _naming(arena):
                _require_known(f"{behavior.name}: masked branch", timestep.masks, choices)
                for name, mask in timestep.masks.items():
                    if len(mask) != choices[name] or not any(mask):
                        came, wanted = list(mask), f"{choices[name]} booleans that are not all false"
                        raise GameError(f"{behavior.name}: mask of {name!r} is {came}, expected {wanted}")
        return [
            np.array([timestep.masks.get(name, [True] * count) for _, timestep in timesteps], bool)
            for name, count in choices.items()
        ]

    @staticmethod
    def _metrics(behavior: pb.Behavior, ends: Rows) -> Array | None:
        names = [metric.name for metric in behavior.metrics]
        metrics = np.empty((len(ends), len(names)), np.float32)
        for row, (arena, timestep) in enumerate(ends):
            with _naming(arena):
                _require_known(f"{behavior.name}: metric", timestep.metrics, names)
                metrics[row] = [timestep.metrics.get(name, 0.0) for name in names]
        _require_finite(f"{behavior.name}: a metric of {names}", metrics, ends)
        return metrics if names else None


@contextmanager
def _naming(arena: int) -> Iterator[None]:
    """Add the number of the arena to whatever its game raises; a call of exit() is an error as well."""
    try:
        yield
    except GameError as error:
        raise GameError(f"arena {arena}: {error}") from error
    except BaseException as error:
        raise GameError(f"arena {arena}: {type(error).__name__}: {error}") from error


def _require_known(what: str, given: Iterable[str], known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise GameError(f"{what} {name!r} is not in the spec, which has {list(known)}")


def _require_finite(what: str, rows: Array, timesteps: Rows) -> None:
    if not np.isfinite(rows).all():
        row, *_ = np.argwhere(~np.isfinite(rows))[0]
        raise GameError(f"arena {timesteps[row][0]}: {what} is {rows[row].tolist()}, expected finite numbers")
