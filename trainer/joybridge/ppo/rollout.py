"""The rollout of one policy: what its lanes observed, did and earned since its last update, in preallocated arrays."""

from collections.abc import Sequence

import numpy as np
import torch

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.layouts import ActionSpace
from joybridge.ppo.carried import NOTHING, Carried, together
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.kernels import Action, Noise, draw_noise
from joybridge.ppo.history import History
from joybridge.ppo.images import Image
from joybridge.ppo.loss import Batch
from joybridge.ppo.memory import Sequences, cut
from joybridge.ppo.observation import Observation
from joybridge.ppo.observation_tensors import Observations


class RolloutBuffer:
    """`steps` decisions of all lanes. Row t of each array is about decision t.

    Groups of lanes are filled one after the other; each has a row of its own, the next one to be filled.
    """

    def __init__(
        self,
        steps: int,
        groups: Sequence[slice],
        observation: int,
        space: ActionSpace,
        images: Sequence[Image] = (),
        frame_stack: int = 1,
        state_size: int = 0,
    ) -> None:
        """Preallocate. groups: the lanes of each group, in order. observation: numbers per observation.

        images: those of an observation, beside its numbers, in stacks of `frame_stack` pictures. state_size: numbers
        that a lane remembers; 0: without memory.
        """
        lanes = groups[-1].stop
        self.groups = groups
        self.rows = [0] * len(groups)
        self.space = space
        self.observations = np.zeros((steps + 1, lanes, observation), np.float32)
        self.histories = [History(steps, lanes, image, frame_stack) for image in images]
        self.memory = np.zeros((steps + 1, lanes, state_size), np.float32) if state_size else None
        self.continuous = np.zeros((steps, lanes, space.continuous), np.float32)
        self.discrete = np.zeros((steps, lanes, len(space.branches)), np.int64)
        self.masks: Array | None = None  # [steps, lanes, branches, widest], made when a game first forbids a choice
        self.counts: Array | None = None  # bool [steps, lanes, parts], made if not all parts of actions always count
        self.log_probs = np.zeros((steps, lanes), np.float32)
        self.values = np.zeros((steps, lanes), np.float32)
        self.rewards = np.zeros((steps, lanes), np.float32)
        self.terminated = np.zeros((steps, lanes), bool)
        self.truncated = np.zeros((steps, lanes), bool)
        self.final_values = np.zeros((steps, lanes), np.float32)  # at a truncation, of the last observation
        self.deciding = np.ones((steps + 1, lanes), bool)
        self.pending = np.full(lanes, -1)  # the row of each lane's decision whose outcome is not known yet
        self.carried = NOTHING  # of earlier rollouts; where their outcome is known, it is in row 0
        self.noise = Noise(np.zeros(self.continuous.shape, np.float32), np.zeros(self.discrete.shape, np.float32))

    @property
    def full(self) -> bool:
        """Return whether an update is due."""
        return all(row == len(self.rewards) for row in self.rows)

    def begin(self, seen: Observation, deciding: Array | None, group: int = 0) -> None:
        """Put what the lanes of a group see first in new episodes: frames, and one picture of each image."""
        lanes = self.groups[group]
        self.pending[lanes] = -1
        self.carried = self.carried.of((self.carried.lanes < lanes.start) | (self.carried.lanes >= lanes.stop))
        self.observations[0, lanes] = 0.0
        self.observations[0, lanes, self.observations.shape[2] - seen.numbers.shape[1] :] = seen.numbers
        for history, pictures in zip(self.histories, seen.images, strict=True):
            history.begin(pictures, lanes)
        if self.memory is not None:
            self.memory[0, lanes] = 0.0
        self.deciding[0, lanes] = True if deciding is None else deciding

    def draw_noise(self, rng: np.random.Generator, holds: Array) -> None:
        """Draw the random numbers of all decisions. holds [numbers]: for how many decisions each normal one is kept."""
        self.noise = draw_noise(rng, (*self.continuous.shape[:2], len(holds)), self.discrete.shape)
        if (holds > 1).any():
            rows = np.arange(len(self.continuous))[:, None]
            kept = np.take_along_axis(self.noise.normal, (rows - rows % holds)[:, None], axis=0)
            self.noise = self.noise._replace(normal=kept)

    def present(self, group: int = 0) -> Observation:
        """Return what a group's next decision is based on."""
        return self.observation(self.rows[group], self.groups[group])

    def noise_of(self, group: int = 0) -> Noise:
        """Return the random numbers behind a group's next decision."""
        t, lanes = self.rows[group], self.groups[group]
        return Noise(self.noise.normal[t, lanes], self.noise.uniform[t, lanes])

    def put(self, action: Action, values: Array, memory: Array | None = None, group: int = 0) -> None:
        """Store the next decision of a group: what it does, and the values [lanes] of what it sees.

        memory: what its lanes remember after it, [lanes, state_size]; None: a policy without memory.
        """
        t, lanes = self.rows[group], self.groups[group]
        self.continuous[t, lanes], self.discrete[t, lanes], self.log_probs[t, lanes] = action
        self.values[t, lanes] = values
        if self.memory is not None:
            self.memory[t + 1, lanes] = memory

    def observation(self, t: int, lanes: slice = slice(None)) -> Observation:
        """Return what decision t sees in some lanes; -1: what follows the last one."""
        images = tuple(history.window(t, lanes).gather() for history in self.histories)
        return Observation(self.observations[t, lanes], images, None if self.memory is None else self.memory[t, lanes])

    def mask(self, allowed: Sequence[Array] | None, group: int = 0) -> Array | None:
        """Store which choices a group's next decision allows, bool [lanes, choices] per branch; None: all.

        Return what to add to the logits, [lanes, branches, widest]; None while no choice was ever forbidden.
        """
        t, lanes = self.rows[group], self.groups[group]
        if self.masks is None:
            if allowed is None:
                return None
            self._make_masks()
        assert self.masks is not None
        masks: Array = self.masks[t, lanes]
        fill_masks(allowed, masks)
        return masks

    def _make_masks(self) -> None:
        self.masks = np.zeros((*self.discrete.shape, self.space.widest), np.float32)

    def _make_counts(self, parts: int) -> None:
        self.counts = np.ones((*self.discrete.shape[:2], parts), bool)

    def store_counts(self, counts: Array, group: int = 0) -> None:
        """Store which parts of the actions of a group's decision count, bool [lanes, parts]; see `Conditions`."""
        if self.counts is None:
            self._make_counts(counts.shape[1])
        assert self.counts is not None
        self.counts[self.rows[group], self.groups[group]] = counts

    def store(self, step: StepArrays, rewards: Array, final_values: Array | None = None, group: int = 0) -> None:
        """Store the outcome of a group's decision, whose next observations are already in row t + 1.

        rewards [lanes]; final_values [ended]: of the last observations of the episodes that ended, needed where one was
        truncated.
        """
        t, lanes = self.rows[group], self.groups[group]
        if self.memory is not None:
            self.memory[t + 1, lanes][step.ended] = 0.0
        if final_values is not None:
            self.final_values[t, lanes][step.ended] = final_values
        if step.deciding is None and self.deciding[t, lanes].all():
            self.rewards[t, lanes], self.terminated[t, lanes] = rewards, step.terminated
            self.truncated[t, lanes] = step.truncated
            self.deciding[t + 1, lanes] = True
        else:
            self._store_late(step, rewards, t, lanes)
        self.rows[group] += 1

    def _store_late(self, step: StepArrays, rewards: Array, t: int, lanes: slice) -> None:
        """Store a step in which some lanes wait: its rewards belong to the last decision of each lane."""
        ended = step.ends
        deciding = step.decides
        pending = self.pending[lanes]
        pending[self.deciding[t, lanes]] = t
        known = np.flatnonzero((deciding | ended) & (pending >= 0))  # lanes whose decision has its outcome now
        rows, columns = pending[known], known + lanes.start
        self.rewards[rows, columns] = rewards[known]
        self.terminated[rows, columns] = step.terminated[known]
        self.truncated[rows, columns] = step.truncated[known]
        self.final_values[rows, columns] = self.final_values[t, columns]  # counts where truncated only
        pending[known] = -1
        self.deciding[t + 1, lanes] = deciding

    def _of_decisions(self) -> dict[str, Array]:
        """Return the arrays whose rows say what was decided, and on what."""
        names = ("observations", "continuous", "discrete", "log_probs", "values", "masks", "counts", "memory")
        return {name: array for name in names if (array := getattr(self, name)) is not None}

    def close(self) -> None:
        """Put the decisions of earlier rollouts whose outcome is known now into row 0, where their lanes waited."""
        known = self.carried.of(self.pending[self.carried.lanes] != 0)
        for name, array in self._of_decisions().items():
            array[0, known.lanes] = known.arrays.get(name, 0)  # masks that were made later: nothing was forbidden
        for history, stacks in zip(self.histories, known.images, strict=len(known.lanes) > 0):
            history.recall(known.lanes, stacks)
        self.deciding[0, known.lanes] = True
        self.carried = self.carried.of(self.pending[self.carried.lanes] == 0)

    def _open(self, lanes: Array) -> Carried:
        """Return the decisions of this rollout, of some lanes, whose outcome is not known yet."""
        rows = self.pending[lanes]
        arrays = {name: array[rows, lanes] for name, array in self._of_decisions().items()}
        return Carried(lanes, arrays, [history.at(rows, lanes).gather() for history in self.histories])

    def take_carried(self, carried: Carried) -> None:
        """Take the decisions of earlier rollouts from a checkpoint. Raises ValueError unless they fit."""
        lanes, count = carried.lanes, len(carried.lanes)
        waiting = np.flatnonzero(~self.deciding[0])
        if "masks" in carried.arrays:
            self._make_masks()
        if "counts" in carried.arrays:
            self._make_counts(carried.arrays["counts"].shape[-1])
        wanted = {name: (a.dtype, (count, *a.shape[2:])) for name, a in self._of_decisions().items()}
        kinds = {name: (array.dtype, array.shape) for name, array in carried.arrays.items()}
        pictures = [(count, history.frame_stack, *history.pictures.shape[2:]) for history in self.histories]
        if (
            not np.array_equal(lanes, np.intersect1d(lanes, waiting))
            or (count and (kinds != wanted or [stacks.shape for stacks in carried.images] != pictures))
            or not all(np.isfinite(array).all() for array in carried.arrays.values())
        ):
            raise ValueError("decisions whose outcome is not known yet do not fit")
        self.carried = carried
        self.pending[carried.lanes] = 0

    def decided(self) -> Array:
        """Return where a decision was made whose outcome this rollout holds, bool [steps, lanes]."""
        decided = self.deciding[:-1].copy()
        unknown = np.flatnonzero(self.pending >= 0)
        decided[self.pending[unknown], unknown] = False
        return decided

    def batch(
        self,
        advantages: Array,
        decided: Array,
        length: int = 0,
        times: Array | None = None,
        *,
        normalize: bool = True,
    ) -> Batch:
        """Return the decided timesteps with these advantages [steps, lanes] as one flat batch.

        length: of the longest sequence, with memory; the timesteps of a lane are then side by side. times: how often
        each timestep is in the batch, int [steps, lanes], without memory; None: once. normalize: the advantages, by
        their mean and deviation.
        """
        whole = decided.all() and self.memory is None and times is None
        places = np.nonzero(decided) if self.memory is None else np.nonzero(decided.T)[::-1]
        if times is not None:
            places = tuple(np.repeat(place, times[places]) for place in places)

        def flat(array: Array) -> torch.Tensor:
            return torch.from_numpy(array.reshape(decided.size, *array.shape[2:]) if whole else array[places])

        chosen = flat(advantages).numpy()
        normalized = (chosen - chosen.mean()) / (chosen.std() + 1e-10) if normalize else chosen
        return Batch(
            sequences=None if self.memory is None else self._sequences(self.memory, places, length),
            observations=Observations(
                flat(self.observations[:-1]), tuple(history.at(*places) for history in self.histories)
            ),
            continuous=flat(self.continuous),
            discrete=flat(self.discrete),
            masks=None if self.masks is None else flat(self.masks),
            counts=None if self.counts is None else flat(self.counts),
            log_probs=flat(self.log_probs),
            values=flat(self.values),
            advantages=torch.from_numpy(normalized),
            returns=flat(advantages + self.values),
        )

    def _sequences(self, memory: Array, places: tuple[Array, ...], length: int) -> Sequences:
        """Return the decisions at these places, (steps, lanes), as sequences of one episode, at most so long."""
        steps, lanes = places
        ends = (self.terminated | self.truncated)[places]
        episodes = np.cumsum(ends) - ends + lanes * (len(ends) + 1)  # the parts of them that this rollout holds
        begins, lengths, parts = cut(episodes, length)
        states = memory[steps[begins], lanes[begins]]
        return Sequences(*map(torch.from_numpy, (begins, lengths, states, parts)))

    def restart(self) -> None:
        """Begin the next rollout where this one ended."""
        waiting = np.flatnonzero(self.pending >= 0)
        self.carried = together(self.carried, self._open(np.setdiff1d(waiting, self.carried.lanes)))
        self.observations[0] = self.observations[-1]
        for history in self.histories:
            history.restart()
        if self.memory is not None:
            self.memory[0] = self.memory[-1]
        self.deciding[0] = self.deciding[-1]
        self.pending[:] = -1
        self.pending[waiting] = 0  # row 0 takes the outcome: it is of no decision, as their lanes wait
        self.rows = [0] * len(self.groups)
