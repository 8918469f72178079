"""A stand-in for a Unity player: it says what a script says, over a real port."""

from collections.abc import Sequence
from threading import Event, Thread
from typing import Any

import grpc
import numpy as np

from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.wire import FINE, METHOD, SERVICE

HANGS, DIES = object(), object()  # in a script: it says nothing more, or its connection is lost


class StandIn(Thread):
    """Plays a script: a list of FromPlayer, of raw bytes, or of HANGS and DIES."""

    def __init__(self, port: int, script: Sequence[Any], version: str = "1.5.0") -> None:
        super().__init__(daemon=True)
        self.port, self.script, self.version = port, script, version
        self.heard: list[ml.Message] = []
        self.refused = ""  # by gRPC
        self.over = Event()
        self.start()

    def run(self) -> None:
        hello = ml.PlayerHello(name="stand-in", communication_version=self.version)
        # Stand-ins of one process do not share a connection.
        alone = [("grpc.use_local_subchannel_pool", 1), ("grpc.initial_reconnect_backoff_ms", 20)]
        with grpc.insecure_channel(f"127.0.0.1:{self.port}", alone) as channel:
            call = channel.unary_unary(f"/{SERVICE}/{METHOD}")
            for line in [ml.FromPlayer(hello=hello), ml.FromPlayer(), *self.script]:
                if line is HANGS:
                    self.over.wait(20)
                if line is HANGS or line is DIES:
                    return
                try:
                    answer = ml.Message.FromString(call(_bytes(line), wait_for_ready=True, timeout=20))
                except grpc.RpcError as error:
                    self.refused = error.details()
                    return
                self.heard.append(answer)
                if answer.header.status != FINE:
                    return

    @property
    def steps(self) -> list[ml.TrainerStep]:
        """What it was told since the handshake."""
        return [message.from_trainer.step for message in self.heard[1:]]

    def actions(self, index: int, name: str = "walker") -> list[tuple[list[float], list[int]]]:
        """Return the actions in one of the steps: continuous and discrete of each agent."""
        actions = ml.ActionList.FromString(self.steps[index].actions.get(name, b"")).actions
        return [(np.frombuffer(one.continuous, "<f4").tolist(), list(one.discrete)) for one in actions]


def _bytes(line: Any) -> bytes:
    if isinstance(line, bytes):
        return line
    return ml.Message(header=ml.Header(status=FINE), from_player=line).SerializeToString()


def vector(*values: float, name: str = "place", **fields: Any) -> ml.Observation:
    """Return a vector observation."""
    floats = ml.Floats(data=np.array(values, "<f4").tobytes())
    return ml.Observation(shape=fields.pop("shape", [len(values)]), floats=floats, name=name, **fields)


def agent(number: int, *seen: Any, **fields: Any) -> ml.Agent:
    """Return an agent that sees a vector of numbers, or some observations."""
    observations = list(seen) if isinstance(seen[0], ml.Observation) else [vector(*seen)]
    return ml.Agent(id=number, observations=observations, **fields)


def says(*agents: ml.Agent, name: str = "walker", new: ml.ActionSpec | None = None, **others: Any) -> ml.FromPlayer:
    """Return what happened to the agents of a behavior. new: the actions of one that is announced.

    others: agents of other behaviors, and `statistics`: (name, value) each.
    """
    statistics = others.pop("statistics", ())
    message = ml.FromPlayer()
    for behavior, them in {name: agents, **others}.items():
        message.step.agents[behavior] = ml.AgentList(agents=them).SerializeToString()
    message.step.side_channels = side_channels.join(side_channels.statistic(*one) for one in statistics)
    if new is not None:
        message.hello.behaviors.add(name=name, action_spec=new)
    return message


def hybrid(continuous: int = 1, *sizes: int) -> ml.ActionSpec:
    """Return the actions of a behavior."""
    return ml.ActionSpec(continuous_actions=continuous, discrete_actions=len(sizes), branch_sizes=sizes)
