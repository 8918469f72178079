"""The command `joybridge`: every command of every part that is installed.

A command is a line in CORE, or an entry point of an optional part. Its module is imported only when the command is
given, so a machine that runs games needs nothing that learns, and the other way round.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, NoReturn

from joybridge.plugins import find
from joybridge.process import leave

INTERRUPTED = 128 + signal.SIGINT  # exit status, as of a shell


class Command(NamedTuple):
    """Where a command lives and what it does."""

    module: str  # its `main` takes the arguments, the command first, and returns the exit status
    extra: str  # the optional part of the package that it needs; "": none
    help: str


CORE = {
    "serve": Command("joybridge.simulator.__main__", "simulator", "run games for trainers, over gRPC"),
    "list": Command("joybridge.simulator.__main__", "simulator", "list the games and their options"),
    "look": Command("joybridge.commands.look", "simulator", "draw random play of a game, beside what was pressed"),
    "minari": Command("joybridge.minari.writing", "minari", "write demonstrations as datasets of Minari"),
    "new": Command(
        "joybridge.simulator.__main__", "simulator", "begin with your pygame program, environment or own game"
    ),
    "check": Command("joybridge.conformance.__main__", "", "test a server, in any language, against the contract"),
    "doctor": Command(
        "joybridge.conformance.doctor", "", "look at a running server for a few seconds, and say what is wrong"
    ),
    "tape": Command(
        "joybridge.adapters.tape_command", "simulator", "regression tests of a pygame program: input tapes"
    ),
    "train": Command("joybridge.commands.train", "train", "train a configuration"),
    "clone": Command("joybridge.commands.clone", "train", "learn from demonstrations alone, without playing the game"),
    "replay": Command("joybridge.commands.replay", "train", "repeat a recorded session: a demonstration, or a fault"),
    "compare": Command(
        "joybridge.compare.command", "compare", "train variants with several seeds, and write a page about them"
    ),
    "rate": Command("joybridge.compare.rate", "compare", "let policies of runs play each other, and rate them"),
    "keys": Command("joybridge.config.keys", "train", "list the keys of configurations: default, meaning and range"),
    "evaluate": Command("joybridge.commands.evaluate", "train", "measure how well the policy of a run plays"),
    "record": Command("joybridge.commands.record", "train", "record a video of the policy of a run"),
    "drive": Command(
        "joybridge.commands.drive", "train", "let the policy of a run play a pygame program in its window"
    ),
    "runs": Command("joybridge.commands.runs", "train", "list the runs in a folder"),
    "export": Command("joybridge.commands.export", "export", "write the policy of a run as a file for your product"),
}


def commands() -> dict[str, Command]:
    """Return all commands by name, those of optional parts last."""
    return CORE | {point.name: point.load() for point in sorted(find("joybridge.commands"))}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status: 2 where it is unknown or cannot be imported."""
    name, *rest = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if name in ("-h", "--help"):
        print(usage())
        return 0
    if name == "--version":
        print(f"joybridge {version('joybridge')}")
        return 0
    command = CORE.get(name) or commands().get(name)
    if command is None:
        print(f"error: unknown command {name!r}; expected one of {', '.join(commands())}", file=sys.stderr)
        return 2
    try:
        with _quiet_interrupts():
            module = import_module(command.module)
        return int(module.main([name, *rest], prog="joybridge"))
    except KeyboardInterrupt:  # a command that has something to end handles its interrupts
        return INTERRUPTED
    except ModuleNotFoundError as error:  # some modules are imported only when the command runs
        if (error.name or "").startswith("joybridge") or not command.extra:
            raise
        print(
            f"error: `joybridge {name}` needs the module {error.name}; install it with "
            f"`pip install 'joybridge[{command.extra}]'`",
            file=sys.stderr,
        )
        return 2


@contextmanager
def _quiet_interrupts() -> Iterator[None]:
    """End the process at an interrupt, without a traceback: imports of large libraries cannot be interrupted."""
    usual = signal.getsignal(signal.SIGINT)
    if usual is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


def open_streams() -> None:
    """Replace standard streams that are closed, so that nothing fails that writes to them."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115 - it stays open


def run() -> NoReturn:
    """Run the command line as a process of its own and exit."""
    open_streams()
    if sys.argv[1:2] not in (["serve"], ["train"]) and hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # ends quietly once the reader of its output has, as in `| head`
    leave(main())


def usage() -> str:
    """Return the list of commands."""
    lines = "\n".join(f"  {name:<10}{command.help}" for name, command in commands().items())
    purpose = "Train agents that play with a pointer and buttons, over a gRPC bridge."
    return f"usage: joybridge COMMAND ...\n\n{purpose}\n\n{lines}\n\n`joybridge COMMAND --help` describes one."


if __name__ == "__main__":
    run()
