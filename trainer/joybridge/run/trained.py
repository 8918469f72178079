"""What runs had learned: the policies in their checkpoints, and the past ones in their pools of opponents."""

from pathlib import Path
from typing import NamedTuple

from joybridge.config.config import Config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.policy.actor import Actor, make_actors, trained_actors
from joybridge.run.checkpoint import NO_CHECKPOINT, checkpoints, load_checkpoint, read_checkpoint
from joybridge.run.pool import load_pooled, pooled, thinned
from joybridge.v1 import bridge_pb2 as pb


class Trained(NamedTuple):
    """What a run had learned after so many timesteps."""

    run: Path
    timesteps: int
    checkpoint: Path  # its folder
    number: int | None = None  # in its pool of opponents; None: it is what the checkpoint has learned


def find_trained(run: Path, limit: int) -> list[Trained]:
    """Return at most `limit` policies of a run, evenly chosen from its checkpoints and its pool of opponents.

    The last checkpoint is among them. Raises CheckpointError, and ConfigError if there is none.
    """
    found = _all_trained(run)
    return [found[timesteps] for timesteps in thinned([*found], limit)]


def trained_after(run: Path, timesteps: int) -> Trained:
    """Return what a run had learned after so many timesteps. Raises ConfigError, and CheckpointError if it has none."""
    found = _all_trained(run)
    if timesteps not in found:
        raise CheckpointError(
            f"{run} has no policy of {timesteps} timesteps, only of {', '.join(map(str, sorted(found)))}; "
            "name one of them"
        )
    return found[timesteps]


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


def _all_trained(run: Path) -> dict[int, Trained]:
    """Return all policies of a run, by their timesteps. Raises CheckpointError, and ConfigError if there is none."""
    folders = checkpoints(run)
    if not folders:
        raise ConfigError(f"{run} {NO_CHECKPOINT}")
    arrays, manifest = load_checkpoint(run)  # the newest that is whole
    kept = {int(folder.name): folder for folder in folders if int(folder.name) <= manifest.timesteps}
    newest = kept[manifest.timesteps]
    found = {timesteps: Trained(run, timesteps, newest, number) for number, timesteps in pooled(arrays).items()}
    return found | {timesteps: Trained(run, timesteps, folder) for timesteps, folder in kept.items()}
