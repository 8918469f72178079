"""An actor that plays in some lanes, with what it remembers of them, and learns nothing."""

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import Stacks
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.kernels import draw_noise
from joybridge.ppo.observation import Observation


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
