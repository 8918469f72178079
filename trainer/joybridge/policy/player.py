"""An actor that plays in some lanes, with what it remembers of them, and learns nothing."""

import numpy as np

from joybridge.config.arrays import select
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.parts import rows_of
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import Stacks
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.kernels import draw_noise
from joybridge.ppo.observation import Observation


class Player:
    """An actor and what it remembers of its lanes while it plays. `rng` is what its samples are drawn from."""

    def __init__(self, actor: Actor, lanes: int, seed: int, *, deterministic: bool) -> None:
        """Begin in so many lanes. deterministic: always the likeliest action. `seed` fixes the samples."""
        self.actor, self.deterministic = actor, deterministic
        self.lanes = lanes
        self.rng = np.random.default_rng([seed, actor.seed])
        self._stack = Stacks(actor.encoder, lanes, actor.config.frame_stack)

    @property
    def observations(self) -> Observation:
        """What the policy observes now."""
        return self._stack.now

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        self._stack.begin(self.actor.see(step.observations))

    def act(self, step: StepArrays, act: ActArrays, held: Array | None = None) -> None:
        """Write an action for the present observations into the policy's part of `act`; `noise` is what it drew on.

        held: the numbers of the lanes in which it acts, ascending; None: all.
        """
        if held is not None:
            mine = ActArrays(act.axes[held], act.choices[held])
            self._act(rows_of(step, held), mine, self.observations.rows(held))
            act.axes[held], act.choices[held] = mine.axes, mine.choices
        else:
            self._act(step, act, self.observations)

    def _act(self, step: StepArrays, act: ActArrays, observations: Observation) -> None:
        layout, space, lanes = self.actor.layout, self.actor.layout.space, len(observations.numbers)
        masks = np.zeros((lanes, len(space.branches), space.widest), np.float32)
        fill_masks(None if step.masks is None else layout.masks(step.masks), masks)
        self.noise = draw_noise(self.rng, (lanes, space.continuous), (lanes, len(space.branches)))
        action, _ = self.actor.act(observations, masks, self.noise, deterministic=self.deterministic)
        layout.write(action.continuous, action.discrete, act, step.masks)

    def store(self, step: StepArrays, held: Array | None = None) -> Array:
        """Take what followed the action, in some lanes or in all; return the rewards of these lanes."""
        mine = step if held is None else rows_of(step, held)
        self._stack.push(self.actor.see(mine.observations), mine, held)
        return self.actor.encoder.rewards(mine)

    def state(self) -> dict[str, Array]:
        """Return copies of what it remembers, for a checkpoint."""
        return {"numbers": self.observations.numbers.copy()} | {
            f"images.{index}": images.copy() for index, images in enumerate(self.observations.images)
        }

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        images = select(state, "images.")
        self._stack.load(Observation(state["numbers"], tuple(images[str(index)] for index in range(len(images)))))
