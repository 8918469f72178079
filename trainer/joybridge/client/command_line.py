"""What commands that use several simulators share: the options for them, games of one's own, and what comes next."""

import argparse
import shlex
from collections.abc import Sequence

from joybridge.client.own_runs import untrusted
from joybridge.client.simulator_source import SimulatorSource
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError
from joybridge.config.programs import programs_of, with_names
from joybridge.contract.address import address
from joybridge.contract.argument_types import seconds
from joybridge.contract.credentials import add_credentials_arguments, check_credentials
from joybridge.contract.places import PYGAME
from joybridge.progress import say

LAST_SIMULATORS = "the simulators of the run's last training, if they answer; otherwise "
ENVIRONMENTS = {  # options for games that are no classes of ours: what each names, and what that is
    "gym": ("ID", "an environment of Gymnasium"),
    "pettingzoo": ("MODULE", "an environment of PettingZoo"),
    "pygame": ("PROGRAM", "a program written with pygame"),
    "unity": ("BUILD", "a player of Unity ML-Agents"),
    "unity-port": ("PORT", "a player of Unity ML-Agents that is started by hand"),
}


def add_simulator_options(parser: argparse.ArgumentParser, last: str = "") -> None:
    """Add the options that say which simulators are used. last: in words, what is tried first if none is named."""
    group = parser.add_argument_group("simulators and games")
    group.add_argument(
        "--simulator",
        action="append",
        type=address,
        default=[],
        metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator; a run divides its arenas among several if this option "
        f"is repeated. Default: {last}this command starts a simulator and stops it at the end",
    )
    add_credentials_arguments(group)
    group.add_argument(
        "--wait",
        type=seconds,
        default=120.0,
        metavar="SECONDS",
        help="how long to wait for a simulator that does not answer yet; default %(default)g",
    )
    group.add_argument(
        "--timeout",
        type=seconds,
        metavar="SECONDS",
        help="how long to wait for each answer of a simulator before it is taken for lost; default: timeout_seconds of "
        "the configuration",
    )
    add_game_options(group, "for the simulator that this command starts")


def add_game_options(group: argparse._ActionsContainer, use: str) -> None:
    """Add the options that name games which no simulator has by itself. use: in words, what becomes of them."""
    group.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help=f"a game of your own, {use}; the current folder is searched first; a run remembers its game",
    )
    for option, (metavar, what) in ENVIRONMENTS.items():
        group.add_argument(
            f"--{option}",
            action="append",
            dest="game",
            type=f"{option}:{{}}".format,
            metavar=metavar,
            help=f"{what}, {use}; `joybridge serve --help` says more",
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
    check_credentials(parser, options, options.simulator)


def wanted_simulators(options: argparse.Namespace) -> SimulatorSource:
    """Return the simulators that the command line names."""
    tls_ca, token_file = [str(file.resolve()) if file else "" for file in (options.tls_ca, options.token_file)]
    return SimulatorSource(tuple(options.simulator), tuple(options.game), tls_ca, token_file)


def add_own_game(options: argparse.Namespace, configs: Sequence[str]) -> None:
    """Let the class or program that configurations name as their game be one of the command's, under its name.

    configs: files, or names of installed ones; see `programs_of`. A simulator that is running has the game already.
    `options.typed` gets the overrides and the games that a repetition of the command has to name. Raises ConfigError,
    and UntrustedRunError for the configuration of a run that names a class or a program.
    """
    for config in configs:
        folder, trusted = find_config(config).parent, getattr(options, "trust_run", False)
        if not trusted and (folder / "checkpoints").is_dir() and (named := programs_of(config, [])):
            # A run that was trained here names its games by their names alone.
            raise untrusted(folder, [f"start {place}" for place in named.values()])
    found = [programs_of(config, options.overrides) for config in configs]
    if any(places != found[0] for places in found):
        raise ConfigError("the configurations are of several games; compare those of one game")
    places = list(found[0].values())
    others = [game for game in options.game if game.startswith(PYGAME) and game not in places]
    if "game" in found[0] and others:
        program, *_ = others[0].removeprefix(PYGAME).split(" ")
        raise ConfigError(
            f"{configs[0]} names its own program, {found[0]['game']}, so that of --pygame would not be played; leave "
            f"out --pygame and write game.pygame={program} to play it with the settings of the configuration"
        )
    options.typed = [*options.overrides], [game for game in options.game if game not in places]
    options.overrides += with_names(found[0])
    if not options.simulator:
        options.game = list(dict.fromkeys([*places, *options.game]))


def say_next(*words: str) -> None:
    """Name the command that usually comes next."""
    say(f"next: {' '.join(map(_quoted, ['joybridge', *words]))}")


def _quoted(word: str) -> str:
    """Return a word as a shell takes it, in double quotes if it has single ones and nothing that these would change."""
    plain = not set(word) & set('"$`!') and "\\\\" not in word and not word.endswith("\\")
    return f'"{word}"' if "'" in word and plain else shlex.quote(word)
