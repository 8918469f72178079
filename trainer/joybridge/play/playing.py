"""Play the policies of a run without learning: what evaluation, recording and the tools share.

with open_play(run, address, seed=1) as play:
    for decision in play.decisions():
        ...
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from joybridge.client.client import Session
from joybridge.client.sharded_session import ShardedSession, open_session
from joybridge.config.config import Config, play_settings
from joybridge.config.game_settings import Value, drawn, fixed, value_text
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.play.policy_view import PolicyView
from joybridge.policy.actor import Actor, make_actors
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.encoder import Stacks
from joybridge.policy.hand import make_hands
from joybridge.policy.stratify import balanced_options
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.kernels import draw_noise
from joybridge.ppo.observation import Observation
from joybridge.ppo.threads import use_one_thread
from joybridge.run.folder import play_config
from joybridge.run.run_state import load_state, policy_state
from joybridge.v1 import bridge_pb2 as pb


@dataclass(frozen=True)
class Change:
    """An option or a parameter of the game, or a limit of the hand, that differs from the training."""

    trained: str | Value
    played: str | Value


@dataclass(frozen=True)
class Played:
    """One decision of all arenas. Steps and acts hold an entry per behavior, rewards one per policy."""

    before: list[StepArrays]  # what the policies observed
    acts: list[ActArrays]  # what the devices got; overwritten by the next decision
    after: list[StepArrays]
    rewards: list[Array]  # [lanes], as the policy gets them
    pictures: list[Array]  # uint8 [height, width, 3] of the first arena, where it was drawn


class Player:
    """An actor and what it remembers of its lanes while it plays."""

    def __init__(self, actor: Actor, lanes: int, seed: int, *, deterministic: bool) -> None:
        """Begin in so many lanes. deterministic: always the likeliest action. `seed` fixes the samples."""
        self.actor, self.deterministic = actor, deterministic
        self.lanes = lanes
        self._stack = Stacks(actor.encoder, lanes, actor.config.frame_stack)
        size = actor.network.state_size
        self._memory = np.zeros((lanes, size), np.float32) if size else None
        self._rng = np.random.default_rng([seed, actor.seed])
        space = actor.layout.space
        self._masks = np.zeros((lanes, len(space.branches), space.widest), np.float32)

    @property
    def observations(self) -> Observation:
        """What the policy observes and remembers now."""
        return self._stack.now._replace(memory=self._memory)

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        self._stack.begin(self.actor.see(step.observations))
        if self._memory is not None:
            self._memory[:] = 0.0

    def act(self, step: StepArrays, act: ActArrays) -> None:
        """Write an action for the present observations into the policy's part of `act`; `noise` is what it drew on."""
        layout, space = self.actor.layout, self.actor.layout.space
        fill_masks(None if step.masks is None else layout.masks(step.masks), self._masks)
        self.noise = draw_noise(self._rng, (self.lanes, space.continuous), (self.lanes, len(space.branches)))
        seen = self.observations
        acted = self.actor.act(seen, self._masks, self.noise, deterministic=self.deterministic).of_deciding(seen, step)
        self._memory, action = acted.memory, acted.action
        layout.write(action.continuous, action.discrete, act, step.masks)

    def store(self, step: StepArrays) -> Array:
        """Take what followed the action; return the rewards [lanes]."""
        self._stack.push(self.actor.see(step.observations), step)
        if self._memory is not None:
            self._memory[step.ended] = 0.0
        return self.actor.encoder.rewards(step)


