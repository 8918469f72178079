"""What the commands that play a run share: their options, what they play, and the simulator that they play at."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from joybridge.client.command_line import (
    LAST_SIMULATORS,
    add_simulator_options,
    add_trust_option,
    check_simulator_options,
    wanted_simulators,
)
from joybridge.client.simulator_source import choose_simulators, last_simulators, open_simulators
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.config.programs import as_trained
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.contract.places import PYGAME
from joybridge.progress import say
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import play_config
from joybridge.run.origin import remark
from joybridge.run.own_code import trust_all
from joybridge.run.sources import changed_sources

if TYPE_CHECKING:
    from joybridge.play.playing import PlaySpec

SEED = 1000  # of what is played, which is hardly that of a training


def playing_parser(prog: str, name: str, text: str) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return the parser of a command line, and of its command, which has the options that all such commands have."""
    parser, command = command_parser(prog, name, text)
    command.add_argument("run", type=Path, help="folder of a run")
    command.add_argument(
        "--seed",
        type=at_least(0, SEEDS),
        default=SEED,
        help="seed of environments and action sampling; default %(default)s. With the seed of its training, a run "
        "would play episodes from which it has learned",
    )
    command.add_argument(
        "--checkpoint", default="", metavar="WHICH", help="timesteps of a checkpoint, or best; default: the newest"
    )
    command.add_argument(
        "--only-game", default="", metavar="NAME", help="play only this one of the several games of the run"
    )
    command.add_argument(
        "--deterministic", action="store_true", help="take the most probable action instead of sampling"
    )
    add_simulator_options(command, LAST_SIMULATORS)
    add_trust_option(command)
    return parser, command


def add_others(command: argparse.ArgumentParser) -> None:
    """Add the option that says who plays beside the policy."""
    command.add_argument(
        "--others",
        action="append",
        default=[],
        metavar="WHO",
        help="who holds all seats but one of each arena, in a game of several agents: the folder of a run, "
        "RUN@TIMESTEPS, script:NAME, a script of the game's author, or an exported policy.json; given several times, "
        "they take seats in turn",
    )


def parse_playing(
    parser: argparse.ArgumentParser, command: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """Return the options, after everything else has been added to the command."""
    add_overrides(command, "options and parameters of the game that differ from the training, e.g. parameters.size=0.5")
    options = parse_overrides(parser, arguments)
    check_simulator_options(parser, options)
    if options.trust_run:
        trust_all([options.run, *getattr(options, "others", [])])
    if len(options.simulator) > 1:
        parser.error(f"{options.command} uses one simulator, got {len(options.simulator)}")
    return options


def games_played(options: argparse.Namespace) -> list[str]:
    """Return which of several games a command plays; "": the run has one. Raises ConfigError."""
    config = play_config(options.run, options.overrides)
    if options.only_game:
        config.of_game(options.only_game)
    return [options.only_game] if options.only_game else [*config.games] or [""]


def play_spec(options: argparse.Namespace, address: str, game: str) -> "PlaySpec":
    """Return what the command line lets play at the simulator at an address."""
    from joybridge.play.playing import PlaySpec

    return PlaySpec(
        options.run,
        address,
        options.seed,
        options.deterministic,
        options.overrides,
        options.checkpoint,
        getattr(options, "random", False),
        getattr(options, "others", ()),
        game,
    )


@contextmanager
def open_player(options: argparse.Namespace) -> Iterator[str]:
    """Yield the address of a simulator for a run, after its configuration and its checkpoint have been checked."""
    config = play_config(options.run, options.overrides)
    if text := remark(load_checkpoint(options.run, options.checkpoint)[1].origin):
        say(text)
    last = last_simulators(options.run)
    wanted = wanted_simulators(options)
    if any(game.startswith(PYGAME) for game in wanted.games):
        trained = last.believed(options.trust_run).games
        games = [as_trained(game, trained) if game.startswith(PYGAME) else game for game in wanted.games]
        wanted = replace(wanted, games=tuple(games))
    simulators = choose_simulators(wanted, last, config, say, trust=options.trust_run)
    if changed := changed_sources(options.run, simulators.games, config):
        say(
            f"the files of {', '.join(changed)} have changed since {options.run} was trained: numbers may differ, "
            "and if it observes or controls something else now, the policy does not fit"
        )
    with open_simulators(simulators, options.wait, say) as connect:
        yield connect()[0]
