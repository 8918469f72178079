"""One policy's rollout: what its lanes saw, did and earned since its last update, in preallocated arrays."""

import copy
from collections.abc import Sequence

import numpy as np
import torch

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.trainer.layouts import ActionSpace
from joybridge.trainer.ppo.distributions import FORBIDDEN
from joybridge.trainer.ppo.loss import Batch


class Rollout:
    """`steps` decisions of all lanes. Row t of each array is about decision t.

    Observations are stacked: the last `stack` frames, oldest first, zeros before an episode's first. Frames
    of lanes that wait are not pushed.
    """

    def __init__(self, steps: int, lanes: int, frame: int, stack: int, space: ActionSpace) -> None:
        """Preallocate. frame: numbers per observation."""
        self.frame = frame
        self.space = space
        self.step = 0
        self.observations = np.zeros((steps + 1, lanes, frame * stack), np.float32)
        self.continuous = np.zeros((steps, lanes, space.continuous), np.float32)
        self.discrete = np.zeros((steps, lanes, len(space.branches)), np.int64)
        self.masks: Array | None = None  # [steps, lanes, branches, widest], made when a game first forbids a choice
        self.log_probs = np.zeros((steps, lanes), np.float32)
        self.values = np.zeros((steps, lanes), np.float32)
        self.rewards = np.zeros((steps, lanes), np.float32)
        self.terminated = np.zeros((steps, lanes), bool)
        self.truncated = np.zeros((steps, lanes), bool)
        self.final_values = np.zeros((steps, lanes), np.float32)
        self.deciding = np.ones((steps + 1, lanes), bool)
        self.open = np.full(lanes, -1)  # the decision each lane has made and not yet been paid for

    def part(self, lanes: slice) -> "Rollout":
        """Return some lanes of this rollout, which are filled at their own pace; the memory is the same."""
        part = copy.copy(self)
        for name, array in vars(self).items():
            if isinstance(array, np.ndarray):
                setattr(part, name, array[lanes] if name == "open" else array[:, lanes])
        return part

    @property
    def full(self) -> bool:
        """Return whether an update is due."""
        return self.step == len(self.rewards)

    def begin(self, frames: Array, deciding: Array | None) -> None:
        """Put first frames [lanes, frame] of new episodes."""
        self.observations[0] = 0.0
        self.observations[0, :, -self.frame :] = frames
        self.deciding[0] = True if deciding is None else deciding

    def add_step(self, step: StepArrays, frames: Array, rewards: Array) -> None:
        """Store what followed the present decision: the next frames [lanes, frame], and rewards [lanes].

        Final observations' values are filled in by the caller.
        """
        t = self.step
        now, after = self.observations[t], self.observations[t + 1]
        after[:, : -self.frame] = now[:, self.frame :]
        after[:, -self.frame :] = frames
        after[step.ended, : -self.frame] = 0.0
        if step.deciding is None and self.deciding[t].all():
            self.rewards[t], self.terminated[t], self.truncated[t] = rewards, step.terminated, step.truncated
            self.deciding[t + 1] = True
        else:
            self._add_skipping(step, rewards, now, after)
        self.step += 1

    def _add_skipping(self, step: StepArrays, rewards: Array, now: Array, after: Array) -> None:
        """Store a step in which some lanes wait: its rewards belong to each lane's last decision."""
        t = self.step
        ended = step.terminated | step.truncated
        deciding = np.ones(len(ended), bool) if step.deciding is None else step.deciding
        waiting = ~deciding & ~ended
        after[waiting] = now[waiting]
        self.open[self.deciding[t]] = t
        paid = np.flatnonzero((deciding | ended) & (self.open >= 0))
        rows = self.open[paid]
        self.rewards[rows, paid] = rewards[paid]
        self.terminated[rows, paid] = step.terminated[paid]
        self.truncated[rows, paid] = step.truncated[paid]
        self.final_values[rows, paid] = self.final_values[t, paid]  # counts where truncated only
        self.open[paid] = -1
        self.deciding[t + 1] = deciding

    def final_stack(self, ended: Array, frames: Array) -> Array:
        """Return the stacked last observations of ended lanes, given their last frames [ended, frame]."""
        now = self.observations[self.step, ended]
        return np.concatenate([now[:, self.frame :], frames], axis=1)

    def live(self) -> Array:
        """Return where a decision was made whose outcome this rollout holds, bool [steps, lanes]."""
        live = self.deciding[:-1].copy()
        waiting = np.flatnonzero(self.open >= 0)
        live[self.open[waiting], waiting] = False
        return live

    def join_masks(self, parts: Sequence["Rollout"]) -> None:
        """Take the masks of all lanes from the parts that they are divided into."""
        if any(part.masks is not None for part in parts):
            self.masks = np.concatenate(
                [part.masks if part.masks is not None else part.no_masks() for part in parts], 1
            )

    def no_masks(self) -> Array:
        """Return masks that forbid nothing."""
        return np.zeros((*self.discrete.shape, max(self.space.branches, default=0)), np.float32)

    def batch(self, advantages: Array, live: Array) -> Batch:
        """Return the live timesteps with these advantages [steps, lanes], normalised, as one flat batch."""
        whole = live.all()

        def flat(array: Array) -> torch.Tensor:
            return torch.from_numpy(array.reshape(live.size, *array.shape[2:]) if whole else array[live])

        chosen = flat(advantages).numpy()
        return Batch(
            observations=flat(self.observations[:-1]),
            continuous=flat(self.continuous),
            discrete=flat(self.discrete),
            masks=None if self.masks is None else flat(self.masks),
            log_probs=flat(self.log_probs),
            values=flat(self.values),
            advantages=torch.from_numpy((chosen - chosen.mean()) / (chosen.std() + 1e-10)),
            returns=flat(advantages + self.values),
        )

    def set_masks(self, masks: Sequence[Array] | None) -> Array | None:
        """Store which choices the present decision allows, bool [lanes, choices] per branch; None: all.

        Return what to add to the logits, [lanes, branches, widest], or None if no choice was ever forbidden.
        """
        if self.masks is None:
            if masks is None:
                return None
            self.masks = self.no_masks()
        row: Array = self.masks[self.step]
        row[...] = 0.0
        for branch, mask in enumerate(masks or ()):
            row[:, branch, : mask.shape[1]] = np.where(mask, 0.0, FORBIDDEN)
        return row

    def continue_from(self, last: "Rollout") -> None:
        """Begin anew where the rollout before ended, which stays as it is."""
        self.observations[0] = last.observations[-1]
        self.deciding[0] = last.deciding[-1]
        self.open[:] = -1
        self.step = 0