class Policies:
    """The policies of a run, with their hands, in all lanes of a number of arenas.

    timesteps: how long they have trained.
    """

    def __init__(
        self, run: Path, config: Config, spec: pb.GameSpec, arenas: int, seed: int, *, deterministic: bool = False,
        checkpoint: str = "",
    ) -> None:  # fmt: skip
        """Load a checkpoint of a run; see `open_play`. Raises CheckpointError and ConfigError."""
        use_one_thread()
        state = load_state(run, checkpoint)
        self.timesteps = state.timesteps
        self.players = []
        for actor in make_actors(config, spec):
            actor.load(policy_state(state.arrays, actor.name))
            lanes = lane_count(spec.behaviors[actor.behavior], arenas)
            self.players.append(Player(actor, lanes, seed, deterministic=deterministic))
        self._hands = make_hands(config, spec, 0, arenas, seed)
        self._acts = make_acts(spec, arenas)

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Take the first steps of a session; entries are behaviors."""
        for player in self.players:
            player.begin(steps[player.actor.behavior])

    def act(self, steps: Sequence[StepArrays]) -> list[ActArrays]:
        """Return what the devices get for the present steps; overwritten by the next call."""
        for player in self.players:
            behavior = player.actor.behavior
            player.act(steps[behavior], self._acts[behavior])
        for hand, step, act in zip(self._hands, steps, self._acts, strict=False):  # there may be no hands
            hand.apply(step, act)
        return self._acts

    def store(self, steps: Sequence[StepArrays]) -> list[Array]:
        """Take the steps that followed the acts; return the rewards [lanes] of each policy."""
        rewards = [player.store(steps[player.actor.behavior]) for player in self.players]
        for hand, step in zip(self._hands, steps, strict=False):
            hand.store(step)
        return rewards


class Play:
    """The policies of a run in an open session."""

    def __init__(
        self, config: Config, changed: dict[str, Change], choices: Sequence[str], arenas: int,
        session: Session | ShardedSession, policies: Policies,
    ) -> None:  # fmt: skip
        """Play `arenas` arenas. changed: what differs from the training. choices: see `balanced_options`."""
        self.config, self.changed, self.choices = config, changed, choices
        self.session, self._policies = session, policies
        self.players, self.timesteps = policies.players, policies.timesteps
        self.spec = session.spec
        self.arenas = arenas

    def heading(self) -> str:
        """Return what plays, and what differs from its training."""
        changed = [
            f"{key}={_text(change.played)} (trained with {_text(change.trained)})"
            for key, change in self.changed.items()
        ]
        return "; ".join([f"policy after {self.timesteps:,} timesteps", *changed])

    def view(self) -> PolicyView:
        """Return what draws the images that the policies see."""
        return PolicyView(self.spec, [(player.actor.behavior, player.actor.encoder) for player in self.players])

    def decisions(self, draw_every: int = 0) -> Iterator[Played]:
        """Yield decisions without end. draw_every: draw the first arena after every so many decisions; 0: never.

        A session over several choices of `evaluate_over` cannot be drawn. Raises SimulatorError.
        """
        session, number = self.session, 0
        while True:
            number += 1
            before = session.steps
            acts = self._policies.act(before)
            pictures: list[Array] = []
            if draw_every and number % draw_every == 0:
                assert isinstance(session, Session)
                after, pictures = session.step_and_draw(acts, [0])
            else:
                after = session.step(acts)
            yield Played(before, acts, after, self._policies.store(after), pictures)


@contextmanager
def open_play(
    run: Path, address: str, *, seed: int, episodes: int = 0, arenas_limit: int = 64, deterministic: bool = False,
    overrides: Sequence[str] = (), checkpoint: str = "",
) -> Iterator[Play]:  # fmt: skip
    """Load a checkpoint of a run and open a session at a simulator; the session is closed on leaving.

    checkpoint: "best", its timesteps, or "" for the newest. overrides: "key=value" each, options and parameters of the
    game that differ from the training. episodes: 0 plays one arena under the options of the run. Otherwise arenas for
    so many episodes at once, at most `arenas_limit` per choice of the option `evaluate_over`; arenas of the same choice
    are side by side.
    `seed` fixes the games and the samples. Raises SimulatorError, CheckpointError and ConfigError.
    """
    config = play_config(run, overrides)
    spec = fitting_spec(address, config)
    options = balanced_options(config, spec) if episodes else {"": config.options}
    arenas = len(options) * max(1, min(math.ceil(episodes / len(options)), spec.max_arenas, arenas_limit))
    policies = Policies(run, config, spec, arenas, seed, deterministic=deterministic, checkpoint=checkpoint)
    session = open_session(
        [address] * len(options), config.game, arenas=arenas, seed=seed, options=list(options.values()),
        parameters=fixed(config.parameters), distributions=drawn(config.parameters), timeout=config.timeout_seconds,
        transport=config.transport,
    )  # fmt: skip
    with closing(session):
        policies.begin(session.steps)
        changed = changed_settings(play_config(run, ()), config, spec)
        yield Play(config, changed, list(options), arenas, session, policies)


def changed_settings(trained: Config, played: Config, spec: pb.GameSpec) -> dict[str, Change]:
    """Return what differs between two configurations of a game, by key, as in "parameters.size" and "hand_delay"."""
    defaults: dict[str, str | Value] = {f"options.{option.name}": option.default_choice for option in spec.options}
    defaults |= {f"parameters.{parameter.name}": parameter.default_value for parameter in spec.parameters}
    before, now = defaults | play_settings(trained), defaults | play_settings(played)
    return {key: Change(before[key], now[key]) for key in now if before[key] != now[key]}


def _text(value: str | Value) -> str:
    return value if isinstance(value, str) else value_text(value)
