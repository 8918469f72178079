"""The simulator's commands: serve, list, new."""

import argparse
import asyncio
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from threading import Timer

from joybridge.cli import open_streams
from joybridge.contract.address import DEFAULT_ADDRESS, address
from joybridge.contract.argument_types import at_least
from joybridge.contract.credentials import ProtectedAddress, add_credentials_arguments, load_credentials
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import SILENCE_SECONDS, say
from joybridge.simulator.authentication import load_server_credentials
from joybridge.simulator.catalog import CatalogError, load_game, load_games, specs
from joybridge.simulator.listing import WIDTH, listing
from joybridge.simulator.log import open_log
from joybridge.simulator.new_game.program import write_program
from joybridge.simulator.new_game.starter import write_config
from joybridge.simulator.new_game.write import NewGameError, write_game
from joybridge.simulator.program_options import add_program_options, give_arguments, split_arguments
from joybridge.simulator.running_server import ServerError, describe_all, describe_one
from joybridge.simulator.server import serve
from joybridge.simulator.service import Limits
from joybridge.v1 import bridge_pb2 as pb

MAX_WORKERS = 128  # of a session
DEFAULT_HOST, _, DEFAULT_PORT = DEFAULT_ADDRESS.partition(":")
WORKER_SHARE = 0.9  # of the time for a step: what a worker does is then said before the session ends


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.simulator") -> int:
    """Run a command and return its exit status: 2 for an error that the user can fix."""
    open_streams()
    parser = _parser(prog)
    words, own = split_arguments(sys.argv[1:] if arguments is None else arguments)
    options, unknown = parser.parse_known_args(words)
    if unknown:
        settings = any("=" in word for word in unknown)
        hint = '; quote a game together with its settings, as in --pygame "PROGRAM KEY=VALUE"' if settings else ""
        parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
    if options.command == "serve":
        options.address = _place(parser, options)
    give_arguments(parser, options, own)
    open_log()
    try:
        if options.command == "new":
            print(_new(options))
            return 0
        if options.game:  # the script `joybridge`, unlike `python -m`, does not search the current folder
            sys.path.insert(0, str(Path.cwd()))
        if options.command == "list":
            print(_list(options))
        else:
            _serve(options)
    except (JoybridgeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # before anything is served, as while a player is waited for
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def _new(options: argparse.Namespace) -> str:
    """Write what `joybridge new` is asked for, and return the commands to type next. Raises JoybridgeError."""
    if options.server:
        server = ProtectedAddress(options.server, load_credentials(options.tls_ca, options.token_file))
        return write_config(describe_one(server, options.game), ("--simulator", server), options.folder)
    if options.game or options.tls_ca or options.token_file:
        raise NewGameError(
            "--game, --tls-ca and --token-file are for --for ADDRESS; a new game needs its name only: "
            "joybridge new NAME"
        )
    if options.name is not None:
        return write_game(options.name, options.folder)
    sys.path.insert(0, str(Path.cwd()))
    if options.pygame is not None:
        return write_program(options.pygame, options.folder)
    kind, environment = ("gym", options.gym) if options.gym is not None else ("pettingzoo", options.pettingzoo)
    spec = next(specs(load_game(f"{kind}:{environment}")))
    return write_config(spec, (f"--{kind}", environment), options.folder)


def _place(parser: argparse.ArgumentParser, options: argparse.Namespace) -> str:
    """Return the address that is served, from --address or from --host and --port. Ends the program if it is wrong."""
    if options.address and (options.host or options.port):
        parser.error("--address already has a host and a port; leave out --host and --port")
    if not options.host and not options.port:
        return options.address or DEFAULT_ADDRESS
    try:
        return address(f"{options.host or DEFAULT_HOST}:{options.port or DEFAULT_PORT}")
    except argparse.ArgumentTypeError as error:
        parser.error(f"--host and --port: {error}")


def _list(options: argparse.Namespace) -> str:
    """Return what `joybridge list` prints. Raises JoybridgeError, also for a name that no game has."""
    offered = _specs(options)
    names = [spec.name for spec in offered]
    if unknown := [name for name in options.names if name not in names]:
        hint = "; `joybridge look` and `joybridge train` take configurations" if set(unknown[0]) & set("/.") else ""
        raise CatalogError(f"no game is called {unknown[0]!r}{hint}; games: {', '.join(names)}")
    given = offered[: len(options.game)]  # those that options add stand first
    shown = [spec for spec in offered if spec.name in options.names] or given or offered
    if options.names or len(shown) == len(offered):
        return listing(shown)
    beside = f"served beside it: {', '.join(names[len(shown) :])}; `joybridge list` alone describes them"
    return f"{listing(shown)}\n\n{fill(beside, WIDTH)}"


def _specs(options: argparse.Namespace) -> list[pb.GameSpec]:
    """Return the default specs of the games that `joybridge list` lists. Raises JoybridgeError."""
    if options.simulator is None:
        return [next(specs(game)) for game in load_games(options.game).values()]
    if options.game:
        raise ServerError(
            "--game, --gym, --pettingzoo, --pygame and --unity are not for a running simulator, which has its own games"
        )
    credentials = load_credentials(options.tls_ca, options.token_file)
    return describe_all(ProtectedAddress(options.simulator, credentials))


def _serve(options: argparse.Namespace) -> None:
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")  # its own log repeats in C++ what the errors here say
    protection = load_server_credentials(options.address, options.tls_cert, options.tls_key, options.token_file)
    idle_seconds = options.idle_seconds
    if idle_seconds is None:
        idle_seconds = math.inf if options.with_parent else Limits().idle_seconds
    limits = Limits(options.sessions, options.step_seconds, options.start_seconds, idle_seconds)
    waiting = Timer(SILENCE_SECONDS, say, [f"starting {', '.join(options.game)}; on a busy machine this takes longer"])
    waiting.daemon = True
    if not options.with_parent:  # which says so itself
        waiting.start()
    games = load_games(options.game, options.workers, WORKER_SHARE * options.step_seconds)
    waiting.cancel()
    asyncio.run(serve(games, options.address, limits, protection, options.with_parent))


def _parser(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=prog, description="Run games for trainers.")
    commands = parser.add_subparsers(dest="command", required=True)
    games = argparse.ArgumentParser(add_help=False)
    games.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="add this game to the built-in and installed ones (repeatable); the current folder is searched first",
    )
    for option, metavar, text in (
        ("gym", "ID", "add an environment of Gymnasium: its ID, or module:ID"),
        (
            "pettingzoo",
            "MODULE",
            "add an environment of PettingZoo: a module with parallel_env or env, or MODULE:NAME",
        ),
        ("pygame", "PROGRAM", "add a program written with pygame: FILE, MODULE or PACKAGE:SCRIPT"),
        ("unity", "BUILD", "add a player of Unity ML-Agents: its executable file"),
        ("unity-port", "PORT", "add a player of Unity ML-Agents that is started by hand and connects to this port"),
    ):
        games.add_argument(
            f"--{option}",
            action="append",
            dest="game",
            type=f"{option}:{{}}".format,
            metavar=metavar,
            help=f"{text} (repeatable); arguments may follow, quoted, as in '{metavar} key=value'",
        )
    add_program_options(games)
    _add_serve(commands, games)
    _add_list(commands, games)
    _add_new(commands)
    return parser


