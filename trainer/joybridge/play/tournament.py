"""Tournaments: frozen policies of one or several runs, and scripts, hold the seats of many matches."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing

import numpy as np

from joybridge.client.sharded_session import session_spec
from joybridge.config.config import Config
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.players import Players
from joybridge.policy.seats import Result
from joybridge.policy.table import Guest, Table
from joybridge.ppo.threads import use_one_thread
from joybridge.progress import Progress

MAX_ARENAS = 64
DEALS = 2**61  # plus the number of an arena: the second word of the key of who plays its matches


def play_tournament(
    players: Mapping[str, Sequence[Actor | Guest]],
    config: Config,
    *,
    address: str,
    matches: int,
    seed: int,
    say: Callable[[str], None],
) -> list[Result]:
    """Play at least so many matches; in the results, holders are indices of `players`.

    config: the game, its options and the limits of all hands. Every arena plays as many matches, so long ones count as
    often as short ones. `seed` fixes games, seats and samples. Raises SimulatorError and ConfigError.
    """
    use_one_thread()
    arenas = min(MAX_ARENAS, matches, fitting_spec(address, config).max_arenas)
    with closing(session_spec(config, arenas, seed).open(address)) as session:
        spec = session.spec
        seated, table = Players([], config, spec, arenas, seed), Table(spec, arenas, seed)
        seated.seat(table)
        for holder, actors in enumerate(players.values()):
            table.join(holder, actors)
        for arena in range(arenas):
            table.seats.begin(arena, deal(len(players), table.seats.count, seed, arena, 0))
        seated.begin(session.steps)
        rounds, played = -(-matches // arenas), [0] * arenas
        results: list[Result] = []
        progress = Progress(say)
        while min(played) < rounds:
            steps = session.step(seated.act(session.steps))
            for result in table.seats.finish(steps):
                arena = result.arena
                if played[arena] < rounds:
                    results.append(result)
                played[arena] += 1
                table.seats.deal(arena, deal(len(players), table.seats.count, seed, arena, played[arena]))
            seated.store(steps)
            progress.report(f"{len(results):,} of {rounds * arenas:,} matches")
    return results


def deal(players: int, seats: int, seed: int, arena: int, match: int) -> Array:
    """Return who holds which seat of a match, [seats]: all players equally often, no one twice if there are enough."""
    rng = np.random.Generator(
        np.random.Philox(key=np.array([seed, DEALS + arena], np.uint64), counter=[0, 0, 0, match])
    )
    decks = [rng.permutation(players) for _ in range(-(-seats // players))]
    return rng.permutation(np.concatenate(decks)[:seats])
