"""Who may hold seats beside a policy, by name.

`script:NAME` is a script of the game's author, FILE.json or FILE.onnx an exported policy, anything else the folder of a
run, RUN@TIMESTEPS what that run had learned after so many timesteps.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from joybridge.config.errors import ConfigError, no_export
from joybridge.policy.actor import Actor, trained_actors
from joybridge.policy.scripted import find_scripts
from joybridge.policy.table import Guest, Table
from joybridge.run.checkpoint import checkpoints, load_checkpoint
from joybridge.run.folder import run_config
from joybridge.run.own_code import check_code
from joybridge.run.trained import load_actors, trained_after
from joybridge.v1 import bridge_pb2 as pb

SCRIPT, FILES = "script:", (".json", ".onnx")


def run_of(name: str) -> Path | None:
    """Return the folder of the run that a name names, None if it names something else."""
    if name.startswith(SCRIPT) or name.endswith(FILES):
        return None
    run, _ = _run_and_timesteps(name)
    return run


def rated_name(name: str) -> str:
    """Return how `joybridge rate` calls somebody of this name."""
    run = run_of(name)
    if run is None:
        return name
    return f"{run.name}@{int(checkpoints(run)[-1].name)}" if run == Path(name) else Path(name).name


def seat_others(names: Sequence[str], game: str, spec: pb.GameSpec, arenas: int, seed: int) -> Table:
    """Return the seats of some arenas in which all that are named play, in turn, but for the first agent of each arena.

    The turn goes on in the next arena, so all play about equally often. game: its name. The first agent, whose holder
    is 0, is somebody else's. Raises CheckpointError and ConfigError.
    """
    table = Table(spec, arenas, seed)
    if table.seats.count < 2:
        raise ConfigError(f"others: {spec.name} has one agent, which plays alone; leave them out")
    for number, name in enumerate(names, 1):
        table.join(number, load_other(name, game, spec))
    free = table.seats.count - 1  # in each arena
    for arena in range(arenas):
        table.seats.begin(arena, [0, *(1 + (arena * free + np.arange(free)) % len(names))])
    return table


def load_other(name: str, game: str, spec: pb.GameSpec) -> Sequence[Actor | Guest]:
    """Return who plays under a name, a part for each policy or behavior.

    game: the name of the one that is played. Raises CheckpointError and ConfigError.
    """
    if name.startswith(SCRIPT):
        return find_scripts(spec, name.removeprefix(SCRIPT))
    if name.endswith(FILES):
        return [_load_file(Path(name), spec)]
    run, timesteps = _run_and_timesteps(name)
    other = run_config(run)
    check_code(run, other)
    if other.game != game:
        raise ConfigError(f"opponents: {run} plays {other.game}, expected {game}; name a run of this game")
    if timesteps is not None:
        return load_actors(trained_after(run, timesteps), other, spec)
    return trained_actors(other, spec, load_checkpoint(run)[0])


def _run_and_timesteps(name: str) -> tuple[Path, int | None]:
    """Return the folder of a run, and after how many timesteps; None: its newest checkpoint."""
    run, _, timesteps = name.rpartition("@")
    if run and timesteps.isdecimal() and not Path(name).exists():
        return Path(run), int(timesteps)
    return Path(name), None


def _load_file(file: Path, spec: pb.GameSpec) -> Guest:
    if len(spec.behaviors) > 1:
        names = ", ".join(behavior.name for behavior in spec.behaviors)
        raise ConfigError(f"{file} plays one behavior, and who holds seats plays all ({names}); name the run instead")
    try:
        from joybridge.policy.exported import load_exported  # what it needs is an extra of its own
    except ModuleNotFoundError as error:
        raise no_export(file, error) from None
    return load_exported(file, spec)
