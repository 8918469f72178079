"""Collecting experience: groups of arenas take turns, so neither process waits for the other.

While one group is played by the simulators, the policies act in another. Every group has sessions of its own. The
configuration alone determines the arenas of each group; the seed and the numbers of its arenas alone determine what is
played in it.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np

from joybridge.client.client import Distributions, Session
from joybridge.client.several_session import SeveralSession
from joybridge.client.sharded_session import (
    ShardedSession,
    Snapshot,
    check_alike,
    divide,
    open_session,
    session_spec,
    single_sessions,
)
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import drawn, fixed
from joybridge.contract.codec import StepArrays
from joybridge.contract.sharding import split
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.policy.hand import Hand, make_hands
from joybridge.policy.lineup import arenas_by_game, make_lineup
from joybridge.policy.policy import Policy
from joybridge.run.league import Opponents
from joybridge.run.profiler import Profiler


class Group:
    """Arenas that are played at the same time."""

    def __init__(
        self, index: int, session: Session | ShardedSession | SeveralSession, arenas: int, hands: list[Hand]
    ) -> None:
        """Take an open session of so many arenas. hands: one per behavior, or none."""
        self.index, self.session, self.hands = index, session, hands
        self.acts = make_acts(session.spec, arenas)
        self.opponents: Opponents | None = None  # None: the learner holds all seats

    @property
    def steps(self) -> Sequence[StepArrays]:
        """The last steps as the learner sees them: lanes that others hold wait."""
        return self.session.steps if self.opponents is None else self.opponents.seen

    @property
    def played(self) -> Sequence[Array] | None:
        """The lanes that the learner held in the last decision, a bool for each, per behavior; None: all."""
        return None if self.opponents is None else self.opponents.played

    def save(self) -> list[Snapshot]:
        """Return a snapshot of each session. Raises SimulatorError if the game does not support snapshots."""
        return [session.save() for session in single_sessions(self.session)]


def collect(groups: Sequence[Group], policies: Sequence[Policy], profiler: Profiler, steps: int) -> Iterator[None]:
    """Play `steps` decisions of every arena: act, step, store. Yield after each; no action is pending after the last.

    Raises SimulatorError.
    """
    for step in range(steps + 1):  # the first round only acts, the last one only stores
        for group in groups:
            if step > 0:
                with profiler.measure_wait(group.session):
                    outcome = group.session.receive()
            with profiler.measure("act"):
                if step > 0:
                    if group.opponents:
                        group.opponents.store(outcome)
                    for policy in policies:
                        policy.store(group.steps, group.index, group.played)
                    for hand, ended in zip(group.hands, outcome, strict=False):  # there may be no hands
                        hand.store(ended)
                if step < steps:
                    for policy in policies:
                        policy.act(group.steps, group.acts, group.index)
                    for policy in policies:
                        if policy.notes_acts:
                            policy.note(group.acts, group.index)
                    if group.opponents:
                        group.opponents.act(group.session.steps, group.acts)
                    for hand, now, act in zip(group.hands, group.session.steps, group.acts, strict=False):
                        hand.apply(now, act)
                    group.session.send(group.acts)
        if step > 0:
            yield


def group_bounds(config: Config) -> list[int]:
    """Return the first arena of each group and, last, their number; there are no more groups than arenas."""
    if config.games:
        return [0, *np.cumsum([sum(games) for games in arenas_by_game(config)]).tolist()]
    return split(config.arenas, min(config.pipeline_groups, config.arenas))


def assign(addresses: Sequence[str], arenas: Sequence[int]) -> list[list[str]]:
    """Return the addresses that each group uses, given the number of arenas of each group.

    Groups share an address only if there are fewer addresses than groups; so there are as few messages as possible.
    """
    groups = len(arenas)
    homes = [list(addresses[group::groups]) or [addresses[group % len(addresses)]] for group in range(groups)]
    return [home[:limit] for home, limit in zip(homes, arenas, strict=True)]


def open_groups(
    config: Config,
    addresses: Sequence[str],
    snapshots: Sequence[Snapshot] | None,
    parameters: Mapping[str, float],
    distributions: Distributions,
) -> list[Group]:
    """Open the sessions of all groups: new, or from one snapshot per session, in the order of the groups.

    parameters: that have one value. distributions: how others are drawn at each episode.

    Raises SimulatorError, and ConfigError if the number of snapshots differs from that of sessions.
    """
    if config.games:
        return open_groups_of_games(config, addresses, snapshots)
    bounds = list(pairwise(group_bounds(config)))
    homes = assign(addresses, [end - first for first, end in bounds])
    check_snapshots(snapshots, homes, addresses)
    saved = iter(snapshots or ())
    groups: list[Group] = []
    with ExitStack() as opened:
        for index, (home, (first, end)) in enumerate(zip(homes, bounds, strict=True)):
            whole = replace(
                session_spec(config, end - first, config.seed),
                first_arena=first,
                parameters=parameters,
                distributions=distributions,
            )
            session = open_session(home, divide(whole, len(home), snapshots=[*islice(saved, len(home))]))
            opened.callback(session.close)
            hands = make_hands(config, session.spec, first, end, config.seed)
            groups.append(Group(index, session, end - first, hands))
            check_alike(single_sessions(session)[0], single_sessions(groups[0].session)[0])
        opened.pop_all()
    return groups


def open_groups_of_games(config: Config, addresses: Sequence[str], snapshots: Sequence[Snapshot] | None) -> list[Group]:
    """Do what `open_groups` does where several games are played: each has its share of the arenas of each group."""
    lineup, groups = make_lineup(addresses[0], config), arenas_by_game(config)
    of_groups = assign(addresses, [sum(arenas) for arenas in groups])
    homes = [
        ([game.simulator] if game.simulator else home)[:arenas]
        for home, counts in zip(of_groups, groups, strict=True)
        for game, arenas in zip(lineup.games.values(), counts, strict=True)
    ]
    check_snapshots(snapshots, homes, addresses, len(lineup.games))
    saved, homes_left, first = iter(snapshots or ()), iter(homes), dict.fromkeys(lineup.games, 0)
    made: list[Group] = []
    bounds = group_bounds(config)
    with ExitStack() as opened:
        for index, counts in enumerate(groups):
            sessions: list[Session | ShardedSession] = []
            for (name, game), arenas, home in zip(lineup.games.items(), counts, homes_left, strict=False):
                whole = replace(
                    session_spec(config, arenas, config.seed),
                    game=game.game,
                    first_arena=first[name],
                    options=game.options,
                    parameters=fixed(game.parameters),
                    distributions=drawn(game.parameters),
                )
                session = open_session(home, divide(whole, len(home), snapshots=[*islice(saved, len(home))]))
                opened.callback(session.close)
                sessions.append(session)
                first[name] += arenas
            several = SeveralSession(sessions, counts, [lineup.translation(name) for name in lineup.games], lineup.spec)
            hands = make_hands(config, lineup.spec, bounds[index], bounds[index + 1], config.seed)
            made.append(Group(index, several, sum(counts), hands))
        opened.pop_all()
    return made


def check_snapshots(
    snapshots: Sequence[Snapshot] | None, homes: Sequence[Sequence[str]], addresses: Sequence[str], games: int = 1
) -> None:
    """Raise ConfigError unless there is a snapshot for each session, if there are any. homes: their addresses.

    games: how many are played, each in sessions of its own.
    """
    sessions = sum(map(len, homes))
    if snapshots is not None and len(snapshots) != sessions:
        raise ConfigError(
            f"the checkpoint holds {len(snapshots)} sessions, but {len(homes) // games} groups at {len(addresses)} "
            f"simulators make {sessions}; resume with {len(snapshots) // games} simulators"
        )
