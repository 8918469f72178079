"""Collecting experience: groups of arenas take turns, so neither process waits for the other.

While one group is played by the simulators, the policies act in another. Every group has sessions of its own. Which
arenas it has depends on the configuration alone, and what they play on the seed and their numbers alone.
"""

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise

from joybridge.trainer.config import Config
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.layouts import make_acts
from joybridge.trainer.policy import Policy
from joybridge.trainer.profiler import Profiler
from joybridge.trainer.wire.client import Session
from joybridge.trainer.wire.sharded_session import (
    ShardedSession,
    Snapshot,
    check_alike,
    open_session,
    single_sessions,
    split,
)


class Group:
    """Arenas that are played at the same time."""

    def __init__(self, index: int, simulators: Session | ShardedSession, arenas: int) -> None:
        """Take an open session of so many arenas."""
        self.index, self.simulators = index, simulators
        self.acts = make_acts(simulators.spec, arenas)

    def save(self) -> list[Snapshot]:
        """Return a snapshot of each session. Raises SimulatorError if the game does not support snapshots."""
        return [session.save() for session in single_sessions(self.simulators)]


def collect(groups: Sequence[Group], policies: Sequence[Policy], profiler: Profiler, steps: int) -> Iterator[None]:
    """Play `steps` decisions of every arena: act, step, store. Yield after each; no action is pending after the last.

    Raises SimulatorError.
    """
    for group in groups:
        act(group, policies, profiler)
    for step in range(steps):
        for group in groups:
            with profiler.measure_wait(group.simulators):
                outcome = group.simulators.receive()
            with profiler.measure("act"):
                for policy in policies:
                    policy.store(outcome, group.index)
            if step + 1 < steps:
                act(group, policies, profiler)
        yield


def act(group: Group, policies: Sequence[Policy], profiler: Profiler) -> None:
    """Sample the actions of a group and send them, without waiting for the step."""
    with profiler.measure("act"):
        for policy in policies:
            policy.act(group.simulators.steps, group.acts, group.index)
        group.simulators.send(group.acts)


def group_bounds(config: Config) -> list[int]:
    """Return the first arena of each group and, last, their number; there are no more groups than arenas."""
    return split(config.arenas, min(config.groups, config.arenas))


def assign(addresses: Sequence[str], arenas: Sequence[int]) -> list[list[str]]:
    """Return the simulators of each group, given its arenas: as few messages as possible."""
    groups = len(arenas)
    homes = [list(addresses[group::groups]) or [addresses[group % len(addresses)]] for group in range(groups)]
    return [home[:limit] for home, limit in zip(homes, arenas, strict=True)]


def open_groups(config: Config, addresses: Sequence[str], snapshots: Sequence[Snapshot] | None) -> list[Group]:
    """Open the sessions of all groups, new or from snapshots in that order.

    Raises SimulatorError, and ConfigError for another number of snapshots.
    """
    bounds = list(pairwise(group_bounds(config)))
    homes = assign(addresses, [end - first for first, end in bounds])
    sessions = sum(map(len, homes))
    if snapshots is not None and len(snapshots) != sessions:
        raise ConfigError(
            f"the checkpoint holds {len(snapshots)} sessions, but {len(homes)} groups at {len(addresses)} simulators "
            f"make {sessions}; resume with {len(snapshots)} simulators"
        )
    saved = iter(snapshots or ())
    groups: list[Group] = []
    try:
        for index, (home, (first, end)) in enumerate(zip(homes, bounds, strict=True)):
            session = open_session(
                home, config.game, arenas=end - first, first_arena=first, seed=config.seed,
                options=[config.options] * len(home), parameters=config.parameters,
                snapshots=list(islice(saved, len(home))),
            )  # fmt: skip
            groups.append(Group(index, session, end - first))
            check_alike(single_sessions(session)[0], single_sessions(groups[0].simulators)[0])
    except BaseException:
        close_groups(groups)
        raise
    return groups


def close_groups(groups: Sequence[Group]) -> None:
    """End all sessions."""
    for group in groups:
        group.simulators.close()
