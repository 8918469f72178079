"""Several games in one run, at two simulators of which one lies or dies: a sentence that names it, soon."""

import logging
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from joybridge.config.config import load_config
from joybridge.config.metrics import Row
from joybridge.contract.errors import JoybridgeError
from joybridge.run.train import train
from joybridge.run.training import Audience, Report
from joybridge.simulator.catalog import load_games
from joybridge.simulator.session import describe
from joybridge.v1 import bridge_pb2 as pb
from tools.chaos.outcome import Outcome
from tools.chaos.process import ROOT, Simulator
from tools.chaos.servers import GAME, LIES, SPECS, lying

LONGEST = 30.0  # seconds until a run has ended, on a busy machine
SMALL = ("arenas=4", "pipeline_groups=1", "total_timesteps=400", "log_interval=4", "timeout_seconds=0.5")
SMALLER = ("policy.rollout_steps=16", "policy.time_horizon=16", "policy.minibatch_size=32", "policy.hidden_sizes=[8]")


def end_of_run(folder: Path, own: str, other: str, report: Report) -> str:
    """Train on two games, one of them at another simulator; return the sentence with which that ends, or ""."""
    keys = [*SMALL, *SMALLER, f"games.{GAME}.simulator={other}"]
    config = load_config(ROOT / "configs" / "several" / "two.yaml", keys)
    try:
        train(config, folder, [own], resume=False, audience=Audience(report, lambda _: None))
    except JoybridgeError as error:
        return str(error)
    return ""


def several(folder: Path, faults: int) -> Outcome:
    """Train on two games of which one server lies, sends wrong specs or is killed; at most so many ways."""
    logging.getLogger("grpc").setLevel(logging.CRITICAL)  # the servers' own
    problems, longest = [], 0.0
    honest = describe(load_games(), GAME, {})
    ways = [*LIES, *SPECS]
    chosen = ["killed", *ways[:: max(1, len(ways) // faults)]][:faults]
    with Simulator() as simulator:
        for number, way in enumerate(chosen):
            with ExitStack() as opened:
                report: Report = partial(_nothing)
                if way == "killed":
                    mortal = opened.enter_context(Simulator())
                    other, report = mortal.address, partial(_kill, mortal)
                else:
                    spec = pb.GameSpec()
                    spec.CopyFrom(honest)
                    if way in SPECS:
                        SPECS[way](spec)
                    other = opened.enter_context(lying(LIES.get(way), spec))
                begin = time.monotonic()
                try:
                    said = end_of_run(folder / f"run-{number}", simulator.address, other, report)
                except Exception as error:
                    said = ""
                    problems.append(f"{way}: {error!r:.300}")
                seconds = time.monotonic() - begin
            longest = max(longest, seconds)
            if not said.isprintable() or not said or seconds > LONGEST:
                problems.append(f"{way}: {seconds:.1f} s, {said[:300]!r}")
            elif other not in said and way not in SPECS:
                problems.append(f"{way}: it is not said which simulator: {said[:300]!r}")
    return Outcome(len(chosen), problems, f"a sentence each, in {longest:.1f} s at most")


def _nothing(timesteps: int, live: Row, row: Row | None) -> None:
    """Do nothing."""


def _kill(simulator: Simulator, timesteps: int, live: Row, row: Row | None) -> None:
    """Kill a simulator in the second rollout."""
    if timesteps > 80:
        simulator.process.kill()
