"""Several games that one policy plays: their common spec, which lanes play which, and how each is translated.

The common spec has one behavior, `player`, with the common sensors and the common device, one reward channel, which is
the weighted sum of the game's own, and the metrics of all games, each after the name of its game.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from joybridge.client.client import describe
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_settings
from joybridge.config.games import GameConfig
from joybridge.config.metrics import column_name
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.sharding import split
from joybridge.contract.tensors import Array
from joybridge.layouts.common_device import Common, Placed, common_device
from joybridge.layouts.conditions import Conditions, ConditionsOfGames
from joybridge.layouts.layout import Layout
from joybridge.policy.common_observation import View, common_sensors
from joybridge.v1 import bridge_pb2 as pb

BEHAVIOR = "player"  # the behavior of the common spec, and so the policy


class GameTranslation:
    """How the lanes of one game become lanes of the common spec."""

    def __init__(
        self, own: pb.Behavior, view: View, placed: Placed, common: pb.Behavior, weights: Array, columns: Sequence[int]
    ) -> None:
        """Take the behavior of the game and how its parts lie in the common one.

        weights: of its reward channels. columns: of its metrics among the common ones.
        """
        self._view, self._weights = view, weights
        self._axes, self._branches, signs = placed
        low, high = (np.array([getattr(axis, end) for axis in own.device.axes], np.float32) for end in ("low", "high"))
        self._middle, self._half = (low + high) / 2, np.array(signs, np.float32) * (high - low) / 2
        self._low, self._high = low, high
        self._first = [np.arange(len(branch.choices)) == 0 for branch in common.device.branches]  # all that is allowed
        self._sizes = [len(branch.choices) for branch in own.device.branches]
        used = dict(zip(self._branches, self._sizes, strict=True))
        widths = [len(branch.choices) for branch in common.device.branches]
        self._whole = [used.get(index) for index in range(len(widths))] == widths  # it uses all that there is
        self._metrics, self._columns = len(common.metrics), list(columns)
        self._widths = len(common.device.axes), len(common.device.branches)

    def step(self, step: StepArrays) -> StepArrays:
        """Return a step of the game as one of the common spec."""
        seen = StepArrays(
            self._view.see(step.observations),
            (step.rewards @ self._weights)[:, None],
            step.terminated,
            step.truncated,
            self._masks(step.masks, len(step.rewards)),
            step.deciding,
            step.ended,
            interrupted=step.interrupted,
        )
        if step.final_observations is not None:
            seen.final_observations = self._view.see(step.final_observations)
            seen.metrics = np.full((len(step.ended), self._metrics), np.nan, np.float32)
            if step.metrics is not None:
                seen.metrics[:, self._columns] = step.metrics
        return seen

    def act(self, act: ActArrays) -> ActArrays:
        """Return what the game's device gets, from the actions of the common device."""
        axes = np.clip(self._middle + self._half * act.axes[:, self._axes], self._low, self._high)
        return ActArrays(axes, act.choices[:, self._branches])

    def demonstrated(self, act: ActArrays) -> ActArrays:
        """Return actions of the game's device as those of the common one; what the game lacks is at rest."""
        axes = np.zeros((len(act.axes), self._widths[0]), np.float32)
        choices = np.zeros((len(act.axes), self._widths[1]), np.int32)
        axes[:, self._axes] = np.clip((act.axes - self._middle) / self._half, -1, 1)
        choices[:, self._branches] = act.choices
        return ActArrays(axes, choices)

    def _masks(self, masks: Sequence[Array] | None, lanes: int) -> list[Array] | None:
        """Return which choices of the common device a game allows: only the first of what it lacks."""
        if masks is None and self._whole:
            return None
        allowed = [np.tile(first, (lanes, 1)) for first in self._first]
        for number, (branch, size) in enumerate(zip(self._branches, self._sizes, strict=True)):
            allowed[branch][:, :size] = True if masks is None else masks[number]
        return allowed


@dataclass(frozen=True)
class Lineup:
    """The games of a configuration."""

    games: dict[str, GameConfig]
    specs: dict[str, pb.GameSpec]  # the games' own
    common: Common
    views: dict[str, View]
    spec: pb.GameSpec  # the common one
    by_progress: bool  # see `share_by` of `Config`

    def lines(self) -> Iterator[str]:
        """Yield in lines what each part of the common device does in each game, and what the policy sees."""
        yield from self.common.lines({name: spec.behaviors[0].device for name, spec in self.specs.items()})
        sensors = ", ".join(f"{sensor.name} {list(sensor.shape)}" for sensor in self.spec.behaviors[0].sensors)
        yield f"sees {sensors}"

    def has_options(self, game: str, options: Mapping[str, str]) -> bool:
        """Return whether a game is played with these options; those that are not named have their defaults."""
        offered, played = self.specs[game].options, self.games[game].options
        defaults = {one.name: one.default_choice for one in offered}
        return {**defaults, **played} == {**defaults, **options}

    def spec_of(self, game: str) -> pb.GameSpec:
        """Return the common spec when only one game is played: with its clock and picture, its metrics and kinds."""
        own, spec = self.specs[game], pb.GameSpec()
        spec.CopyFrom(own)
        del spec.behaviors[:], spec.options[:], spec.parameters[:]
        spec.behaviors.extend(self.spec.behaviors)
        del spec.behaviors[0].metrics[:]
        spec.behaviors[0].metrics.extend(own.behaviors[0].metrics)
        spec.version = self.spec.version
        axes = spec.behaviors[0].device.axes
        for index, axis in zip(self.common.games[game].axes, own.behaviors[0].device.axes, strict=True):
            axes[index].kind = axis.kind
        return spec

    def translation(self, game: str, *, alone: bool = False) -> GameTranslation:
        """Return how a game is translated. alone: to `spec_of`."""
        own = self.specs[game].behaviors[0]
        common = (self.spec_of(game) if alone else self.spec).behaviors[0]
        given = {channel.name: channel.default_weight for channel in own.channels} | self.games[game].reward_weights
        weights = np.array([given[channel.name] for channel in own.channels], np.float32)
        names = [metric.name for metric in common.metrics]
        columns = [names.index(one.name if alone else _metric(game, one.name)) for one in own.metrics]
        return GameTranslation(own, self.views[game], self.common.games[game], common, weights, columns)

    def conditions(self, layout: Layout, kinds: Array, *, only_with: bool) -> ConditionsOfGames:
        """Return which parts of a policy's actions count in some lanes. kinds int [lanes]: which game each plays.

        only_with: axes that count only with some choices do so; what a game lacks never counts.
        """
        device, games = self.common.device, []
        for game, placed in self.common.games.items():
            no_axes = {*range(len(device.axes))} - {*placed.axes}
            no_branches = {*range(len(device.branches))} - {*placed.branches}
            used = self.common.used_as(game, self.specs[game].behaviors[0].device) if only_with else device
            games.append(Conditions(layout, used, no_axes, no_branches))
        return ConditionsOfGames(games, kinds)


