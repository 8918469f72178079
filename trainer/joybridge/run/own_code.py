"""What a configuration names: code (`network`, `loss`, `layout`) and simulators of `games`.

It is imported, and connected to, for a run only if this user has trained the run here.

A run is a folder that anybody may have made. The names in its configuration are believed if this user signed them on
this machine and in this folder (see own_runs.py), or says so with --trust-run.
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from pydantic import TypeAdapter

from joybridge.client.own_runs import is_ours, sign_or_say, untrusted
from joybridge.config.config import Config
from joybridge.config.files import write_atomically
from joybridge.config.json_files import read_json
from joybridge.layouts.mixed import kinds_of
from joybridge.run.checkpoint import has_checkpoint

FILE = "code.json"  # in the folder of a run
MAX_BYTES = 2**12  # of it

_trusted: set[Path] = set()  # runs that the command line says to believe


def code_of(config: Config) -> list[str]:
    """Return the code that a configuration names, "module:name" each, sorted."""
    policies = [config.policy, *map(config.policy_config, config.policies)]
    parts = {name for policy in policies for name in (policy.network, policy.loss) if name}
    return sorted(parts | {kind for kind in kinds_of(config.layout) if ":" in kind})


def trust(run: Path) -> None:
    """Believe what the configuration of a run names, until this process ends."""
    _trusted.add(run.resolve())


def trust_all(names: Iterable[Path | str]) -> None:
    """Believe all runs that are named on a command line: by their folders, or as RUN@TIMESTEPS."""
    for name in map(str, names):
        trust(Path(name))
        trust(Path(name.rpartition("@")[0] or name))


def sign_code(run: Path, config: Config, say: Callable[[str], None]) -> None:
    """Note in the folder of a run that this user trains it with what it names. Raises StorageError."""
    if not _named(config):
        return
    if signature := sign_or_say(_signed(config), say):
        write_atomically(run / FILE, json.dumps({"signature": signature}).encode())


def check_code(run: Path, config: Config) -> None:
    """Raise UntrustedRunError unless what the configuration of a run names may be imported, and connected to."""
    if not (named := _named(config)) or run.resolve() in _trusted or is_ours(_signed(config), _signature(run)):
        return
    raise untrusted(run, named)


def check_code_beside(path: Path, config: Config, *, trusted: bool) -> None:
    """Raise UntrustedRunError if a configuration is that of a run, and `check_code` refuses it.

    trusted: the command line says to believe it.
    """
    if has_checkpoint(path.parent) and not trusted:
        check_code(path.parent, config)


def _signature(run: Path) -> str:
    return (read_json(run / FILE, TypeAdapter(dict[str, str]), MAX_BYTES, "delete it") or {}).get("signature", "")


def _signed(config: Config) -> bytes:
    """Return what is signed: what is named, and the current folder, in which modules are looked for."""
    return json.dumps([[*code_of(config), *_simulators(config)], str(Path.cwd())]).encode()


def _simulators(config: Config) -> list[str]:
    """Return the simulators that several games name, sorted."""
    return sorted({one.simulator for one in config.games.values() if one.simulator})


def _named(config: Config) -> list[str]:
    """Return what is done with the names of a configuration."""
    wishes = {"import": code_of(config), "connect to": _simulators(config)}
    return [f"{what} {', '.join(names)}" for what, names in wishes.items() if names]