def _add_serve(commands: "argparse._SubParsersAction[argparse.ArgumentParser]", games: argparse.ArgumentParser) -> None:
    server = commands.add_parser("serve", parents=[games], description="Serve games over gRPC until interrupted.")
    server.add_argument(
        "--address",
        type=address,
        help=f"HOST:PORT (port 0: any free port) or unix:PATH; default {DEFAULT_ADDRESS}. An address that other "
        "machines can reach needs --tls-cert, --tls-key and --token-file",
    )
    server.add_argument("--host", help=f"the host alone, instead of --address; default {DEFAULT_HOST}")
    server.add_argument("--port", help=f"the port alone, instead of --address, 0: any free one; default {DEFAULT_PORT}")
    server.add_argument(
        "--with-parent", action="store_true", help="exit when standard input closes, i.e. with the parent process"
    )
    server.add_argument(
        "--workers",
        type=at_least(0, MAX_WORKERS),
        default=0,
        metavar="N",
        help="step the arenas of each session in N processes, for games that are given here and have one arena each, "
        "such as environments; worth it where a step takes a millisecond or more. Default: 0, in the server's process",
    )
    _add_protection(server.add_argument_group("protection"))
    _add_limits(server.add_argument_group("limits", "a number of seconds may be 0: no limit"))


