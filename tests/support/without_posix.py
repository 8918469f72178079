"""`python tests/support/without_posix.py serve …`: the command `joybridge` without what Windows lacks, on Linux."""

import asyncio
import os
import signal
import socket
import sys
from functools import partial
from typing import Any

REMOVED = [
    (os, "fork"),
    (os, "getuid"),
    (os, "killpg"),
    (os, "setsid"),
    (signal, "SIGHUP"),
    (signal, "SIGPIPE"),
    (signal, "SIGUSR1"),
    (socket, "AF_UNIX"),
]
PAIR = partial(socket.socketpair, socket.AF_UNIX)  # for asyncio itself; Windows makes it of two TCP sockets


def lacking(*arguments):
    raise NotImplementedError


def main():
    for module, name in REMOVED:
        delattr(module, name)
    vars(socket)["socketpair"] = PAIR
    loop: Any = asyncio.SelectorEventLoop
    loop.add_signal_handler = lacking
    usual = loop.add_reader  # gRPC uses it
    loop.add_reader = lambda self, file, *rest: (lacking if file is sys.stdin else usual)(self, file, *rest)

    import joybridge.client.signals  # noqa: F401 - imported only
    from joybridge.cli import run

    run()


if __name__ == "__main__":
    main()
