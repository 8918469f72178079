"""How fast a player of Unity ML-Agents is stepped through `joybridge serve --unity-port`.

python -m tools.bench_unity [--agents N] [--seconds SECONDS]

The player is a process of its own that says the same again at once: agents that see 132 numbers and have two continuous
actions, written as players of Unity do. Printed are the steps per second of
all windows and of the least disturbed one, and the processor time of a step in client, server and player.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import grpc
import numpy as np

from joybridge.client.client import Session, Transport
from joybridge.client.launch import simulator_process
from joybridge.layouts import make_acts
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import ANY_LENGTH, FINE, METHOD, SERVICE
from tests.support.unity_player import free_port

VALUES = 132
WINDOW_SECONDS = 0.25
WARM_UP = 50  # steps


def bench(agents: int, seconds: float, transport: Transport) -> None:
    """Print the figures of one transport."""
    port = free_port()
    player = subprocess.Popen(
        [sys.executable, "-m", "tools.bench_unity", "--player", str(port), "--agents", str(agents)]
    )
    with simulator_process([f"unity-port:{port} areas={agents}"]) as server:
        pid = next(pid for pid in _children() if pid != player.pid)
        with Session(server, "unity", arenas=agents, seed=0, transport=transport) as session:
            acts = make_acts(session.spec, agents)
            for _ in range(WARM_UP):
                session.step(acts)
            before = [time.process_time(), _processor_seconds(pid), _processor_seconds(player.pid)]
            windows = []
            begin = time.perf_counter()
            while time.perf_counter() - begin < seconds:
                start, steps = time.perf_counter(), 0
                while time.perf_counter() - start < WINDOW_SECONDS:
                    session.step(acts)
                    steps += 1
                windows.append(steps / (time.perf_counter() - start))
            after = [time.process_time(), _processor_seconds(pid), _processor_seconds(player.pid)]
    played = sum(windows) * WINDOW_SECONDS
    spent = [f"{1e6 * (b - a) / played:.0f}" for a, b in zip(before, after, strict=True)]
    median, best = np.median(windows), max(windows)
    print(
        f"{transport}, {agents} agents: {median:.0f} steps/s, best {best:.0f} ({agents * median:.0f} and "
        f"{agents * best:.0f} agent-steps/s); processor time of a step in client, server, player: {', '.join(spent)} "
        f"µs; load {os.getloadavg()[0]:.1f}"
    )
    player.wait(10)


def play(port: int, agents: int) -> None:
    """Be the player until the end."""
    with grpc.insecure_channel(f"127.0.0.1:{port}", ANY_LENGTH) as channel:
        call = channel.unary_unary(f"/{SERVICE}/{METHOD}")
        _say(call, ml.FromPlayer(hello=ml.PlayerHello(name="bench", communication_version="1.5.0")))
        _say(call, ml.FromPlayer())
        content = ml.FromPlayer()
        content.hello.behaviors.add(name="walker", action_spec=ml.ActionSpec(continuous_actions=2))
        seen = np.random.default_rng(0).random((agents, VALUES)).astype("<f4")
        content.step.agents["walker"] = ml.AgentList(agents=map(_agent, range(agents), seen)).SerializeToString()
        message = ml.Message(header=ml.Header(status=FINE), from_player=content).SerializeToString()
        while ml.Message.FromString(call(message)).header.status == FINE:
            pass


def _agent(number: int, seen: np.ndarray) -> ml.Agent:
    values = ml.Observation(shape=[VALUES], floats=ml.Floats(data=seen.tobytes()), dimension_properties=[1])
    return ml.Agent(id=number, reward=0.5, observations=[values])


def _say(call: grpc.UnaryUnaryMultiCallable, content: ml.FromPlayer) -> None:
    call(ml.Message(header=ml.Header(status=FINE), from_player=content).SerializeToString(), wait_for_ready=True)


def _children() -> list[int]:
    """Return the processes that this one has started."""
    return [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]


def _processor_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--agents", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--player", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.player:
        play(options.player, options.agents)
        return
    bench(options.agents, options.seconds, "local")
    bench(options.agents, options.seconds, "grpc")


if __name__ == "__main__":
    main()
