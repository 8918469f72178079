"""The lanes of one behavior in a session: what they see, and the step that is being put together from all players."""

import numpy as np

from joybridge.adapters.unity.agents import Agents
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array


class Lanes:
    """One behavior. A lane without an agent waits, and sees what its last agent saw, at first zeros."""

    def __init__(self, form: BehaviorForm, arenas: int) -> None:
        """Take the form of the behavior."""
        self.form, self.count = form, arenas * form.agents
        self._shapes = [(self.count, *one.sensor().shape) for one in form.sensors]
        starts = np.cumsum([0, *form.sizes]).tolist()
        self._branches = [slice(starts[index], starts[index] + form.sizes[index]) for index in form.branches]
        self.clear()

    def clear(self) -> None:
        """Start over, without agents."""
        self._seen = [np.zeros(shape, one.dtype) for shape, one in zip(self._shapes, self.form.sensors, strict=True)]
        self._every_lane = np.arange(self.count)
        self.begin()

    def begin(self) -> None:
        """Begin a step: nobody decides, and nothing was earned."""
        self._copied = False  # what was seen before, which the last step has
        self._allowed = np.ones((self.count, sum(self.form.sizes)), bool)
        self._deciding = np.zeros(self.count, bool)
        self._rewards = np.zeros((self.count, 2), np.float32)
        self._terminated, self._truncated = np.zeros((2, self.count), bool)
        self._ends: list[tuple[Array, Agents, Array]] = []

    def end(self, lanes: Array, agents: Agents, metrics: Array) -> None:
        """Take agents whose episodes have ended. metrics: float32 [agents, metrics]."""
        self._rewards[lanes] = agents.rewards
        self._terminated[lanes], self._truncated[lanes] = ~agents.interrupted, agents.interrupted
        self._see(lanes, agents.observations)
        self._ends.append((lanes, agents, metrics))

    def ask(self, lanes: Array, agents: Agents, known: Array) -> None:
        """Take agents that ask for a decision. known: bool [agents], those that have decided before.

        What others have earned belongs to no decision.
        """
        self._deciding[lanes] = True
        self._rewards[lanes[known]] = agents.rewards[known]
        self._allowed[lanes] = agents.allowed
        self._see(lanes, agents.observations)

    def _see(self, lanes: Array, observations: list[Array]) -> None:
        if np.array_equal(lanes, self._every_lane):
            self._seen, self._copied = observations, False
            return
        if not self._copied:
            self._seen, self._copied = [one.copy() for one in self._seen], True
        for seen, values in zip(self._seen, observations, strict=True):
            seen[lanes] = values

    def step(self) -> StepArrays:
        """Return the step."""
        step = StepArrays(self._seen, self._rewards, self._terminated, self._truncated)
        if not self._allowed.all():
            step.masks = [self._allowed[:, branch] for branch in self._branches]
        if not self._deciding.all():
            step.deciding = self._deciding
        if self._ends:
            lanes = np.concatenate([ended for ended, _, _ in self._ends])
            order = np.argsort(lanes)
            step.ended = lanes[order].astype(np.int32)
            step.final_observations = [
                np.concatenate([agents.observations[index] for _, agents, _ in self._ends])[order]
                for index in range(len(self._seen))
            ]
            if self.form.metrics:
                step.metrics = np.concatenate([metrics for _, _, metrics in self._ends])[order]
        return step
