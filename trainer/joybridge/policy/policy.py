"""One policy in training: the actor that plays, the rollout that it fills, and the learner that improves it."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from joybridge.config.arrays import select
from joybridge.config.metrics import Row
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.layouts.conditions import Conditions, ConditionsOfGames
from joybridge.policy.actor import Acted, Actor
from joybridge.policy.encoder import final_observations, push_frames
from joybridge.policy.episodes import Episodes
from joybridge.policy.learning_progress import LearningProgress
from joybridge.policy.lineup import Lineup
from joybridge.ppo.carried import carried_from
from joybridge.ppo.cloning import Cloning, minibatches, refresh
from joybridge.ppo.loss import Actions
from joybridge.ppo.observation import Observation
from joybridge.ppo.return_scale import ReturnScale
from joybridge.ppo.rollout import RolloutBuffer
from joybridge.ppo.update import Learner
from joybridge.v1 import bridge_pb2 as pb

FIRST_SHARE = 0.1  # of penalties that counts at the beginning, if they grow
SAMPLES, SHUFFLES, DEMONSTRATIONS, SHARES = range(4)  # what random numbers are for


def random_numbers(seed: int, updates: int, purpose: int) -> np.random.Generator:
    """Return the generator of a policy's rollout, after so many updates, for one purpose."""
    return np.random.Generator(np.random.Philox(key=np.array([seed, updates], np.uint64), counter=[0, 0, 0, purpose]))


