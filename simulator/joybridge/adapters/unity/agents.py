"""The agents of one behavior in a message of a player, as arrays."""

from dataclasses import dataclass

from joybridge.contract.tensors import Array


@dataclass
class Agents:
    """Agents that ask for a decision or whose episodes have ended, in the order of the message."""

    ids: Array  # int64 [agents], of their episodes
    done: Array  # bool [agents]
    interrupted: Array  # bool [agents]; counts only if done
    rewards: Array  # float32 [agents, channels]
    allowed: Array  # bool [agents, choices of all branches]
    observations: list[Array]  # per sensor [agents, *shape]

    def rows(self, index: Array) -> "Agents":
        """Return some of the agents."""
        seen = [one[index] for one in self.observations]
        return Agents(
            self.ids[index], self.done[index], self.interrupted[index], self.rewards[index], self.allowed[index], seen
        )
