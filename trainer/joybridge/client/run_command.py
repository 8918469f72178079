"""How a command ends, and what those share that use one simulator. Needs neither torch nor pydantic."""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from joybridge.client.signals import interrupt_on_signals
from joybridge.contract.address import address
from joybridge.contract.credentials import ProtectedAddress, add_credentials_arguments, load_credentials
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import say


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


def search_here() -> None:
    """Let modules of the current folder be imported: the script `joybridge`, unlike `python -m`, does not search it."""
    sys.path.insert(0, str(Path.cwd()))


def add_one_simulator(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command that uses one simulator, which is running or which it starts."""
    parser.add_argument(
        "--simulator",
        type=address,
        metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator; default: this command starts one",
    )
    add_credentials_arguments(parser)
    parser.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="another game for the simulator that this command starts; the current folder is searched first",
    )


def protected(place: str, options: argparse.Namespace) -> ProtectedAddress:
    """Return the address of a simulator with the credentials that the options name. Raises CredentialsError."""
    return ProtectedAddress(place, load_credentials(options.tls_ca, options.token_file))