def make_lineup(address: str, config: Config) -> Lineup:
    """Return the games of a configuration, each described at its own simulator or at this one.

    Raises SimulatorError, and ConfigError for what a game lacks or games that cannot be played by one policy.
    """
    games = config.played
    specs = {name: _describe(name, one, one.simulator or address) for name, one in games.items()}
    behaviors = {name: spec.behaviors[0] for name, spec in specs.items()}
    common = common_device({name: one.device for name, one in behaviors.items()}, config.common_device)
    sensors, views = common_sensors(
        {name: [*one.sensors] for name, one in behaviors.items()},
        {name: one.sensors for name, one in games.items()},
        tell_game=config.tell_game,
    )
    metrics = [
        pb.Metric(name=_metric(name, metric.name), description=metric.description)
        for name, one in behaviors.items()
        for metric in one.metrics
    ]
    player = pb.Behavior(
        name=BEHAVIOR,
        agents_per_arena=1,
        sensors=sensors,
        device=common.device,
        metrics=metrics,
        channels=[pb.RewardChannel(name="reward", default_weight=1.0)],
    )
    saved = [spec.snapshot_bytes_per_arena for spec in specs.values()]
    spec = pb.GameSpec(
        name=config.game,
        description=f"Several games: {', '.join(games)}"[:1000],
        behaviors=[player],
        decision_interval=1,
        max_arenas=min(spec.max_arenas for spec in specs.values()),
        snapshot_bytes_per_arena=sum(saved) if all(saved) else 0,
        version=", ".join(f"{name} {spec.version}" for name, spec in specs.items())[:100],
    )
    return Lineup(games, specs, common, views, spec, config.share_by == "progress")


def _metric(game: str, metric: str) -> str:
    """Return the column of a metric of one of several games, which is none that the trainer writes for each game."""
    return f"{game}.game_{metric}" if metric == "share" else f"{game}.{column_name(metric)}"


def _describe(name: str, game: GameConfig, address: str) -> pb.GameSpec:
    """Return the spec of one game, checked against its keys. Raises SimulatorError and ConfigError."""
    try:
        if game.options:  # with a wrong option there would be no spec
            check_settings(game.options, game.parameters, describe(address, game.game, {}))
        spec = describe(address, game.game, game.options)
        check_settings(game.options, game.parameters, spec)
    except ConfigError as error:
        raise ConfigError(f"games.{name}.{error}") from error
    behavior = spec.behaviors[0]
    if len(spec.behaviors) > 1 or behavior.agents_per_arena > 1:
        agents = sum(one.agents_per_arena for one in spec.behaviors)
        raise ConfigError(f"games.{name}: {game.game} has {agents} agents; several games are games of one agent each")
    channels = [channel.name for channel in behavior.channels]
    for channel in game.reward_weights:
        if channel not in channels:
            raise ConfigError(f"games.{name}.reward_weights: there is no {channel!r}; it has {', '.join(channels)}")
    return spec


def arenas_by_game(config: Config) -> list[list[int]]:
    """Return how many arenas each game has in each group, [groups][games].

    The arenas of the run are divided by the shares, at least one for each game; so timesteps are, too.
    """
    shares = np.array([game.share for game in config.played.values()])
    exact = config.arenas * shares / shares.sum()
    counts = np.maximum(exact.astype(int), 1)
    while counts.sum() < config.arenas:
        counts[np.argmax(exact - counts)] += 1
    while counts.sum() > config.arenas:
        counts[np.argmax(np.where(counts > 1, counts - exact, -np.inf))] -= 1
    bounds = [split(int(count), min(config.pipeline_groups, int(counts.min()))) for count in counts]
    sizes = [[end - first for first, end in pairwise(each)] for each in bounds]
    return [list(group) for group in zip(*sizes, strict=True)]


def kinds_of(groups: Sequence[Sequence[int]]) -> Array:
    """Return which game each lane plays, int [lanes], from the arenas of each game in each group."""
    return np.concatenate([np.repeat(np.arange(len(games)), games) for games in groups])