class Policy:
    """A policy that acts in every lane of one behavior and learns from what follows.

    Steps and acts below are of one group of arenas and hold an entry per behavior.
    """

    def __init__(
        self,
        actor: Actor,
        behavior: pb.Behavior,
        arenas: Sequence[int],
        drawn: Mapping[int, str] | None = None,
        lineup: Lineup | None = None,
        kinds: Array | None = None,
    ) -> None:
        """Begin with empty rollouts.

        arenas: the first arena of each group and, last, their number. drawn: see `Episodes`. lineup: several games, of
        which each lane plays one: kinds, int [lanes].
        """
        self.actor, self.config = actor, actor.config
        bounds = [lane_count(behavior, arena) for arena in arenas]
        self.lanes = bounds[-1]
        groups = [slice(first, end) for first, end in pairwise(bounds)]
        self.rollout = RolloutBuffer(
            self.config.rollout_steps,
            groups,
            actor.observation_size,
            actor.layout.space,
            [*actor.encoder.images.values()],
            self.config.frame_stack,
            actor.network.state_size,
        )
        autograd = self.config.autograd or actor.accelerator.type != "cpu"
        name = actor.name if actor.name == behavior.name else f"{actor.name} (behavior {behavior.name})"
        self.learner = Learner(
            name,
            actor.network,
            branches=actor.branches,
            gaussians=actor.gaussians,
            autograd=autograd,
            threads=self.config.threads,
            adam_eps=self.config.adam_eps,
        )
        if self.config.loss:
            self.learner.add_term(self.config.loss)
        self.conditions: Sequence[Conditions | ConditionsOfGames] | None = None  # of each group; None: all always count
        if lineup and kinds is not None:
            only_with = self.config.only_with
            self.conditions = [lineup.conditions(actor.layout, kinds[lanes], only_with=only_with) for lanes in groups]
        elif self.config.only_with and (conditions := Conditions(actor.layout, behavior.device)):
            self.conditions = [conditions] * len(groups)
        self.notes_acts = self.conditions is not None or actor.past.size > 0
        self.returns = ReturnScale(self.lanes, self.config.gamma, kinds) if self.config.scale_rewards else None
        games = ([*lineup.games], kinds) if lineup and kinds is not None else None
        self.learning = LearningProgress(*games) if games and lineup and lineup.by_progress else None
        self.episodes = Episodes(self.lanes, actor.metrics, drawn, games)
        self.demonstrated: Actions | None = None  # what it clones
        self._acted: dict[int, Acted] = {}  # what each group does until its outcome is known
        self.updates = 0
        self._begin_rollout()

    def _rng(self, purpose: int) -> np.random.Generator:
        """Return the generator of the present rollout for one purpose; so no state of one need be saved."""
        return random_numbers(self.actor.seed, self.updates, purpose)

    def begin(self, groups: Sequence[Sequence[StepArrays]]) -> None:
        """Take the first observations of new episodes: the steps of each group."""
        for group, steps in enumerate(groups):
            step = steps[self.actor.behavior]
            self.rollout.begin(self._watch(step), step.deciding, group)
        self.episodes.begin()

    def act(self, steps: Sequence[StepArrays], acts: Sequence[ActArrays], group: int = 0) -> None:
        """Sample actions for the present observations and write them into the policy's part of `acts`."""
        actor, step, rollout = self.actor, steps[self.actor.behavior], self.rollout
        masks = rollout.mask(None if step.masks is None else actor.layout.masks(step.masks), group)
        observation = rollout.present(group)
        acted = actor.act(observation, masks, rollout.noise_of(group))
        if observation.memory is not None:
            acted = acted.of_deciding(observation, step.deciding)
        self._acted[group] = acted
        actor.layout.write(acted.action.continuous, acted.action.discrete, acts[actor.behavior], step.masks)

    def note(self, acts: Sequence[ActArrays], group: int = 0) -> None:
        """Take what all policies chose for the device: it becomes a past act, and says which parts of actions count."""
        act, past, rollout = acts[self.actor.behavior], self.actor.past, self.rollout
        if past.size:
            t, lanes = rollout.rows[group], rollout.groups[group]
            now, after = rollout.observations[t : t + 2, lanes, : past.size]
            after[:] = past.note(now, act, rollout.deciding[t, lanes])
        if self.conditions is not None:
            rollout.store_counts(self.conditions[group].counts(act.choices), group)

    def store(self, steps: Sequence[StepArrays], group: int = 0, played: Sequence[Array] | None = None) -> None:
        """Store what followed the action: in the rollout, and episodes that ended in `episodes`.

        played: per behavior, the lanes that it held, a bool for each; None: all.
        """
        actor, step, rollout = self.actor, steps[self.actor.behavior], self.rollout
        seen, rewards, final_values = self._watch(step), actor.encoder.rewards(step), None
        t, lanes = rollout.rows[group], rollout.groups[group]
        past = rollout.observations[t + 1, lanes, : actor.past.size]
        remembered = actor.past.settle(past, rewards, step) if actor.past.size else past[step.ended]
        now, after = rollout.observations[t : t + 2, lanes, actor.past.size :]
        if step.truncated.any() and step.final_observations is not None:
            last, before = actor.see(step.final_observations), rollout.observation(t, lanes).images
            stacks = (
                np.concatenate([stack[step.ended, 1:], pictures[:, None]], axis=1)
                for stack, pictures in zip(before, last.images, strict=True)
            )
            memory = self._acted[group].memory
            state = None if memory is None else memory[step.ended]
            numbers = np.concatenate([remembered, final_observations(now, last.numbers, step)], axis=1)
            final_values = actor.values(Observation(numbers, tuple(stacks), state))
        push_frames(now, seen.numbers, step, after)
        for history, pictures in zip(rollout.histories, seen.images, strict=True):
            sources, next_sources, new = history.push(t, lanes, pictures)
            push_frames(sources, new, step, next_sources)
        learned = rewards - self._eased * actor.encoder.penalties(step) if self._eased else rewards
        rollout.put(*self._acted[group], group=group)
        rollout.store(step, learned, final_values, group)
        self.episodes.add(step, rewards, lanes, None if played is None else played[actor.behavior])

    def _begin_rollout(self) -> None:
        """Draw the noise of the present rollout, and fix which share of penalties does not count in it."""
        self.rollout.draw_noise(self._rng(SAMPLES), self.actor.network.noise_holds)
        timesteps, ramp = self.updates * self.config.rollout_steps * self.lanes, self.config.penalty_ramp
        self._eased = np.float32((1.0 - FIRST_SHARE) * max(0.0, 1.0 - timesteps / ramp) if ramp else 0.0)

    def _watch(self, step: StepArrays) -> Observation:
        """Return what a step shows as the network gets it; frames that are pushed count for their scaling."""
        encoder, scaling = self.actor.encoder, self.actor.scaling
        frames = encoder.frames(step.observations)
        if scaling is not None:
            pushed = None if step.deciding is None else step.deciding | step.ends
            scaling.watch(frames if pushed is None else frames[pushed])
            frames = scaling.apply(frames)
        return Observation(frames, encoder.pictures(step.observations))

    def rewards(self, decided: Array) -> Array:
        """Return the rewards of the full rollout as the critic learns them, [steps, lanes]; once per rollout."""
        rollout = self.rollout
        if self.returns is None:
            return rollout.rewards
        rewards = self.returns.scale(rollout.rewards, decided, rollout.terminated | rollout.truncated)
        if self.learning is not None:
            self.learning.watch(rewards, decided)
        return rewards

    def next_values(self) -> Array:
        """Return the values of what follows the last outcome of each lane in the full rollout, [lanes].

        Where a lane waits, that is what it saw at its last decision, whose value is known.
        """
        values, rollout = self.actor.values(self.rollout.observation(-1)), self.rollout
        waiting = np.flatnonzero(rollout.pending >= 0)
        values[waiting] = rollout.values[rollout.pending[waiting], waiting]
        return values

    def times(self, decided: Array) -> Array | None:
        """Return how often each timestep of the rollout is learned from in an epoch, int [steps, lanes]; None: once."""
        return None if self.learning is None else self.learning.times(decided, self._rng(SHARES))

    def shares(self, times: Array | None) -> Row:
        """Return the shares of several games in what is learned from, for a row of metrics, if they change."""
        return {} if self.learning is None or times is None else self.learning.row(times)

    def shuffles(self) -> np.random.Generator:
        """Return the generator that shuffles the present rollout."""
        return self._rng(SHUFFLES)

    def cloning(self, progress: float, *, alone: bool) -> Cloning | None:
        """Return what the present update learns from demonstrations, after a fraction of the run; None: nothing.

        alone: PPO then only teaches the critic; otherwise the coefficient falls linearly, to 0.
        """
        if self.demonstrated is None:
            return None
        coef = self.config.cloning_coef * (1.0 if alone else max(0.0, 1.0 - progress))
        shown = refresh(self.actor.network, self.demonstrated)
        chosen = minibatches(shown, self.config.minibatch_size, self._rng(DEMONSTRATIONS))
        return Cloning(chosen, coef, alone)

    def restart(self) -> None:
        """Begin the next rollout."""
        self.updates += 1
        if self.actor.scaling is not None:
            self.actor.scaling.refresh()
        self.rollout.restart()
        self._begin_rollout()

    def take_scale(self, moments: dict[str, Array]) -> None:
        """Scale rewards at first as the critic has learned them, from the moments of returns; empty: it has not.

        They count as much as the first rollout, so that other rewards are soon scaled by their own moments.
        """
        if self.returns is not None and moments:
            self.returns.begin_with(moments, self.config.rollout_steps * self.lanes)

    def state(self) -> dict[str, Array]:
        """Return copies of everything that fixes what follows, with an empty rollout, for a checkpoint."""
        return {
            **{f"network.{name}": array for name, array in self.actor.state().items()},
            **{f"adam.{name}": array for name, array in self.learner.state().items()},
            **{f"episodes.{name}": array for name, array in self.episodes.state().items()},
            **({} if self.returns is None else {f"returns.{n}": array for n, array in self.returns.state().items()}),
            **({} if self.learning is None else {f"shares.{n}": array for n, array in self.learning.state().items()}),
            "updates": np.array(self.updates),
            "observations": self.rollout.observations[0].copy(),
            "deciding": self.rollout.deciding[0].copy(),
            **({} if self.rollout.memory is None else {"memory": self.rollout.memory[0].copy()}),
            **{f"images.{i}": history.window(0).gather() for i, history in enumerate(self.rollout.histories)},
            **{f"carried.{name}": array for name, array in self.rollout.carried.state().items()},
        }

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned. Raises CheckpointError."""
        self.actor.load(select(state, "network."))
        self.learner.load(select(state, "adam."))
        self.episodes.load(select(state, "episodes."))
        if self.returns is not None:
            self.returns.load(select(state, "returns."))
        if self.learning is not None:
            self.learning.load(select(state, "shares."))
        self.updates = int(state["updates"])
        _take(state["observations"], self.rollout.observations[0])
        _take(state["deciding"], self.rollout.deciding[0])
        if self.rollout.memory is not None:
            _take(state["memory"], self.rollout.memory[0])
        for i, history in enumerate(self.rollout.histories):
            history.load(state[f"images.{i}"])
        self.rollout.take_carried(carried_from(select(state, "carried.")))
        self._begin_rollout()


def _take(saved: Array, place: Array) -> None:
    """Put an array of a checkpoint into its place. Raises ValueError unless it is of the same kind, and finite."""
    if saved.shape != place.shape or saved.dtype != place.dtype or not np.isfinite(saved).all():
        came, wanted = (f"{array.dtype} {list(array.shape)}" for array in (saved, place))
        raise ValueError(f"an array is {came}, expected finite {wanted}")
    place[:] = saved
