"""What commands that use simulators share: the options for them, types of arguments, errors and exit statuses."""

import argparse
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from joybridge.client.argument_types import seconds
from joybridge.client.own_games import choose_game
from joybridge.client.signals import interrupt_on_signals
from joybridge.client.simulator_source import SimulatorSource
from joybridge.config.config_files import find_config, merge, read_yaml
from joybridge.config.errors import ConfigError
from joybridge.config.overrides import read_overrides
from joybridge.contract.address import address
from joybridge.contract.credentials import add_credentials_arguments
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.places import PYGAME, program_place
from joybridge.progress import say

LAST_SIMULATORS = "the simulators of the run's last training, if they answer; otherwise "
ENVIRONMENTS = {"gym": "ID", "pettingzoo": "MODULE", "pygame": "PROGRAM", "unity": "BUILD", "unity-port": "PORT"}


def run_command(command: Callable[[argparse.Namespace], int | None], options: argparse.Namespace) -> int:
    """Run a command and return its exit status (None is 0). Errors and interrupts become a line on standard error."""
    interrupt_on_signals()
    try:
        return command(options) or 0
    except JoybridgeError as error:
        say(f"error: {error}")
        if getattr(options, "json", False):
            print(json.dumps({"error": {"code": error.code, "text": str(error)}}))
        return error.exit_status
    except OSError as error:
        say(f"error: {error.filename or 'the output'}: {error.strerror or error}")
        return 1
    except KeyboardInterrupt:
        say("interrupted")
        return 130


def add_simulator_options(parser: argparse.ArgumentParser, last: str = "") -> None:
    """Add the options that say which simulators are used. last: in words, what is tried first if none is named."""
    parser.add_argument(
        "--simulator",
        action="append",
        type=address,
        default=[],
        metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator; a run divides its arenas among several if this option "
        f"is repeated. Default: {last}this command starts a simulator and stops it at the end",
    )
    add_credentials_arguments(parser)
    parser.add_argument(
        "--wait",
        type=seconds,
        default=120.0,
        metavar="SECONDS",
        help="how long to wait for a simulator that does not answer yet; default %(default)g",
    )
    parser.add_argument(
        "--timeout",
        type=seconds,
        metavar="SECONDS",
        help="how long to wait for each answer of a simulator before it is taken for lost; default: timeout_seconds of "
        "the configuration",
    )
    parser.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="another game for the simulator that this command starts; the current folder is searched first; a run "
        "remembers its game",
    )
    for option, metavar in ENVIRONMENTS.items():
        parser.add_argument(
            f"--{option}",
            action="append",
            dest="game",
            type=f"{option}:{{}}".format,
            metavar=metavar,
            help="an environment for the simulator that this command starts, as in `joybridge serve`",
        )


def add_trust_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of commands that play a run: whether to start and call what it names."""
    parser.add_argument(
        "--trust-run",
        action="store_true",
        help="start the games and call the simulators that the run names, although you have not trained it on this "
        "machine; it can run any program as you",
    )


def check_simulator_options(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with the usage if options contradict each other; --timeout becomes an override of the configuration."""
    if options.timeout:
        options.overrides.append(f"timeout_seconds={options.timeout}")
    if options.simulator and options.game:
        parser.error(
            "--game, --gym, --pettingzoo, --pygame and --unity are for a simulator that this command starts; give them "
            "to the running one"
        )
    if (options.tls_ca or options.token_file) and not options.simulator:
        parser.error("--tls-ca and --token-file belong to a running simulator; name it with --simulator")


def wanted_simulators(options: argparse.Namespace) -> SimulatorSource:
    """Return the simulators that the command line names."""
    tls_ca, token_file = [str(file.resolve()) if file else "" for file in (options.tls_ca, options.token_file)]
    return SimulatorSource(tuple(options.simulator), tuple(options.game), tls_ca, token_file)


def add_own_game(options: argparse.Namespace, configs: Sequence[str]) -> None:
    """Let the program that configurations name as their game be one of the command's, under its name.

    configs: files, or names of installed ones. The value of `game` is "pygame:PROGRAM", or the program and its settings
    as keys: {pygame: PROGRAM, KEY: VALUE}. A simulator that is running has the program already. Raises ConfigError.
    """
    over = read_overrides(options.overrides)
    found = [_own_places(merge(read_yaml(find_config(config)), over)) for config in configs]
    if any(places != found[0] for places in found):
        raise ConfigError("the configurations are of several games; compare those of one game")
    for key, place in found[0].items():
        options.overrides.append(f"{key}={json.dumps(choose_game(place, (), None)[0], ensure_ascii=False)}")
    if not options.simulator:
        options.game = list(dict.fromkeys([*found[0].values(), *options.game]))


def _own_places(data: Mapping[str, Any]) -> dict[str, str]:
    """Return the places of programs that a configuration names, by the keys that name them. Raises ConfigError."""
    named = {"game": data.get("game")}
    if isinstance(games := data.get("games"), dict):
        named |= {f"games.{name}.game": one.get("game") for name, one in games.items() if isinstance(one, dict)}
    return {key: place for key, game in named.items() if (place := _own_place(game)) is not None}


def _own_place(game: object) -> str | None:
    if isinstance(game, dict):
        try:
            return program_place(game)
        except ValueError as error:
            raise ConfigError(f"game: got {game}; {error}") from error
    return game if isinstance(game, str) and game.startswith(PYGAME) else None


def say_next(*words: str) -> None:
    """Name the command that usually comes next."""
    say(f"next: {shlex.join(['joybridge', *words])}")
