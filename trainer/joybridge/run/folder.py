"""The folder of a run: its default name, its configuration and spec, and whether that may be trained or played.

The spec is that of the game under the options of the training, so that policies can be made without a simulator.
"""

import difflib
import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from google.protobuf import json_format

from joybridge.config.config import (
    MAY_CHANGE,
    OF_THE_GAME,
    PLAYABLE_KEYS,
    PLAYABLE_KEYS_OF_A_GAME,
    Config,
    dump_config,
    load_config,
)
from joybridge.config.config_files import read_overrides
from joybridge.config.differences import differences, in_words
from joybridge.config.errors import ConfigError
from joybridge.config.files import storing, write_atomically
from joybridge.config.games import GameConfig
from joybridge.config.wrong_keys import FORMS
from joybridge.contract.files import read_file
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.text import printable
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.own_code import check_code
from joybridge.v1 import bridge_pb2 as pb

SPEC = "spec.json"  # in the folder of a run
MAX_SPEC_BYTES = 2**24  # of it
MAX_NAME_CHARS = 120  # of the default name of a run


def run_name(config: Config, name: str, overrides: Sequence[str]) -> str:
    """Return the default name of a run's folder, from the name of the configuration's file and its overrides.

    Keys that may change in a resumed run are left out. The order of overrides does not matter.
    """
    pairs = {key.removeprefix("policy."): value for key, value in (override.split("=", 1) for override in overrides)}
    kept = [key for key in sorted(pairs) if key not in (*MAY_CHANGE, "seed", "game")]
    text = "-".join([config.game, name, *(f"{_slug(key)}={_slug(pairs[key])}" for key in kept)])
    if len(text) > MAX_NAME_CHARS:
        text = f"{text[:MAX_NAME_CHARS]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    return f"{text}-s{config.seed}"


def _slug(text: str) -> str:
    """Return a text as a part of a file name."""
    return re.sub(r"[^\w.+-]+", "_", text).strip("_")


def check_run(config: Config, run: Path, *, resume: bool) -> None:
    """Raise ConfigError unless `config` can be trained in the folder `run`.

    A resumed run must have been configured alike; only MAY_CHANGE may differ, and `total_timesteps` may grow. If it has
    saved nothing, it starts over.
    """
    if resume and (has_checkpoint(run) or not run.is_dir()):
        before = run_config(run)
        changed = changes(before, config)
        if before.total_timesteps < config.total_timesteps:
            del changed["total_timesteps"]
        elif "total_timesteps" in changed:
            raise ConfigError(
                f"cannot resume {run}: total_timesteps was {before.total_timesteps} and can only grow, got "
                f"{config.total_timesteps}; to end earlier, set stop_at"
            )
        if changed:
            now = config.model_dump()
            words = in_words(list(differences(changed, {key: now[key] for key in changed})))
            raise ConfigError(
                f"cannot resume {run}: {words}; resume {run}/config.yaml, or use another --run for a new configuration"
            )
    elif not resume and has_checkpoint(run):
        raise ConfigError(
            f"{run} already holds a run; name another folder with --run, or continue it with joybridge train --resume"
        )


def keep_config(config: Config, run: Path) -> None:
    """Write the whole configuration into the folder of a run. Raises StorageError."""
    with storing(run):
        run.mkdir(parents=True, exist_ok=True)
    write_atomically(run / "config.yaml", dump_config(config).encode())


def keep_spec(spec: pb.GameSpec, run: Path) -> None:
    """Write the spec of the game that is trained into the folder of a run. Raises StorageError."""
    write_atomically(run / SPEC, json_format.MessageToJson(spec, preserving_proto_field_name=True).encode())


