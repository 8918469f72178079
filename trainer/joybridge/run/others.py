"""Who may hold seats beside a policy, by name: `script:NAME` of the game's author, or the folder of a run."""

from collections.abc import Sequence
from pathlib import Path

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.policy.actor import Actor, trained_actors
from joybridge.policy.scripted import Script, find_scripts
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import run_config
from joybridge.v1 import bridge_pb2 as pb

SCRIPT = "script:"


def load_other(name: str, config: Config, spec: pb.GameSpec) -> Sequence[Actor | Script]:
    """Return who plays under a name, a part for each policy or behavior.

    config: of the game that is played. Raises CheckpointError and ConfigError.
    """
    if name.startswith(SCRIPT):
        return find_scripts(spec, name.removeprefix(SCRIPT))
    other = run_config(run := Path(name))
    if other.game != config.game:
        raise ConfigError(f"opponents: {run} plays {other.game}, expected {config.game}; name a run of this game")
    return trained_actors(other, spec, load_checkpoint(run)[0])
