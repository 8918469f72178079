"""`joybridge watch`: watch a running training, or a game of a running simulator, in the browser."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from joybridge.client.client import describe
from joybridge.client.command_line import add_trust_option
from joybridge.client.own_games import choose_at
from joybridge.client.run_command import protected, run_command, search_here
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_settings, read_settings
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.address import address, is_address
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.contract.credentials import (
    add_credentials_arguments,
    check_credentials,
)
from joybridge.viewer.page_options import add_page_options

ANSWER_SECONDS = 10.0  # for an answer of the simulator, before it is taken for lost


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(_watch, _parse(arguments, prog))


def _watch(options: argparse.Namespace) -> None:
    from joybridge.viewer.web import show  # not before: help needs no further package

    search_here()
    with (_game if is_address(options.what) else _run)(options) as (what, url):
        print(f"watch {what} at {url}\nCtrl-C ends it", flush=True)
        show(url, browser=not options.no_browser)


@contextmanager
def _run(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Show a run; yield what is watched, and the URL of the page. Raises JoybridgeError."""
    from joybridge.client.simulator_source import last_simulators
    from joybridge.run.folder import run_config
    from joybridge.run.own_code import check_code, trust
    from joybridge.viewer.run_view import watch
    from joybridge.viewer.simulator import Simulator
    from joybridge.viewer.web import open_website

    run = Path(options.what)
    if options.trust_run:
        trust(run)
    config = run_config(run)
    if options.only_game:
        config.of_game(options.only_game)
    check_code(run, config)
    place, games = None, tuple[str, ...]()
    if options.simulator:
        place = protected(options.simulator, options)
    else:
        games = last_simulators(run).believed(options.trust_run).games
    with (
        Simulator(place, games) as simulator,
        open_website(
            options.port,
            lambda page: watch(page, run, simulator.reach, options.seed, options.only_game),
            "watch.html",
        ) as url,
    ):
        yield f"{run} ({config.game}, {config.layout})", url


@contextmanager
def _game(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Show a game of a running simulator; yield the same as `_run`. Raises JoybridgeError."""
    from joybridge.viewer.arena import Settings
    from joybridge.viewer.simulator import Simulator
    from joybridge.viewer.watched_game import watch_game
    from joybridge.viewer.web import open_website

    try:
        place = protected(address(options.what), options)
    except argparse.ArgumentTypeError as error:
        raise ConfigError(str(error)) from None
    chosen = read_settings(options.overrides)
    settings = Settings(options.seed, chosen.options, chosen.parameters)
    with Simulator(place, ()) as simulator:
        game = choose_at(simulator.reach(), options.game)
        check_settings(settings.options, settings.parameters, describe(place, game, settings.options))
        with open_website(
            options.port, lambda page: watch_game(page, simulator.reach, game, settings, ANSWER_SECONDS), "watch.html"
        ) as url:
            yield game, url


def _parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    parser, watch = command_parser(
        prog,
        "watch",
        "Watch a running training: its learning curves, and its newest policies at play. It only reads "
        "the folder of the run. Or watch random play of a game of a running simulator.",
    )
    watch.add_argument(
        "what", metavar="RUN|ADDRESS", help="folder of a run, or HOST:PORT or unix:PATH of a running simulator"
    )
    watch.add_argument("--game", metavar="NAME", help="of the simulator at ADDRESS; may be left out if it has only one")
    watch.add_argument(
        "--simulator",
        type=address,
        metavar="ADDRESS",
        help="where the policies of RUN play: HOST:PORT or unix:PATH of a running simulator; default: this command "
        "starts one",
    )
    add_credentials_arguments(watch)
    add_trust_option(watch)
    watch.add_argument(
        "--only-game", default="", metavar="NAME", help="which of the several games of RUN is shown; default: the first"
    )
    watch.add_argument(
        "--seed", type=at_least(0, SEEDS), default=1, help="of the arena and of the samples; default %(default)s"
    )
    add_page_options(watch)
    add_overrides(watch, "options and parameters of the game at ADDRESS, e.g. options.level=6")
    options = parse_overrides(parser, arguments)
    at = is_address(options.what)
    check_credentials(watch, options, options.simulator or at)
    if at and options.simulator:
        watch.error("--simulator belongs to a run; the address of a game's simulator stands alone")
    if not at and (options.game or options.overrides):
        watch.error("--game, options and parameters belong to the address of a simulator; a run has its own")
    return options
