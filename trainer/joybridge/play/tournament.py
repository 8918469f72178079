"""Tournaments: frozen policies of one or several runs, and scripts, hold the seats of many matches."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from joybridge.client.sharded_session import session_spec
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor, make_actors, trained_actors
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.players import Players
from joybridge.policy.seats import Result
from joybridge.policy.table import Guest, Table
from joybridge.ppo.threads import use_one_thread
from joybridge.progress import Progress
from joybridge.run.checkpoint import NO_CHECKPOINT, checkpoints, read_checkpoint
from joybridge.run.pool import load_pooled, pooled, thinned
from joybridge.v1 import bridge_pb2 as pb

MAX_ARENAS = 64
DEALS = 2**61  # plus the number of an arena: the second word of the key of who plays its matches


class Trained(NamedTuple):
    """What a run had learned after so many timesteps: what takes part in a tournament."""

    run: Path
    timesteps: int
    checkpoint: Path  # its folder
    number: int | None = None  # in its pool of opponents; None: it is what the checkpoint has learned


def find_trained(run: Path, limit: int) -> list[Trained]:
    """Return at most `limit` policies of a run, evenly chosen from its checkpoints and its pool of opponents.

    The last checkpoint is among them. Raises CheckpointError, and ConfigError if there is none.
    """
    folders = checkpoints(run)
    if not folders:
        raise ConfigError(f"{run} {NO_CHECKPOINT}")
    past = pooled(read_checkpoint(folders[-1])[0])
    found = {timesteps: Trained(run, timesteps, folders[-1], number) for number, timesteps in past.items()}
    found |= {int(folder.name): Trained(run, int(folder.name), folder) for folder in folders}
    return [found[timesteps] for timesteps in thinned([*found], limit)]


def load_actors(trained: Trained, config: Config, spec: pb.GameSpec) -> list[Actor]:
    """Return the actors of what was learned, of the run with this configuration.

    Raises CheckpointError and ConfigError.
    """
    arrays, _ = read_checkpoint(trained.checkpoint)
    if trained.number is None:
        return trained_actors(config, spec, arrays)
    actors = make_actors(config, spec)
    load_pooled(actors, arrays, trained.number)
    return actors


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
    rng = np.random.Generator(np.random.Philox(key=[seed, DEALS + arena], counter=[0, 0, 0, match]))
    decks = [rng.permutation(players) for _ in range(-(-seats // players))]
    return rng.permutation(np.concatenate(decks)[:seats])
