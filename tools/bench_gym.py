"""What the bridge costs: `joybridge serve --gym` beside the vector environments of Gymnasium, at equal numbers.

python -m tools.bench_gym [ID ...] [--number N] [--workers N] [--rounds N]

All play the same environments with random actions that are drawn before, in turns of half a second, so that what else
the machine does hits them alike. Printed are the medians of steps of one environment per second, and of the ratios to
AsyncVectorEnv in the same round.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import gymnasium
import numpy as np

from joybridge.client.client import Session, list_games
from joybridge.contract.codec import ActArrays
from joybridge.v1 import bridge_pb2 as pb
from tests.support.servers import server

IDS = ("CartPole-v1", "Pendulum-v1", "HalfCheetah-v5")
WINDOW_SECONDS = 0.5
ACTIONS = 64  # that are drawn before, and repeated
BASELINE = "AsyncVectorEnv"

Step = Callable[[int], object]  # with the number of the actions


def bench(environment: str, number: int, workers: int, rounds: int) -> None:
    """Print the figures of one environment."""
    with ExitStack() as stack:
        players: dict[str, Step] = {
            "SyncVectorEnv": stack.enter_context(vector_environment(environment, number, "sync")),
            BASELINE: stack.enter_context(vector_environment(environment, number, "async")),
            "joybridge": stack.enter_context(bridge(environment, number, 0)),
            f"joybridge, {workers} workers": stack.enter_context(bridge(environment, number, workers)),
        }
        for step in players.values():
            window(step)
        rates = [{name: number * window(step) for name, step in players.items()} for _ in range(rounds)]
    print(f"{environment}, {number} environments, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name in players:
        ratio = np.median([each[name] / each[BASELINE] for each in rates])
        print(f"  {name:<22} {np.median([each[name] for each in rates]):>9,.0f} steps/s  {ratio:.2f}", flush=True)


def window(step: Step) -> float:
    """Return calls per second in a window."""
    begin, calls = time.perf_counter(), 0
    while (seconds := time.perf_counter() - begin) < WINDOW_SECONDS:
        step(calls % ACTIONS)
        calls += 1
    return calls / seconds


@contextmanager
def vector_environment(environment: str, number: int, mode: str) -> Iterator[Step]:
    """Yield the step of a vector environment of Gymnasium."""
    made = gymnasium.make_vec(environment, number, vectorization_mode=mode)
    made.action_space.seed(0)
    actions = [made.action_space.sample() for _ in range(ACTIONS)]
    made.reset(seed=0)
    yield lambda index: made.step(actions[index])
    made.close()


@contextmanager
def bridge(environment: str, number: int, workers: int) -> Iterator[Step]:
    """Yield the step of a session with a server."""
    with server("--address", "127.0.0.1:0", "--gym", environment, "--workers", str(workers)) as process:
        game = list_games(process.address)[-1]
        with Session(process.address, game, arenas=number, seed=0) as session:
            actions = random_acts(session.spec, number)
            yield lambda index: session.step(actions[index])


def random_acts(spec: pb.GameSpec, arenas: int) -> list[list[ActArrays]]:
    """Return ACTIONS random actions of the lanes of a game with one behavior."""
    random, device = np.random.default_rng(0), spec.behaviors[0].device
    low, high = ([getattr(axis, end) for axis in device.axes] for end in ("low", "high"))
    axes = random.uniform(low, high, (ACTIONS, arenas, len(device.axes))).astype(np.float32)
    counts = [len(branch.choices) for branch in device.branches]
    choices = random.integers(counts, size=(ACTIONS, arenas, len(counts)), dtype=np.int32)
    return [[ActArrays(*each)] for each in zip(axes, choices, strict=True)]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environments", nargs="*", default=IDS, metavar="ID", help=f"default {' '.join(IDS)}")
    parser.add_argument("--number", type=int, default=16, help="of each environment at once; default %(default)s")
    parser.add_argument("--workers", type=int, default=2, help="of the second server; default %(default)s")
    parser.add_argument("--rounds", type=int, default=15, help="of windows; default %(default)s")
    options = parser.parse_args()
    for environment in options.environments:
        bench(environment, options.number, options.workers, options.rounds)


if __name__ == "__main__":
    main()