def _add_list(commands: "argparse._SubParsersAction[argparse.ArgumentParser]", games: argparse.ArgumentParser) -> None:
    lists = commands.add_parser(
        "list", parents=[games], description="List the games: options, parameters, sensors, actions, rewards, metrics."
    )
    lists.add_argument("names", nargs="*", metavar="NAME", help="of a game; default: those that are added here, or all")
    lists.add_argument(
        "--simulator",
        type=address,
        metavar="ADDRESS",
        help="list the games of the simulator that runs at this address, in whatever language it is written",
    )
    add_credentials_arguments(lists)


def _add_new(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    author = commands.add_parser(
        "new",
        description="Write a small game, or what a program, an environment or a running server needs, to start from.",
    )
    begin = author.add_mutually_exclusive_group(required=True)
    begin.add_argument("name", nargs="?", help="write NAME.py, a small complete game, and NAME.yaml, its training")
    begin.add_argument(
        "--pygame",
        metavar="PROGRAM",
        help="write a hook and the training of a program that is written with pygame; settings and "
        "arguments may follow, quoted, as in 'my_game.py keys=LEFT,RIGHT -- --level 3'",
    )
    begin.add_argument(
        "--gym", metavar="ID", help="write the training of an environment of Gymnasium: its ID, or module:ID"
    )
    begin.add_argument("--pettingzoo", metavar="MODULE", help="write the training of an environment of PettingZoo")
    begin.add_argument(
        "--for",
        type=address,
        metavar="ADDRESS",
        dest="server",
        help="write the training of a game of the server at this address, with values that suit its spec",
    )
    author.add_argument(
        "--game", metavar="NAME", help="with --for: the game; may be left out if the server has only one"
    )
    add_credentials_arguments(author)
    author.add_argument("--folder", type=Path, default=Path(), metavar="DIR", help="where to write; default: here")


def _add_protection(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--tls-cert", type=Path, metavar="FILE", help="encrypt with this certificate (PEM, with chain)")
    group.add_argument("--tls-key", type=Path, metavar="FILE", help="the private key of the certificate (PEM)")
    group.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="accept only clients that know the token in this file; "
        "`(umask 077; openssl rand -hex 32 > FILE)` makes one",
    )


def _add_limits(group: argparse._ArgumentGroup) -> None:
    default = Limits()
    group.add_argument(
        "--sessions", type=at_least(1), default=default.sessions, help="most sessions at once; default %(default)s"
    )
    for name, seconds, text in (
        (
            "--step-seconds",
            default.step_seconds,
            "end a session whose game takes longer for a step; default %(default)s",
        ),
        (
            "--start-seconds",
            default.start_seconds,
            "end a stream without a Start after this, and a session whose client has asked for a Unix socket and does "
            "not connect to it; default %(default)s",
        ),
        (
            "--idle-seconds",
            None,
            f"end a session whose client is silent for longer; default {default.idle_seconds:g}, with --with-parent 0",
        ),
    ):
        group.add_argument(name, type=_seconds, default=seconds, metavar="N", help=text)


def _seconds(text: str) -> float:
    """Return a number of seconds, infinite for 0. Raises ArgumentTypeError."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds >= 0.0:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number of seconds, at least 0")
    return seconds or math.inf


if __name__ == "__main__":
    sys.exit(main())
