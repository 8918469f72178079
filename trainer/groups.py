"""Groups of arenas that take turns: while one is played at the simulators, the policies decide for another.

So neither process waits for the other. Every group has a session of its own; which arenas it has depends on the
configuration alone, and what they play on the seed and their numbers alone.
"""

from collections.abc import Sequence
from itertools import pairwise

from trainer.actions import make_acts
from trainer.config import Config, ConfigError
from trainer.metrics import Journal, Stopwatch
from trainer.policy import Policy
from trainer.shards import Shards, Snapshot, split


class Group:
    """One of them."""

    def __init__(self, index: int, simulators: Shards, arenas: int) -> None:
        """Take an open session of so many arenas."""
        self.index, self.simulators = index, simulators
        self.acts = make_acts(simulators.spec, arenas)

    def begin(self, policies: Sequence[Policy]) -> None:
        """Show the policies the first observations of new episodes."""
        for policy in policies:
            policy.begin(self.simulators.steps, self.index)

    def act(self, policies: Sequence[Policy], watch: Stopwatch) -> None:
        """Let the policies decide, and send the decision off."""
        with watch.measure("act"):
            for policy in policies:
                policy.act(self.simulators.steps, self.acts, self.index)
            self.simulators.send(self.acts)

    def take(self, policies: Sequence[Policy], journals: Sequence[Journal], watch: Stopwatch) -> None:
        """Wait for what follows the decision, and store it."""
        with watch.measure_wait(lambda: self.simulators.simulate_seconds):
            steps = self.simulators.receive()
        with watch.measure("act"):
            for policy, journal in zip(policies, journals, strict=True):
                rewards = policy.take(steps, self.index)
                journal.episodes.add(steps[policy.behaviour], rewards, policy.groups[self.index])


def group_count(config: Config) -> int:
    """Return how many groups there are: no more than arenas."""
    return min(config.groups, config.arenas)


def open_groups(config: Config, addresses: Sequence[str], snapshots: Sequence[Snapshot] | None) -> list[Group]:
    """Open a session per group and simulator, new or from snapshots in that order.

    Raises SimulatorError, and ConfigError for another number of snapshots.
    """
    count, simulators = group_count(config), len(addresses)
    parts: list[Sequence[Snapshot] | None] = [None] * count
    if snapshots is not None:
        if len(snapshots) != count * simulators:
            raise ConfigError(
                f"the checkpoint holds {len(snapshots)} sessions, {count} groups at {simulators} simulators make "
                f"{count * simulators}; resume with as many simulators as before"
            )
        parts = [snapshots[group * simulators : (group + 1) * simulators] for group in range(count)]
    groups: list[Group] = []
    try:
        for index, (first, end) in enumerate(pairwise(split(config.arenas, count))):
            shards = Shards(
                addresses, config.game, arenas=end - first, first_arena=first, seed=config.seed,
                options=[config.options] * simulators, parameters=config.parameters, snapshots=parts[index],
            )  # fmt: skip
            groups.append(Group(index, shards, end - first))
    except BaseException:
        close_groups(groups)
        raise
    return groups


def close_groups(groups: Sequence[Group]) -> None:
    """End all sessions."""
    for group in groups:
        group.simulators.close()
