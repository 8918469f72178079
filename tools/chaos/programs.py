"""Programs written with pygame that do what no game does: a sentence each, and nothing of them stays or gets out."""

import gc
import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.contract.codec import ActArrays
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.spec import choose_options
from joybridge.contract.text import printable
from joybridge.simulator.catalog import load_game
from tools.chaos.outcome import Outcome
from tools.chaos.process import open_files, wait_until

MARK = "JOYBRIDGE_CHAOS"  # in the environment of every process of a program
LONGEST = 30.0  # seconds until a program has been refused or played, on a busy machine
PATIENCE = 1  # seconds that it may take for a frame
ENDING = 10.0  # seconds until all processes of a program have gone
DECISIONS = 12
FRAMES = 20  # that it plays before it does what it does
PROGRAM = """
import os, sys, pygame
pygame.init()
screen = pygame.display.set_mode((64, 48))
{first}
frame = 0
while True:
    for event in pygame.event.get():
        pass
    pygame.key.get_pressed()
    frame += 1
    if frame == {frames}:
        {later}
    screen.fill((frame % 256, 0, 0))
    pygame.display.flip()
    pygame.time.Clock().tick(60)
"""
FOREVER = "exec('while True:\\n try:\\n  while True: pass\\n except BaseException: pass')"
# What a program does, at its start and after some frames.
DEEDS = {
    "forks": "os.fork()",
    "forks in C": "import ctypes; ctypes.CDLL(None).fork()",
    "starts a program": "import subprocess; subprocess.Popen(['sleep', '1000'])",
    "becomes another program": "os.execv('/bin/sleep', ['sleep', '1000'])",
    "becomes another program in C": "import ctypes; ctypes.CDLL(None).execlp(b'sleep', b'sleep', b'1000', None)",
    "connects": "import socket; socket.create_connection(('127.0.0.1', 9))",
    "listens": "import socket; socket.create_server(('127.0.0.1', 0))",
    "writes elsewhere": "open('{folder}/outside', 'w').write('x')",
    "writes elsewhere by a link": "os.symlink('{folder}', 'way'); open('way/outside', 'w').write('x')",
    "deletes elsewhere": "os.remove('{folder}/inside')",
    "fills memory": "held = [bytearray(1 << 26) for _ in range(1 << 10)]",
    "fills memory with surfaces": "held = [pygame.Surface((4096, 4096)) for _ in range(1 << 10)]",
    "opens very many files": "held = [open(os.devnull) for _ in range(1 << 16)]",
    "starts very many threads": "import threading as t; [t.Thread(target=t.Event().wait).start() for _ in range(500)]",
    "never draws": "exec('while True: pygame.event.get()')",
    "hangs and catches everything": FOREVER,
    "hangs in C": "import ctypes; ctypes.CDLL(None).pause()",
    "exits": "sys.exit(3)",
    "exits at once": "os._exit(3)",
    "kills its parent": "os.kill(os.getppid(), 9)",
    "crashes": "import ctypes; ctypes.string_at(0)",
    "aborts": "os.abort()",
    "closes all descriptors": "os.closerange(0, 1000)",
    "writes into all descriptors": "[os.write(n, b'x' * 999) for n in range(3, 9) if os.path.exists(f'/dev/fd/{n}')]",
    "stops itself": "import signal; signal.raise_signal(signal.SIGSTOP)",
    "ignores all signals": "import signal; [signal.signal(n, signal.SIG_IGN) for n in (1, 2, 3, 13, 15)]; " + FOREVER,
    "quits pygame": "pygame.quit()",
    "shows another size": "screen = pygame.display.set_mode((640, 480))",
    "shows a picture of 4 GB": "screen = pygame.display.set_mode((32000, 32000))",
    "recurses": "(lambda f: f(f))(lambda f: f(f))",
    "raises what cannot be shown": "exec('class E(Exception):\\n def __str__(self): raise E\\nraise E')",
    "raises escapes": r"raise ValueError('\x1b]0;owned\x07' * 9999)",
    "prints without end": "[print('x' * 9999) for _ in range(999)]",
}


def play(path: Path) -> str:
    """Serve a program and play it; return the sentence with which that ends, empty if it plays on."""
    game: Any = None
    try:
        game = load_game(f"pygame:{path} seconds={PATIENCE} start=5 memory=512 keys=LEFT")
        options = choose_options(game.options, {}, game.name)
        act = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
        with closing(game(options, {}, 1, 0, 0)) as playing:
            for _ in range(DECISIONS):
                playing.step(act)
    except JoybridgeError as error:
        return str(error)
    finally:
        if game is not None and issubclass(game, PygameGame):
            game.processes.end()
    return ""


@contextmanager
def unheard() -> Iterator[None]:
    """Let nobody hear what processes write to standard error in the block: stacks of crashes, and tracebacks."""
    heard, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(heard, 2)
        os.close(heard)
        os.close(nowhere)


def marked(mark: str) -> list[int]:
    """Return the processes with this mark in their environment, but not this one."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal() and int(folder.name) != os.getpid():
            try:
                if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
            except OSError:  # it has ended, or is of somebody else
                continue
    return found


def programs(folder: Path, faults: int) -> Outcome:
    """Play pygame programs that fork, hang, exit, fill memory, close descriptors and more; at most so many."""
    problems, own = [], os.getpid()
    longest = 0.0
    moments = [(f"{name} {when}", when, deed) for name, deed in DEEDS.items() for when in ("at once", "later")]
    chosen = moments[:: max(1, len(moments) // faults)][:faults]
    outside = folder / "elsewhere"
    outside.mkdir()
    (outside / "inside").write_text("of the user")
    (folder / "program").mkdir()
    path = folder / "program" / "program.py"
    for number, (name, when, deed) in enumerate(chosen):
        mark = os.environ[MARK] = f"{own}-{number}"
        deed = deed.replace("{folder}", str(outside))
        deeds = {"first": "", "later": "pass"} | (
            {"first": deed} if when == "at once" else {"later": deed.replace("\n", "; ")}
        )
        path.write_text(PROGRAM.format(frames=FRAMES, **deeds))
        files, begin = open_files(own), time.monotonic()
        try:
            with unheard():
                said = play(path)
        except Exception as error:
            problems.append(f"{name}: {error!r:.300}")
            continue
        seconds = time.monotonic() - begin
        longest = max(longest, seconds)
        gc.collect()
        if said != printable(said) or len(said) > 1000 or seconds > LONGEST:
            problems.append(f"{name}: {seconds:.1f} s, {said[:300]!r}")
        if not wait_until(lambda mark=mark: not marked(mark), ENDING):  # type: ignore[misc]
            problems.append(f"{name}: processes {marked(mark)} are left")
        if [each.name for each in outside.iterdir()] != ["inside"] or [*path.parent.iterdir()] != [path]:
            problems.append(f"{name}: it has written or deleted files of others")
        if open_files(own) > files:
            problems.append(f"{name}: {open_files(own) - files} more files are open")
    del os.environ[MARK]
    figures = (
        f"each was refused, ended or played on in {longest:.1f} s at most, and left no process, file or descriptor"
    )
    return Outcome(len(chosen), problems, figures)
