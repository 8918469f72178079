"""The games of any joybridge.v1 server as Gymnasium and PettingZoo environments.

    envs = BridgeVectorEnv("shooting_birds", arenas=15)                 many arenas, one call for all of them
    env = BridgeEnv("shooting_birds", layout="hybrid")                  one arena
    env = BridgeParallelEnv("shooting_birds", layout="multiagent")      PettingZoo: one arena, an agent per policy

Importing this module registers the built-in games, for `gymnasium.make("joybridge/ShootingBirds-v0")` and
`gymnasium.make_vec`; "trainer.gym:joybridge/ShootingBirds-v0" names one without an import. It needs no torch.

An observation is the sensors in the spec's order, flattened side by side, float32, and the last `stack` of
those frames, oldest first, zeros before an episode's first. A reward is the weighted sum of the channels. The
action space is what the layout (trainer/actions.py) gives a policy: MultiDiscrete, or a Box of -1..1 whose ends
are the layout's clipping, or for both a Dict of the Box as "continuous" and the MultiDiscrete as "discrete".

An info names "action_mask" where the game forbids choices in this step and "deciding" where some lane waits; the
actions of lanes that wait are ignored. Where an episode has ended, its info is its metrics by name.

Without the address of a simulator an environment runs its own, and ends it when it is closed or collected. gRPC
does not survive a fork: a process that has had an environment starts others by spawning, as AsyncVectorEnv does with
context="spawn". BridgeVectorEnv needs none.
"""

import weakref
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.spaces import Box, Dict, MultiDiscrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from pettingzoo import ParallelEnv

from joybridge.codec import ActArrays, StepArrays
from joybridge.spec import MAX_PICTURES, choose_parameters, element_count
from joybridge.tensors import Array
from joybridge.v1 import bridge_pb2 as pb
from trainer.actions import CLIP, Layout, make_layouts
from trainer.client import Session
from trainer.launch import simulator_process

REGISTERED = {"ShootingBirds": "shooting_birds", "BeastlyRivals": "beastly_rivals"}  # joybridge/NAME-v0 -> game
TURN_BASED_FPS = 5.0  # of games without a clock
_RANGES = {pb.FLOAT32: (-np.inf, np.inf), pb.INT32: (-(2.0**31), 2.0**31), pb.UINT8: (0.0, 255.0), pb.BOOL: (0.0, 1.0)}

Outcome = tuple[Array, float, bool, bool, dict[str, Any]]  # observation, reward, terminated, truncated, info


