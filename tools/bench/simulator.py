"""A simulator: the game alone, its pictures, and what a session over the wire takes."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product

import numpy as np

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.contract.spec import choose_options
from joybridge.games.pointer_game import PointerGame
from joybridge.simulator.catalog import load_games
from tools.bench.measure import GAMES, Figures, measure, random_acts, spread

IMAGES: list[dict[str, str]] = [  # options of both games
    {"observation": "fovea"},
    {"observation": "fovea", "fovea_reach": "16"},
    {"observation": "screen", "screen_size": "48"},
    {"observation": "screen", "screen_size": "64"},
    {"observation": "screen", "screen_size": "84", "color": "rgb"},
]


def bench_simulator() -> Figures:
    """Agent-steps per second of the games alone, with random actions."""
    figures = {}
    for name, game_class in load_games().items():
        if name not in GAMES:
            continue
        for arenas in (1, 4, 16, 64, 256, 1024):
            options = choose_options(game_class.options, {}, name)
            game = game_class(options, {}, arenas, 0, 0)
            acts = random_acts(game_class.describe(options), arenas, np.random.default_rng(0))
            steps = max(20, 20_000 // arenas)

            def work(game=game, acts=acts, steps=steps, arenas=arenas) -> float:  # type: ignore[no-untyped-def]
                for step in range(steps):
                    game.step(acts[step % len(acts)])
                return float(steps * arenas)

            figures[f"{name}, {arenas} arenas, agent-steps/s"] = measure(work)
    return figures


def bench_pictures() -> Figures:
    """Microseconds of an image that an agent observes, of 150 arenas that play on between, and of writing its bytes."""
    figures, arenas, steps = {}, 150, 40
    games = load_games()
    for name, choices in product(GAMES, IMAGES):
        options = choose_options(games[name].options, choices, name)
        game = games[name](options, {}, arenas, 0, 0)
        assert isinstance(game, PointerGame)
        acts = random_acts(games[name].describe(options), arenas, np.random.default_rng(0))
        (image,) = game.observations(game.arenas)
        source, target = np.zeros_like(image), np.empty_like(image)
        seen, bare = [], []
        for step in range(2 * steps):
            game.step(acts[step % len(acts)])
            begin = time.perf_counter()
            game.observations(game.arenas)
            middle = time.perf_counter()
            np.copyto(target, source)
            bare.append((time.perf_counter() - middle) / arenas * 1e6)
            seen.append((middle - begin) / arenas * 1e6)
        size = "x".join(map(str, image.shape[1:]))
        figures[f"{name}, {' '.join(choices.values())} {size}, µs (p50, p5, p95)"] = spread(seen[steps:])
        figures[f"{name}, {' '.join(choices.values())} {size}, bare write, µs"] = spread(bare[steps:])
    return figures


def bench_wire() -> Figures:
    """Agent-steps per second through a simulator process, and round trips of one arena."""
    figures: Figures = {"an echo, round trip in µs (p50, p5, p95)": echo()}
    with simulator_process() as address:
        for name in GAMES:
            for arenas in (1, 64, 128, 256):
                with Session(address, name, arenas=arenas, seed=0) as session:
                    acts = random_acts(session.spec, arenas, np.random.default_rng(0))

                    def work(session=session, acts=acts, arenas=arenas) -> float:  # type: ignore[no-untyped-def]
                        for step in range(400):
                            session.step(acts[step % len(acts)])
                        return float(400 * arenas)

                    figures[f"{name}, {arenas} arenas, agent-steps/s"] = measure(work)
            figures[f"{name}, 1 arena, round trip in µs (p50, p5, p95)"] = round_trips(name, address)
            if hasattr(os, "SCHED_IDLE"):
                with _cores_kept_awake():
                    figures[f"{name}, 1 arena, round trip in µs, cores kept from halting"] = round_trips(name, address)
            figures |= _two_sessions(name, address, address, "in turns at one simulator")
            with simulator_process() as other:
                figures |= _two_sessions(name, address, other, "at two simulators")
    return figures


def round_trips(name: str, address: str) -> dict[str, float]:
    """Return percentiles of the microseconds that a decision of a single arena takes."""
    with Session(address, name, arenas=1, seed=0) as session:
        acts = random_acts(session.spec, 1, np.random.default_rng(0))
        return _percentiles(lambda step: session.step(acts[step % len(acts)]))


def echo() -> dict[str, float]:
    """Return the same for messages as long as those of Shooting Birds, between two processes that do nothing else."""
    request, response = bytes(40), bytes(549)
    ours, other = socket.socketpair()
    answer = f"""
import socket
with socket.socket(fileno={other.fileno()}) as other:
    while other.recv(65536):
        other.sendall(bytes({len(response)}))
"""
    with ours, subprocess.Popen([sys.executable, "-c", answer], pass_fds=[other.fileno()]) as process:
        other.close()

        def exchange(step: int) -> None:
            ours.sendall(request)
            ours.recv(65536)

        figures = _percentiles(exchange)
        ours.shutdown(socket.SHUT_RDWR)
        process.wait()
    return figures


def _percentiles(exchange: Callable[[int], object]) -> dict[str, float]:
    """Return percentiles of the microseconds that an exchange takes. It is given the number of the step."""
    trips = []
    for step in range(4000):
        begin = time.perf_counter()
        exchange(step)
        trips.append(time.perf_counter() - begin)
    low, median, high = np.percentile(trips[1000:], [5, 50, 95]) * 1e6
    return {"median": median, "low": low, "high": high}


@contextmanager
def _cores_kept_awake() -> Iterator[None]:
    """Keep every core busy at the lowest priority: waking one that halts is slow, most of all in a virtual machine."""
    idle = f"""
import os
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
while os.getppid() == {os.getpid()}: pass
"""
    command = [sys.executable, "-c", idle]
    spinning = [subprocess.Popen(command, start_new_session=True) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def _two_sessions(name: str, first: str, second: str, how: str) -> Figures:
    """Measure 256 arenas in two sessions, where one is always being answered while the other is worked on."""
    with Session(first, name, arenas=128, seed=0) as one, Session(second, name, arenas=128, seed=0) as two:
        acts = random_acts(one.spec, 128, np.random.default_rng(0))
        one.send(acts[0])

        def work() -> float:
            for step in range(400):
                two.send(acts[step % len(acts)])
                one.receive()
                one.send(acts[step % len(acts)])
                two.receive()
            return 400.0 * 256

        figure = measure(work)
        one.receive()
    return {f"{name}, 2 x 128 arenas, {how}, agent-steps/s": figure}
