"""Many one-arena games as one batch: makes an author's `Game` into the `BatchedGame` that the service runs."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.simulator.batched_game import BatchedGame, GameError
from joybridge.simulator.game import Action, Game, Turn
from joybridge.v1 import bridge_pb2 as pb


def batched(game: type[Game]) -> type["Arenas"]:
    """Return the BatchedGame class of an author's one-arena game."""
    members = {"name": game.name, "description": game.description, "game": game}
    return type(game.__name__, (Arenas,), members)


Places = list[tuple[int, Turn]]  # turns with the arenas they are from


class Arenas(BatchedGame):
    """A batch of one author's game; `batched` makes the subclass.

    What an author returns is checked here, so a mistake is an error that names the arena and never data.
    """

    game: ClassVar[type[Game]]

    @classmethod
    def options(cls) -> list[pb.Option]:
        """Return the author's options."""
        return list(cls.game.options)

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the author's spec."""
        return cls.game.describe(options)

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Make the arenas, each with its own generator, and begin a first episode in each."""
        self.spec = self.describe(options)
        self.first_arena = first_arena
        # One (behavior index, agent number) per agent of an arena, in the order of the author's lists.
        self.agents = [(b, a) for b, kind in enumerate(self.spec.behaviors) for a in range(kind.agents_per_arena)]
        self.parameters = {p.name: p.default_value for p in self.spec.parameters}
        self.arenas, self.option = arenas, options
        self.reset(seed, parameters)

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin new episodes everywhere; see BatchedGame."""
        self.parameters.update(parameters)
        if seed is not None:  # new games, too: an author's may remember its episodes
            self.games = [self.game() for _ in range(self.arenas)]
            for arena, game in enumerate(self.games):
                game.option, game.parameter = self.option, self.parameters
                key = np.array([seed, self.first_arena + arena], np.uint64)  # a list of both may become float64
                game.rng = np.random.Generator(np.random.Philox(key=key))
        self.turns = [self._reset(arena) for arena in range(len(self.games))]
        # What lanes that wait have earned since they last decided.
        self.earned = [
            np.zeros((len(self.games) * kind.agents_per_arena, len(kind.channels)), np.float32)
            for kind in self.spec.behaviors
        ]

    def observe(self) -> list[StepArrays]:
        """Return the present observations, with zero rewards and no ends."""
        return [self._behavior_step(b, {}) for b in range(len(self.spec.behaviors))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision; an arena whose agents end begins its next episode at once."""
        ended: dict[int, list[Turn]] = {}
        for arena, game in enumerate(self.games):
            actions = [self._action(acts[b], b, a, arena) for b, a in self.agents]
            turns = self._turns(arena, game.step, actions[0] if len(actions) == 1 else actions)
            self._earn(arena, turns)
            if turns[0].terminated or turns[0].truncated:
                ended[arena] = turns
                turns = self._reset(arena)
            self.turns[arena] = turns
        return [self._behavior_step(b, ended) for b in range(len(self.spec.behaviors))]

    def draw(self, arena: int) -> Array:
        """Return the author's picture of one arena."""
        with _naming(arena):
            return self.games[arena].draw()

    def _reset(self, arena: int) -> list[Turn]:
        turns = self._turns(arena, self.games[arena].reset)
        if turns[0].terminated or turns[0].truncated:
            raise GameError(f"arena {arena}: reset returned an end; it begins an episode, return transition(...)")
        return turns

    def _action(self, act: ActArrays, b: int, agent: int, arena: int) -> Action:
        """Return one agent's action by name."""
        device = self.spec.behaviors[b].device
        lane = arena * self.spec.behaviors[b].agents_per_arena + agent
        action: Action = {axis.name: float(v) for axis, v in zip(device.axes, act.axes[lane], strict=True)}
        action |= {branch.name: int(v) for branch, v in zip(device.branches, act.choices[lane], strict=True)}
        return action

    def _turns(self, arena: int, play: Callable[..., Any], *actions: Any) -> list[Turn]:
        """Return what one arena's game answers, after checking that all agents get a turn and end together."""
        with _naming(arena):
            answer = play(*actions)
        turns: list[Turn] = [answer] if isinstance(answer, Turn) else answer
        if not (isinstance(turns, list | tuple) and all(isinstance(turn, Turn) for turn in turns)):
            raise GameError(f"arena {arena}: got {answer!r}, expected transition(...) or its like, one per agent")
        if len(turns) != len(self.agents):
            raise GameError(f"arena {arena}: got {len(turns)} turns, expected {len(self.agents)}, one per agent")
        if len({(turn.terminated, turn.truncated) for turn in turns}) != 1:
            raise GameError(f"arena {arena}: some agents ended and others did not; all of an arena end together")
        return turns

    def _earn(self, arena: int, turns: list[Turn]) -> None:
        for (b, agent), turn in zip(self.agents, turns, strict=True):
            kind = self.spec.behaviors[b]
            names = [channel.name for channel in kind.channels]
            _require_known(arena, f"{kind.name}: reward channel", turn.rewards, names)
            for name, value in turn.rewards.items():
                self.earned[b][arena * kind.agents_per_arena + agent, names.index(name)] += value

    def _behavior_step(self, b: int, ended: Mapping[int, list[Turn]]) -> StepArrays:
        """Collect one behavior's lanes into arrays."""
        kind = self.spec.behaviors[b]
        slots = [slot for slot, (behavior, _) in enumerate(self.agents) if behavior == b]
        turns = [(arena, self.turns[arena][slot]) for arena in range(len(self.games)) for slot in slots]
        ends = [(arena, ended[arena][slot]) for arena in ended for slot in slots]
        lanes = np.arange(len(turns)).reshape(len(self.games), len(slots))
        step = StepArrays(
            self._observations(kind, turns), np.zeros_like(self.earned[b]), np.zeros(len(turns), bool),
            np.zeros(len(turns), bool), self._masks(kind, turns),
        )  # fmt: skip
        for arena, turn in ends:
            step.terminated[lanes[arena]] = turn.terminated
            step.truncated[lanes[arena]] = turn.truncated
        deciding = np.array([turn.deciding for _, turn in turns])
        if not deciding.all():
            step.deciding = deciding
        due = deciding | step.terminated | step.truncated
        _require_finite(f"{kind.name}: a reward", self.earned[b], turns)
        step.rewards[due] = self.earned[b][due]
        self.earned[b][due] = 0.0
        if ends:
            step.ended = lanes[list(ended)].reshape(-1).astype(np.int32)
            step.final_observations = self._observations(kind, ends)
            step.metrics = self._metrics(kind, ends)
        return step

    @staticmethod
    def _observations(kind: pb.Behavior, turns: Places) -> list[Array]:
        columns = []
        for sensor in kind.sensors:
            where = f"{kind.name}: sensor {sensor.name!r}"
            column = np.empty((len(turns), *sensor.shape), NUMPY_TYPES[sensor.dtype])
            for row, (arena, turn) in enumerate(turns):
                if sensor.name not in turn.observation:
                    raise GameError(f"arena {arena}: {where} is in the spec but not in the observation")
                value = turn.observation[sensor.name]
                if np.shape(value) != column.shape[1:]:
                    came, wanted = list(np.shape(value)), list(sensor.shape)
                    raise GameError(f"arena {arena}: {where} has shape {came}, expected {wanted}")
                column[row] = value
            _require_finite(where, column, turns)
            columns.append(column)
        return columns

    @staticmethod
    def _masks(kind: pb.Behavior, turns: Places) -> list[Array] | None:
        if not any(turn.masks for _, turn in turns):
            return None
        choices = {branch.name: len(branch.choices) for branch in kind.device.branches}
        for arena, turn in turns:
            _require_known(arena, f"{kind.name}: masked branch", turn.masks, choices)
            for name, mask in turn.masks.items():
                if len(mask) != choices[name] or not any(mask):
                    came, wanted = list(mask), f"{choices[name]} booleans that are not all false"
                    raise GameError(f"arena {arena}: {kind.name}: mask of {name!r} is {came}, expected {wanted}")
        return [
            np.array([turn.masks.get(name, [True] * count) for _, turn in turns], bool)
            for name, count in choices.items()
        ]

    @staticmethod
    def _metrics(kind: pb.Behavior, ends: Places) -> Array | None:
        names = [metric.name for metric in kind.metrics]
        for arena, turn in ends:
            _require_known(arena, f"{kind.name}: metric", turn.metrics, names)
        metrics = np.array([[turn.metrics.get(name, 0.0) for name in names] for _, turn in ends], np.float32)
        _require_finite(f"{kind.name}: a metric of {names}", metrics, ends)
        return metrics if names else None


@contextmanager
def _naming(arena: int) -> Iterator[None]:
    """Name the arena whose game fails in here, or calls exit."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise GameError(f"arena {arena}: {type(error).__name__}: {error}") from error


def _require_known(arena: int, what: str, given: Iterable[str], known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise GameError(f"arena {arena}: {what} {name!r} is not in the spec, which has {list(known)}")


def _require_finite(what: str, rows: Array, turns: Places) -> None:
    if not np.isfinite(rows).all():
        row, *_ = np.argwhere(~np.isfinite(rows))[0]
        raise GameError(f"arena {turns[row][0]}: {what} is {rows[row].tolist()}, expected finite numbers")
