"""Who may hold seats beside a policy, by name.

`script:NAME` is a script of the game's author, FILE.json or FILE.onnx an exported policy, anything else the folder of a
run.
"""

from collections.abc import Sequence
from pathlib import Path

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.policy.actor import Actor, trained_actors
from joybridge.policy.scripted import find_scripts
from joybridge.policy.table import Guest
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import run_config
from joybridge.v1 import bridge_pb2 as pb

SCRIPT, FILES = "script:", (".json", ".onnx")


def is_run(name: str) -> bool:
    """Return whether a name is that of the folder of a run."""
    return not name.startswith(SCRIPT) and not name.endswith(FILES)


def load_other(name: str, config: Config, spec: pb.GameSpec) -> Sequence[Actor | Guest]:
    """Return who plays under a name, a part for each policy or behavior.

    config: of the game that is played. Raises CheckpointError and ConfigError.
    """
    if name.startswith(SCRIPT):
        return find_scripts(spec, name.removeprefix(SCRIPT))
    if not is_run(name):
        return [_load_file(Path(name), spec)]
    other = run_config(run := Path(name))
    if other.game != config.game:
        raise ConfigError(f"opponents: {run} plays {other.game}, expected {config.game}; name a run of this game")
    return trained_actors(other, spec, load_checkpoint(run)[0])


def _load_file(file: Path, spec: pb.GameSpec) -> Guest:
    if len(spec.behaviors) > 1:
        names = ", ".join(behavior.name for behavior in spec.behaviors)
        raise ConfigError(f"{file} plays one behavior, and who holds seats plays all ({names}); name the run instead")
    try:
        from joybridge.policy.exported import load_exported  # what it needs is an extra of its own
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{file}: needs the module {error.name}; install it with `pip install 'joybridge[export]'`"
        ) from None
    return load_exported(file, spec)