def run_spec(run: Path) -> pb.GameSpec:
    """Return the spec of the game as it was trained. Raises ConfigError."""
    path = run / SPEC
    try:
        spec = json_format.Parse(read_file(path, MAX_SPEC_BYTES), pb.GameSpec())
        check_spec(spec)
    except FileNotFoundError:
        if not run.is_dir():
            raise _no_run(run) from None
        raise ConfigError(
            f"{run} has no {SPEC}, which says what its policies observe and control; training writes it: continue the "
            f"run with `joybridge train {run}/config.yaml --run {run} --resume`"
        ) from None
    except (OSError, ValueError, SpecError, json_format.ParseError) as error:
        reason = printable(str(error).partition("\n")[0])
        raise ConfigError(f"{path} cannot be read: {reason}; continue the run, which writes it again") from error
    return spec


def run_config(run: Path) -> Config:
    """Return the configuration that a run was made with. Raises ConfigError, which names runs of similar names."""
    if not (run / "config.yaml").exists():
        raise _no_run(run)
    return load_config(run / "config.yaml")


def _no_run(run: Path) -> ConfigError:
    near = difflib.get_close_matches(run.name, [path.parent.name for path in run.parent.glob("*/config.yaml")])
    hint = f"; did you mean {', '.join(str(run.parent / name) for name in near)}?" if near else ""
    what = "it has no config.yaml" if run.is_dir() else "there is no such folder"
    return ConfigError(f"{run} is not the folder of a run: {what}{hint}")


def play_config(run: Path, overrides: Sequence[str]) -> Config:
    """Return the configuration under which the policies of a run play, with "key=value" overrides. Raises ConfigError.

    Only options and parameters of the game, the limits of the hand, the time to wait for a simulator and the transport
    may differ from the training. Of a curriculum, the last lesson is played. Raises UntrustedRunError for code that
    may not be imported.
    """
    given = read_overrides(overrides)
    if "game" in given:
        raise ConfigError(
            f"game belongs to the training of {run}; another program takes its part with --pygame PROGRAM, and another "
            "class with --game MODULE:CLASS"
        )
    trained, config = run_config(run), load_config(run / "config.yaml", overrides)
    check_code(run, trained)
    check_playable(trained, config, str(run))
    last = config.in_last_lesson()
    chosen = {name: config.parameters[name] for name in given.get("parameters", {})}
    limits = {name: getattr(config.hand, name) for name in given.get("hand", {})}
    return last.model_copy(update={"parameters": last.parameters | chosen, "hand": last.hand.model_copy(update=limits)})


def changes(before: Config, now: Config) -> dict[str, Any]:
    """Return what was in keys that have changed and may not in the middle of a run."""
    old, new = before.model_dump(), now.model_dump()
    changed = {key: old[key] for key in new if old[key] != new[key] and key not in (*MAY_CHANGE, "games")}
    return changed | ({"games": old["games"]} if _played(before) != _played(now) else {})


def _played(config: Config) -> list[tuple[str, GameConfig]]:
    """Return several games in their order, which says where the parts of each are, wherever they are played."""
    return [(name, one.model_copy(update={"simulator": ""})) for name, one in config.games.items()]


def check_playable(trained: Config, played: Config, run: str) -> None:
    """Raise ConfigError if a run would play with other keys than those that may differ from its training."""
    for key in type(played).model_fields:
        if key not in PLAYABLE_KEYS and getattr(played, key) != getattr(trained, key):
            raise ConfigError(
                f"{key} belongs to the training of {run} and cannot change now; what can is written "
                f"{', '.join(FORMS[key] for key in (*OF_THE_GAME, 'hand'))}"
            )
    fixed = [key for key in GameConfig.model_fields if key not in PLAYABLE_KEYS_OF_A_GAME]
    for name, one in played.games.items():
        was = trained.games.get(name)
        wrong = [name] if was is None else [f"{name}.{key}" for key in fixed if getattr(one, key) != getattr(was, key)]
        if wrong:
            raise ConfigError(
                f"games.{wrong[0]} belongs to the training of {run} and cannot change now; what can is written "
                f"{', '.join(f'games.{name}.{FORMS[key]}' for key in OF_THE_GAME)}"
            )
