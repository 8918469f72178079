"""An actor that plays in some lanes, with what it remembers of them, and learns nothing."""

import numpy as np

from joybridge.config.arrays import select
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.sharding import rows_of
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import Stacks
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.kernels import Noise, draw_noise
from joybridge.ppo.observation import Observation


class PolicyPlayer:
    """An actor and what it remembers of its lanes while it plays. `rng` is what its samples are drawn from."""

    def __init__(self, actor: Actor, lanes: int, seed: int, *, deterministic: bool) -> None:
        """Begin in so many lanes. deterministic: always the likeliest action. `seed` fixes the samples."""
        self.actor, self.deterministic = actor, deterministic
        self.name, self.behavior, self.seed = actor.name, actor.behavior, actor.seed
        self.lanes = lanes
        self.rng = np.random.default_rng([seed, actor.seed])
        self._acts = 0  # decisions so far
        self._stack = Stacks(actor.encoder, lanes, actor.config.frame_stack)
        self._past = np.zeros((lanes, actor.past.size), np.float32)
        size = actor.network.state_size
        self._memory = np.zeros((lanes, size), np.float32) if size else None

    @property
    def observations(self) -> Observation:
        """What the policy observes and remembers now."""
        seen = self._stack.now
        if not self.actor.past.size:
            return seen._replace(memory=self._memory)
        return seen._replace(numbers=np.concatenate([self._past, seen.numbers], axis=1), memory=self._memory)

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        self._stack.begin(self.actor.see(step.observations))
        self._past[:] = 0.0
        if self._memory is not None:
            self._memory[:] = 0.0

    def act(self, step: StepArrays, act: ActArrays, held: Array | None = None) -> None:
        """Write an action for the present observations into the policy's part of `act`; `noise` is what it drew on.

        held: the numbers of the lanes in which it acts, ascending; None: all.
        """
        where = slice(None) if held is None else held
        own, seen = ActArrays(act.axes[where], act.choices[where]), self.observations
        if held is not None:
            seen = seen.rows(held)
        allowed = None if step.masks is None else [mask[where] for mask in step.masks]
        lanes, layout, space = len(own.choices), self.actor.layout, self.actor.layout.space
        masks = np.zeros((lanes, len(space.branches), space.widest), np.float32)
        fill_masks(None if allowed is None else layout.masks(allowed), masks)
        self.noise = self._draw_noise(lanes, keep=held is None)
        acted = self.actor.act(seen, masks, self.noise, deterministic=self.deterministic)
        acted = acted.of_deciding(seen, None if step.deciding is None else step.deciding[where])
        layout.write(acted.action.continuous, acted.action.discrete, own, allowed)
        act.axes[where], act.choices[where] = own.axes, own.choices
        if self._memory is not None:
            self._memory[where] = acted.memory

    def _draw_noise(self, lanes: int, *, keep: bool) -> Noise:
        """Return the noise of the next decision, of which that stays which a distribution keeps for several.

        keep: or not, where lanes come and go: then samples depend on no decision before.
        """
        holds = self.actor.network.noise_holds
        drawn = draw_noise(self.rng, (lanes, len(holds)), (lanes, len(self.actor.layout.space.branches)))
        kept = self._acts % holds > 0
        self._acts += 1
        if keep and kept.any():
            return drawn._replace(normal=np.where(kept, self.noise.normal, drawn.normal))
        return drawn

    def note(self, step: StepArrays, act: ActArrays, held: Array | None = None) -> None:
        """Take what all who play chose for the devices, in some lanes or in all."""
        where = slice(None) if held is None else held
        chosen, deciding = ActArrays(act.axes[where], act.choices[where]), step.deciding
        self._past[where] = self.actor.past.note(
            self._past[where], chosen, None if deciding is None else deciding[where]
        )

    def store(self, step: StepArrays, held: Array | None = None) -> Array:
        """Take what followed the action, in some lanes or in all; return the rewards of these lanes."""
        mine = step if held is None else rows_of(step, held)
        self._stack.push(self.actor.see(mine.observations), mine, held)
        if self._memory is not None:
            self._memory[mine.ended if held is None else held[mine.ended]] = 0.0
        rewards, where = self.actor.encoder.rewards(mine), slice(None) if held is None else held
        past = self._past[where]
        self.actor.past.settle(past, rewards, mine)
        self._past[where] = past
        return rewards

    def state(self, held: Array) -> dict[str, Array]:
        """Return copies of what it remembers of some lanes, for a checkpoint."""
        numbers, images, memory = self.observations.rows(held)
        state = {"numbers": numbers, **{f"images.{index}": image for index, image in enumerate(images)}}
        if memory is not None:
            state["memory"] = memory
        return state

    def load(self, state: dict[str, Array], held: Array) -> None:
        """Take back what `state` returned."""
        images = select(state, "images.")
        pictures = tuple(images[str(index)] for index in range(len(images)))
        self._past[held], numbers = np.split(state["numbers"], [self._past.shape[1]], axis=1)
        self._stack.load(Observation(numbers, pictures), held)
        if self._memory is not None:
            self._memory[held] = state["memory"]
