"""The arguments of another trainer, `--ppo`, which hold for all of its runs in the folder of a comparison."""

import argparse
import json
from typing import Any

from pydantic import TypeAdapter

from joybridge.compare.variants import read_variants
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.json_files import read_json

FILE = "ppo.json"  # in the folder of a comparison, if there are any
MAX_BYTES = 2**16  # of it


def keep_peer_arguments(options: argparse.Namespace) -> None:
    """Note the arguments of another trainer in the folder. Raises ConfigError if its runs have had others."""
    path, kind = options.output / FILE, TypeAdapter(dict[str, Any])
    try:
        now = kind.validate_json(options.ppo)
    except ValueError as error:
        text = f"--ppo got {options.ppo!r}, expected a JSON object, as in '{{\"clip_range_vf\": 0.2}}'"
        raise ConfigError(text) from error
    before = read_json(path, kind, MAX_BYTES, "delete it")
    if before is None:
        before = {} if read_variants(options.output) else now
    if options.beside and before != now:
        raise ConfigError(
            f"{options.output} holds runs with --ppo {json.dumps(before)}, not {json.dumps(now)}; repeat the command "
            "as it was, or name another folder with --output"
        )
    if now:
        write_atomically(path, json.dumps(now).encode())