class BridgeVectorEnv(VectorEnv):  # type: ignore[misc]
    """Arenas of a game with one behaviour; its lanes, arenas × agents, are the `num_envs`.

    An episode that ends is followed by the next one in the same step: observations already belong to that, and
    infos hold the last of the old one, "final_obs", and its metrics, "final_info". "action_mask" is bool
    [num_envs, choices of all branches side by side]. Rewards are float64. A broken connection or a refusal of the
    simulator raises SimulatorError and is the end of the environment.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        game: str,
        arenas: int = 15,
        layout: str = "bucket-11",
        stack: int = 3,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        simulator: str | None = None,
        channels: Mapping[str, float] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open a session at `simulator` (HOST:PORT or unix:PATH), or at one of one's own.

        seed: of what is played until a reset gives another one. options and parameters: the game's, by name.
        channels: weights of reward channels, where they differ from the game's defaults.

        Raises ValueError for arguments that fit no game or not this one, SimulatorError where the simulator
        refuses, SimulatorLost where it cannot be reached.
        """
        self._bridge = _Bridge(
            game, arenas=arenas, layout=layout, stack=stack, seed=seed, options=options, parameters=parameters,
            simulator=simulator, channels=channels, render_mode=render_mode, single=True, split=False,
        )  # fmt: skip
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = render_mode
        (self._player,) = self._bridge.players.values()
        self.num_envs = arenas * self._player.behaviour.agents_per_arena
        self.single_observation_space = self._player.lanes.space
        self.single_action_space = self._player.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes everywhere; return observations and infos.

        With a seed, what follows is what a new environment with it would play. Without, the arenas' random streams
        go on; where all episodes have only just begun, at the start or as all ended in the last step, those are taken.
        options: {"parameters": {name: value}} changes parameters of the game. Raises ValueError.
        """
        seed = self._bridge.reset(seed, _parameters(options))
        super().reset(seed=seed)
        return self._player.lanes.now.copy(), self._infos()

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advance every arena by one decision. Raises ValueError for actions outside the action space's shape.

        Continuous actions outside -1..1 act like the nearest end.
        """
        self._bridge.play([(self._player, actions)])
        lanes, step = self._player.lanes, self._player.lanes.step
        infos = self._infos()
        if len(step.ended):
            infos |= self._final_infos()
        return lanes.now.copy(), self._player.rewards(), step.terminated.copy(), step.truncated.copy(), infos

    def render(self) -> tuple[Array, ...] | None:
        """Return the arenas' pictures after the last step, uint8 [height, width, 3] each.

        None before the first step after a reset, and without `render_mode`: the simulator draws with a step.
        """
        return tuple(picture.copy() for picture in self._bridge.pictures) or None

    def close_extras(self, **kwargs: Any) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()

    def _infos(self) -> dict[str, Any]:
        infos = self._player.infos()
        return infos | {f"_{name}": np.ones(self.num_envs, bool) for name in infos}

    def _final_infos(self) -> dict[str, Any]:
        lanes, ended = self._player.lanes, self._player.lanes.step.ended
        present = np.zeros(self.num_envs, bool)
        present[ended] = True
        observations = np.full(self.num_envs, None, object)
        for lane in ended:
            observations[lane] = lanes.last[lane].copy()
        info: dict[str, Array] = {}
        for name, column in lanes.metrics().items():
            values = np.zeros(self.num_envs, np.float32)
            values[ended] = column
            info |= {name: values, f"_{name}": present.copy()}
        return {
            "final_obs": observations, "_final_obs": present.copy(),
            "final_info": info, "_final_info": present.copy(),
        }  # fmt: skip


class BridgeEnv(gymnasium.Env):  # type: ignore[misc]
    """One arena of a game with one agent. An info's "action_mask" is what `action_space.sample` takes as mask."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, game: str, **settings: Any) -> None:
        """Open a session; settings are the arguments of BridgeVectorEnv but `arenas`, and the errors are its."""
        self._bridge = _Bridge(game, **settings, single=True, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = settings.get("render_mode")
        (self._player,) = self._bridge.players.values()
        self.observation_space = self._player.lanes.space
        self.action_space = self._player.space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, as BridgeVectorEnv does; return observation and info. Raises ValueError."""
        seed = self._bridge.reset(seed, _parameters(options))
        super().reset(seed=seed)
        return self._player.first()

    def step(self, action: Any) -> Outcome:
        """Play one decision. Raises ValueError for an action outside the action space's shape."""
        self._bridge.play([(self._player, _one_row(action))])
        outcome = self._player.outcome()
        self._bridge.playing = not (outcome[2] or outcome[3])
        return outcome

    def render(self) -> Array | None:
        """Return the picture after the last step, uint8 [height, width, 3]; None without `render_mode`.

        The simulator draws with a step: where an episode ended in it, the picture is of the next one's beginning,
        and before the first step it is black.
        """
        return self._bridge.picture()

    def close(self) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()


