"""A build of a Unity player: its agents see the seed, their number, and how many decisions they have made."""

import argparse

import grpc
import numpy as np

from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import FINE, METHOD, SERVICE


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--mlagents-port")
    parser.add_argument("--agents", type=int)
    options = parser.parse_args()
    with grpc.insecure_channel(f"127.0.0.1:{options.mlagents_port}") as channel:
        call = channel.unary_unary(f"/{SERVICE}/{METHOD}", ml.Message.SerializeToString, ml.Message.FromString)
        hello = ml.PlayerHello(name="walk", communication_version="1.5.0")
        answer = call(_says(ml.FromPlayer(hello=hello)))
        seed = answer.from_trainer.hello.seed
        answer = call(_says(ml.FromPlayer()))
        clock = 0
        while answer.header.status == FINE:
            clock = 0 if answer.from_trainer.step.command == ml.RESET else clock + 1
            content = ml.FromPlayer()
            content.hello.behaviors.add(name="walker", action_spec=ml.ActionSpec(continuous_actions=1))
            content.step.agents["walker"] = ml.AgentList(
                agents=[_agent(number, (seed, number, clock)) for number in range(options.agents)]
            ).SerializeToString()
            answer = call(_says(content))


def _agent(number: int, seen: tuple[float, ...]) -> ml.Agent:
    values = ml.Floats(data=np.array(seen, "<f4").tobytes())
    return ml.Agent(id=number, observations=[ml.Observation(shape=[len(seen)], floats=values)])


def _says(content: ml.FromPlayer) -> ml.Message:
    return ml.Message(header=ml.Header(status=FINE), from_player=content)


if __name__ == "__main__":
    main()
