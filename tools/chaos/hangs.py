"""Games that loop or sleep for ever: health, lists and other sessions are answered meanwhile, and a signal ends all."""

import signal
import time
from collections.abc import Callable
from pathlib import Path

import grpc
from grpc_health.v1 import health_pb2, health_pb2_grpc

from joybridge.client.client import Session
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tools.chaos.outcome import Outcome, percentile
from tools.chaos.process import Simulator

GAME = "hangs"  # of tests/support/hanging_games.py
HANGING = [{"how": "loop"}, {"how": "sleep"}]  # at the same time
LONGEST = 10.0  # seconds for an answer; an idle machine needs some milliseconds
LONGEST_END = 20.0  # seconds after a signal; an idle machine needs one


def hangs(folder: Path, faults: int) -> Outcome:
    """Let games loop and sleep for ever, call the server so often meanwhile, and end it."""
    with Simulator("--game", "tests.support.hanging_games:Hangs", "--step-seconds", "1000") as simulator:
        sessions = [Session(simulator.address, GAME, arenas=1, seed=0, options=how) for how in HANGING]
        for session in sessions:
            session.send(make_acts(session.spec, 1))
        with (
            grpc.insecure_channel(simulator.address) as channel,
            Session(simulator.address, "shooting_birds", arenas=16, seed=1) as player,
        ):
            health, service = health_pb2_grpc.HealthStub(channel), rpc.SimulatorServiceStub(channel)
            acts = make_acts(player.spec, 16)
            calls: dict[str, Callable[[], object]] = {
                "health": lambda: health.Check(health_pb2.HealthCheckRequest(), timeout=30.0),
                "ListGames": lambda: service.ListGames(pb.ListGamesRequest(), timeout=30.0),
                "step": lambda: player.step(acts),
            }
            seconds = {name: [_seconds(call) for _ in range(faults)] for name, call in calls.items()}
        begin = time.monotonic()
        simulator.process.send_signal(signal.SIGTERM)
        status = simulator.process.wait()
        end = time.monotonic() - begin
        stacks = simulator.said().count("hanging_games.py")
        for session in sessions:
            session.close()
    problems = [f"{name} took {max(values):.1f} s" for name, values in seconds.items() if max(values) > LONGEST]
    if end > LONGEST_END or status != 0 or stacks != len(HANGING):
        problems.append(f"SIGTERM: {end:.1f} s, status {status}, {stacks} stacks in the log")
    shares = {name: [percentile(values, share) * 1000 for share in (0.5, 0.99)] for name, values in seconds.items()}
    figures = ", ".join(f"{name} {median:.0f} ms (p99 {late:.0f} ms)" for name, (median, late) in shares.items())
    return Outcome(faults, problems, f"{figures}; SIGTERM ended it in {end:.1f} s")


def _seconds(call: Callable[[], object]) -> float:
    begin = time.monotonic()
    call()
    return time.monotonic() - begin