class BridgeParallelEnv(ParallelEnv):  # type: ignore[misc]
    """One arena of any game as a PettingZoo environment, with an agent for each policy of each agent of the game.

    A policy that holds a whole device is named after its behaviour, one that holds a part after the part ("axes" and
    "buttons" of the layout `multiagent`, which act together), with the behaviour's name in front where there are
    several; "_0", "_1" … follow where a behaviour has several agents. Each observes all sensors of its behaviour.
    """

    metadata: dict[str, Any] = {"name": "joybridge", "render_modes": ["rgb_array"], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, game: str, **settings: Any) -> None:
        """Open a session; settings are the arguments of BridgeVectorEnv but `arenas`, and the errors are its.

        channels: reward weights per agent, {agent: {channel: weight}}.
        """
        self._bridge = _Bridge(game, **settings, single=False, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = settings.get("render_mode")
        self.possible_agents = list(self._bridge.players)
        self.agents: list[str] = []

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations."""
        return self._bridge.players[agent].lanes.space

    def action_space(self, agent: str) -> Box | MultiDiscrete | Dict:
        """Return the space of an agent's actions."""
        return self._bridge.players[agent].space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Begin an episode, as BridgeVectorEnv does; return observations and infos by agent.

        What options hold besides "parameters" is ignored, as PettingZoo's tests demand. Raises ValueError.
        """
        self._bridge.reset(seed, (options or {}).get("parameters", {}))
        self.agents = list(self.possible_agents)
        firsts = [player.first() for player in self._bridge.players.values()]
        observations, infos = (dict(zip(self.agents, column, strict=True)) for column in zip(*firsts, strict=True))
        return observations, infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Array], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Play one decision; return observations, rewards, terminations, truncations and infos by agent.

        Raises ValueError for an action that is missing, unless its agent waits, or outside its space's shape.
        """
        players = self._bridge.players
        for agent in self.agents:
            if agent not in actions and players[agent].decides():
                raise ValueError(f"actions has none of agent {agent!r}, expected one each of {', '.join(self.agents)}")
        self._bridge.play([(players[a], _one_row(actions[a])) for a in self.agents if a in actions])
        outcomes = {agent: players[agent].outcome() for agent in self.agents}
        self.agents = [agent for agent, outcome in outcomes.items() if not (outcome[2] or outcome[3])]
        self._bridge.playing = bool(self.agents)
        columns: Any = zip(*outcomes.values(), strict=True)
        observations, rewards, terminated, truncated, infos = (dict(zip(outcomes, c, strict=True)) for c in columns)
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Array | None:
        """Return the picture after the last step, uint8 [height, width, 3]; None without `render_mode`.

        The simulator draws with a step: where an episode ended in it, the picture is of the next one's beginning,
        and before the first step it is black.
        """
        return self._bridge.picture()

    def close(self) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()


class _Lanes:
    """One behaviour's lanes: their last step and their stacked observations, float32 [lanes, stack × frame].

    now: what the next decisions are based on. last: the same, but of lanes whose episode ended in the step the last
    they saw of it. As in training (trainer/rollout.py), frames of lanes that wait are not pushed.
    """

    step: StepArrays
    now: Array
    last: Array

    def __init__(self, behaviour: pb.Behaviour, stack: int) -> None:
        self.behaviour = behaviour
        bounds = [_bounds(sensor) for sensor in behaviour.sensors]
        low, high = (np.concatenate(ends) for ends in zip(*bounds, strict=True))
        self.frame = len(low)
        # Older frames may lie before the episode's first and are zero then; the newest never does.
        older = (np.tile(np.minimum(low, 0.0), stack - 1), np.tile(np.maximum(high, 0.0), stack - 1))
        self.space = Box(np.append(older[0], low), np.append(older[1], high), dtype=np.float32)

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        frames = _flatten(step.observations)
        self.step = step
        self.now = self.last = np.zeros((len(frames), *self.space.shape), np.float32)
        self.now[:, -self.frame :] = frames

    def push(self, step: StepArrays) -> None:
        """Take what followed a decision."""
        now = np.concatenate([self.now[:, self.frame :], _flatten(step.observations)], axis=1)
        if step.deciding is not None:
            waiting = ~(step.deciding | step.terminated | step.truncated)
            now[waiting] = self.now[waiting]
        self.step, self.now, self.last = step, now, now
        if len(step.ended):
            self.last = now.copy()
            self.last[step.ended, -self.frame :] = _flatten(step.final_observations or [])
            now[step.ended, : -self.frame] = 0.0

    def metrics(self) -> dict[str, Array]:
        """Return the metrics of the episodes that ended, [ended] each, by name."""
        columns = () if self.step.metrics is None else self.step.metrics.T
        return {metric.name: column for metric, column in zip(self.behaviour.metrics, columns, strict=False)}


class _Player:
    """One policy in some lanes of a behaviour: what it is paid, and how its actions reach the device."""

    def __init__(self, lanes: _Lanes, rows: slice, layout: Layout, channels: Mapping[str, float], where: str) -> None:
        """Make the spaces. where: what errors call the actions. Raises ValueError for an unknown channel."""
        self.lanes, self.rows, self.layout, self.where = lanes, rows, layout, where
        self.behaviour = behaviour = lanes.behaviour
        weights = {channel.name: channel.default_weight for channel in behaviour.channels}
        for name in channels:
            if name not in weights:
                raise ValueError(f"channels: {behaviour.name} has no {name!r}; it has {', '.join(weights)}")
        self.weights = np.array([channels.get(name, weight) for name, weight in weights.items()])
        self.parts: dict[str, Any] = {}
        if layout.space.continuous:
            self.parts["continuous"] = Box(-1.0, 1.0, (layout.space.continuous,), np.float32)
        if layout.space.branches:
            self.parts["discrete"] = MultiDiscrete(layout.space.branches)
        self.space = Dict(self.parts) if len(self.parts) > 1 else next(iter(self.parts.values()))

    def decides(self) -> bool:
        """Return whether any of the lanes decides next."""
        deciding = self.lanes.step.deciding
        return deciding is None or bool(deciding[self.rows].any())

    def write(self, actions: Any, act: ActArrays) -> None:
        """Write the lanes' actions [rows, …] into the player's part of `act`. Raises ValueError."""
        step, rows = self.lanes.step, self.rows
        masks = None if step.masks is None else [mask[rows] for mask in step.masks]
        continuous = self._part(actions, "continuous").astype(np.float64) * CLIP
        self.layout.write(
            continuous, self._part(actions, "discrete"), ActArrays(act.axes[rows], act.choices[rows]), masks
        )

    def _part(self, actions: Any, kind: str) -> Array:
        """Return the continuous or the discrete actions [rows, width], checked; 0 in lanes that wait."""
        step, where = self.lanes.step, self.where
        rows = len(step.rewards[self.rows])
        if kind not in self.parts:
            return np.zeros((rows, 0), np.int64)
        if len(self.parts) > 1:
            where = f"{where}[{kind!r}]"
            if not isinstance(actions, Mapping) or kind not in actions:
                raise ValueError(f"{where} is missing, expected a dict of continuous and discrete actions")
            actions = actions[kind]
        values: Array = np.asarray(actions)
        space = self.parts[kind]
        shape = [rows, *space.shape]
        kinds, wanted = ("iu", "integers") if kind == "discrete" else ("iuf", "numbers")
        if list(values.shape) != shape or values.dtype.kind not in kinds:
            raise ValueError(f"{where}: {values.dtype} of shape {list(values.shape)}, expected {wanted} of {shape}")
        if step.deciding is not None:
            values = np.where(step.deciding[self.rows, None], values, 0)
        wrong = (values < 0) | (values >= space.nvec) if kind == "discrete" else ~np.isfinite(values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0].tolist()
            wanted = f"0..{space.nvec[column] - 1}" if kind == "discrete" else "a finite number"
            raise ValueError(f"{where}: {values[row, column]} at [{row}, {column}], expected {wanted}")
        return values

    def rewards(self) -> Array:
        """Return the weighted sum of the channels, float64 [rows]."""
        rewards: Array = self.lanes.step.rewards[self.rows] @ self.weights
        return rewards

    def infos(self) -> dict[str, Array]:
        """Return what there is to know for the next decision, [rows, …] by name."""
        step, rows = self.lanes.step, self.rows
        infos: dict[str, Array] = {}
        if step.masks is not None and self.layout.discrete:
            masks = self.layout.masks([mask[rows] for mask in step.masks])
            infos["action_mask"] = np.concatenate(masks, axis=1)
        if step.deciding is not None:
            infos["deciding"] = step.deciding[rows].copy()
        return infos

    # What follows is for players of one lane.

    def info(self) -> dict[str, Any]:
        """Return what there is to know for the lane's next decision."""
        info: dict[str, Any] = {name: rows[0] for name, rows in self.infos().items()}
        if "action_mask" in info:
            ends = np.cumsum(self.layout.space.branches)[:-1]
            masks = tuple(np.split(info["action_mask"].astype(np.int8), ends))
            info["action_mask"] = {"continuous": None, "discrete": masks} if len(self.parts) > 1 else masks
        return info

    def first(self) -> tuple[Array, dict[str, Any]]:
        """Return the observation and the info at the beginning of an episode."""
        return self.lanes.now[self.rows][0].copy(), self.info()

    def outcome(self) -> Outcome:
        """Return what followed the lane's decision: the last of its episode where that ended."""
        step, lane = self.lanes.step, self.rows.start or 0
        terminated, truncated = bool(step.terminated[lane]), bool(step.truncated[lane])
        info = self.info()
        if terminated or truncated:
            row = int(np.searchsorted(step.ended, lane))
            info = {name: float(column[row]) for name, column in self.lanes.metrics().items()}
        return self.lanes.last[lane].copy(), float(self.rewards()[0]), terminated, truncated, info


class _Bridge:
    """What all environments share: a session, the simulator behind it where it is one's own, the players."""

    def __init__(
        self,
        game: str,
        *,
        single: bool,
        split: bool,
        arenas: int = 1,
        layout: str = "bucket-11",
        stack: int = 3,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        simulator: str | None = None,
        channels: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open the session, as BridgeVectorEnv says.

        split: one player per agent, not one per policy in all lanes. single: there may be one player only, and
        `channels` are its; otherwise they are per player.
        """
        if stack < 1:
            raise ValueError(f"stack is {stack}, expected at least 1")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode is {render_mode!r}, expected None or 'rgb_array'")
        seed = _check_seed(seed)
        with ExitStack() as resources:
            address = simulator or resources.enter_context(simulator_process())
            self.session = resources.enter_context(
                Session(address, game, arenas=arenas, seed=seed, options=options, parameters=parameters)
            )
            self.spec = self.session.spec
            self.lanes = [_Lanes(behaviour, stack) for behaviour in self.spec.behaviours]
            self.players = self._make_players(layout, channels or {}, single, split)
            self.pictures: list[Array] = []  # of all arenas after the last step
            self.drawn = self._choose_drawn(render_mode)
            self.fresh = True  # all episodes have begun and none has been played
            self.playing = False
            # Called by `close`, when the environment is collected, or at the interpreter's end; once.
            self.close = weakref.finalize(self, resources.pop_all().close)

    def _make_players(self, layout: str, channels: Mapping[str, Any], single: bool, split: bool) -> dict[str, _Player]:
        """Return the players by name. Raises ValueError."""
        planned = {}
        for lanes in self.lanes:
            behaviour = lanes.behaviour
            agents = behaviour.agents_per_arena if split else 1
            for part, hand in make_layouts(layout, behaviour.device).items():
                names = (behaviour.name if len(self.lanes) > 1 or not part else "", part)
                policy = "-".join(filter(None, names))
                for agent in range(agents):
                    rows = slice(agent, agent + 1) if agents > 1 else slice(None)
                    planned[f"{policy}_{agent}" if agents > 1 else policy] = (lanes, rows, hand)
        if single and len(planned) > 1:
            raise ValueError(
                f"{self.spec.name} with layout {layout!r} is played by {len(planned)} ({', '.join(planned)}) and this "
                "environment is for one; use trainer.gym.BridgeParallelEnv"
            )
        for name in () if single else channels:
            if name not in planned:
                raise ValueError(f"channels: there is no agent {name!r}; there are {', '.join(planned)}")
        return {
            name: _Player(
                *plan, channels if single else channels.get(name, {}), "actions" if single else f"actions[{name!r}]"
            )
            for name, plan in planned.items()
        }

    def _choose_drawn(self, render_mode: str | None) -> range:
        """Return the arenas to draw. Raises ValueError where they cannot be."""
        if render_mode is None:
            return range(0)
        if not self.spec.HasField("picture"):
            raise ValueError(f"{self.spec.name} cannot be drawn: its spec has no picture; leave out render_mode")
        if self.session.arenas > MAX_PICTURES:
            raise ValueError(f"render_mode: {self.session.arenas} arenas, at most {MAX_PICTURES} can be drawn")
        return range(self.session.arenas)

    def metadata(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """Return an environment's metadata with the game's frames per second."""
        seconds = self.spec.tick_seconds * self.spec.decision_interval
        return {**known, "render_fps": 1.0 / seconds if seconds else TURN_BASED_FPS}

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> int | None:
        """Begin new episodes everywhere; return the seed as Python's int. Raises ValueError."""
        self._require_open()
        seed = None if seed is None else _check_seed(seed)
        if seed is not None or parameters or not self.fresh:
            chosen = choose_parameters(self.spec.parameters, parameters, self.spec.name)
            self.session.reset(seed, chosen)
            self.pictures = []
        self.fresh, self.playing = False, True
        for lanes, step in zip(self.lanes, self.session.steps, strict=True):
            lanes.begin(step)
        return seed

    def play(self, moves: Iterable[tuple[_Player, Any]]) -> None:
        """Advance every arena by one decision; lanes without a move rest. Raises ValueError."""
        self._require_open()
        if not self.playing:
            raise ResetNeeded("no episode is being played; call reset first")
        acts = [_rest(lanes) for lanes in self.lanes]
        for player, actions in moves:
            player.write(actions, acts[self.lanes.index(player.lanes)])
        if self.drawn:
            steps, self.pictures = self.session.step_and_draw(acts, self.drawn)
        else:
            steps = self.session.step(acts)
        for lanes, step in zip(self.lanes, steps, strict=True):
            lanes.push(step)
        self.fresh = all((step.terminated | step.truncated).all() for step in steps)

    def picture(self) -> Array | None:
        """Return the only arena's picture, as BridgeEnv says."""
        if not self.drawn:
            return None
        size = (self.spec.picture.height, self.spec.picture.width, 3)
        return self.pictures[0].copy() if self.pictures else np.zeros(size, np.uint8)

    def _require_open(self) -> None:
        if not self.close.alive:
            raise ClosedEnvironmentError("the environment is closed; make a new one")


def make_vector(num_envs: int, **settings: Any) -> BridgeVectorEnv:
    """Return BridgeVectorEnv(arenas=num_envs, **settings): what `gymnasium.make_vec` calls."""
    return BridgeVectorEnv(arenas=num_envs, **settings)


def _register() -> None:
    for name, game in REGISTERED.items():
        gymnasium.register(
            f"joybridge/{name}-v0", f"{__name__}:BridgeEnv", vector_entry_point=f"{__name__}:make_vector",
            kwargs={"game": game},
        )  # fmt: skip


def _bounds(sensor: pb.Sensor) -> list[Array]:
    """Return the smallest and the largest value of each element of a sensor, float32 [elements] each."""
    given = (list(sensor.low), list(sensor.high))
    ends = [end or [default] for end, default in zip(given, _RANGES[sensor.dtype], strict=True)]
    return [np.broadcast_to(np.array(end, np.float32), element_count(sensor)) for end in ends]


def _flatten(observations: Iterable[Array]) -> Array:
    """Return sensors side by side, float32 [rows, elements]."""
    return np.concatenate([o.reshape(len(o), -1) for o in observations], axis=1, dtype=np.float32)


def _rest(lanes: _Lanes) -> ActArrays:
    """Return actions at rest: axes as near to 0 as they go, first allowed choices."""
    device, step = lanes.behaviour.device, lanes.step
    rest = np.array([min(max(0.0, axis.low), axis.high) for axis in device.axes], np.float32)
    choices = np.zeros((len(step.rewards), len(device.branches)), np.int32)
    for column, mask in enumerate(step.masks or ()):
        choices[:, column] = mask.argmax(axis=1)
    return ActArrays(np.tile(rest, (len(choices), 1)), choices)


def _one_row(action: Any) -> Any:
    """Return one lane's action as a batch of one."""
    if isinstance(action, Mapping):
        return {kind: np.asarray(part)[None] for kind, part in action.items()}
    return np.asarray(action)[None]


def _parameters(options: Mapping[str, Any] | None) -> Mapping[str, float]:
    """Return what the options of a reset say about parameters. Raises ValueError for other options."""
    for name in options or {}:
        if name != "parameters":
            raise ValueError(f"reset: unknown option {name!r}, expected parameters")
    parameters: Mapping[str, float] = (options or {}).get("parameters", {})
    return parameters


def _check_seed(seed: Any) -> int:
    """Return a seed as Python's int. Raises ValueError for one that the contract does not carry."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed!r}, expected one int of 0..2^64-1, which fixes the games of all arenas")
    return int(seed)


_register()
