"""The arguments of another trainer, `--ppo`, which hold for all of its runs in the folder of a comparison."""

import argparse
import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from joybridge.compare.variants import TRAINERS, read_variants
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.json_files import read_json

FILE = "ppo.json"  # in the folder of a comparison, if there are any
MAX_BYTES = 2**16  # of it


def peer_arguments(options: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of another trainer. Raises ConfigError if its runs in the folder have had others."""
    kind = TypeAdapter(dict[str, Any])
    try:
        now = kind.validate_json(options.ppo)
    except ValueError as error:
        text = f"--ppo got {options.ppo!r}, expected a JSON object, as in '{{\"clip_range_vf\": 0.2}}'"
        raise ConfigError(text) from error
    before = read_json(options.output / FILE, kind, MAX_BYTES, "delete it")
    if before is None:
        known = options.beside and any(
            name.endswith(TRAINERS[options.beside]) for name in read_variants(options.output)
        )
        before = {} if known else now
    if options.beside and before != now:
        raise ConfigError(
            f"{options.output} holds runs with --ppo {json.dumps(before)}, not {json.dumps(now)}; repeat the command "
            "as it was, or name another folder with --output"
        )
    return now


def keep_peer_arguments(arguments: dict[str, Any], folder: Path) -> None:
    """Note the arguments of another trainer, if there are any, in the folder of a comparison. Raises StorageError."""
    if arguments:
        write_atomically(folder / FILE, json.dumps(arguments).encode())
