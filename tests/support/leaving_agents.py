"""A parallel environment of PettingZoo in which a runner leaves early and one comes late."""

import numpy as np
from gymnasium import spaces


class Leaving:
    """Runner 0 is terminated in the second decision. Runner 1 comes then. All others are truncated in the fourth."""

    metadata = {"render_modes": ["human"]}  # noqa: RUF012
    possible_agents = ["runner_0", "runner_1", "judge"]  # noqa: RUF012

    def observation_space(self, agent):
        return spaces.Box(0, 100, (1,), np.float32)

    def action_space(self, agent):
        return spaces.Discrete(2) if agent == "judge" else spaces.Box(-1.0, 1.0, (1,))

    def reset(self, seed=None, options=None):
        self.clock, self.agents = 0, ["runner_0", "judge"]
        return self.observe(self.agents), {agent: {} for agent in self.agents}

    def step(self, actions):
        assert set(actions) == set(self.agents)
        self.clock += 1
        seen = list(self.agents)
        if self.clock == 2:
            self.agents, seen = ["runner_1", "judge"], ["runner_0", "runner_1", "judge"]
        if self.clock == 4:
            self.agents = []
        return (
            self.observe(seen),
            {agent: float(self.clock) for agent in seen},
            {agent: agent == "runner_0" and self.clock == 2 for agent in seen},
            dict.fromkeys(seen, self.clock == 4),
            {agent: {} for agent in seen},
        )

    def observe(self, agents):
        return {agent: np.array([10 * self.possible_agents.index(agent) + self.clock], np.float32) for agent in agents}


class Hiding(Leaving):
    """The same, but nobody observes the judge."""

    def observe(self, agents):
        return super().observe([agent for agent in agents if agent != "judge"])


parallel_env = Leaving
