"""Groups of arenas that take turns: while one is played at the simulators, the policies decide for another.

So neither process waits for the other. Every group has a session of its own, or several where there are more
simulators than groups; which arenas it has depends on the configuration alone, and what they play on the seed and
their numbers alone.
"""

from collections.abc import Sequence
from itertools import islice, pairwise

from joybridge.trainer.agent import Policy
from joybridge.trainer.config import Config, ConfigError
from joybridge.trainer.layouts import make_acts
from joybridge.trainer.metrics import Journal, Stopwatch
from joybridge.trainer.wire.shards import Shards, Snapshot, check_alike, split


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
                journal.episodes.add(steps[policy.behavior], rewards, policy.groups[self.index])


def group_count(config: Config) -> int:
    """Return how many groups there are: no more than arenas."""
    return min(config.groups, config.arenas)


def share_out(addresses: Sequence[str], arenas: Sequence[int]) -> list[list[str]]:
    """Return the simulators of each group, given its arenas: no more messages than there must be."""
    groups = len(arenas)
    homes = [list(addresses[group::groups]) or [addresses[group % len(addresses)]] for group in range(groups)]
    return [home[:most] for home, most in zip(homes, arenas, strict=True)]


def open_groups(config: Config, addresses: Sequence[str], snapshots: Sequence[Snapshot] | None) -> list[Group]:
    """Open the groups' sessions, new or from snapshots in that order.

    Raises SimulatorError, and ConfigError for another number of snapshots.
    """
    bounds = list(pairwise(split(config.arenas, group_count(config))))
    homes = share_out(addresses, [end - first for first, end in bounds])
    sessions = sum(map(len, homes))
    if snapshots is not None and len(snapshots) != sessions:
        raise ConfigError(
            f"the checkpoint holds {len(snapshots)} sessions, {len(homes)} groups at {len(addresses)} simulators make "
            f"{sessions}; resume at {len(snapshots)} simulators"
        )
    saved = iter(snapshots or ())
    groups: list[Group] = []
    try:
        for index, (home, (first, end)) in enumerate(zip(homes, bounds, strict=True)):
            shards = Shards(
                home, config.game, arenas=end - first, first_arena=first, seed=config.seed,
                options=[config.options] * len(home), parameters=config.parameters,
                snapshots=list(islice(saved, len(home))),
            )  # fmt: skip
            groups.append(Group(index, shards, end - first))
            check_alike(shards.sessions[0], groups[0].simulators.sessions[0])
    except BaseException:
        close_groups(groups)
        raise
    return groups


def close_groups(groups: Sequence[Group]) -> None:
    """End all sessions."""
    for group in groups:
        group.simulators.close()
