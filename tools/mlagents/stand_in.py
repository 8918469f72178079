"""A player written on the messages of the real `mlagents_envs`, under its own Python: `stand_in.py --mlagents-port N`.

Each agent sees a target and a letter. It is rewarded for a continuous action near the target and for the discrete
action that is the letter: 1 for both, about a third at random. It imports nothing of Joybridge.
"""

import argparse
import random

import grpc
from mlagents_envs.communicator_objects import unity_to_external_pb2_grpc
from mlagents_envs.communicator_objects.agent_info_pb2 import AgentInfoProto
from mlagents_envs.communicator_objects.command_pb2 import RESET
from mlagents_envs.communicator_objects.observation_pb2 import ObservationProto
from mlagents_envs.communicator_objects.unity_message_pb2 import UnityMessageProto

BEHAVIOR = "Aimer?team=0"  # as players write the name of a behavior
LETTERS, DECISIONS = 3, 8  # decisions of an episode
FINE, VERSION = 200, "1.5.0"


class Area:
    """A training area with one agent."""

    def __init__(self, number, seed):
        """Wait for the first reset."""
        self.rng = random.Random(1000 * seed + number)
        self.agent = number

    def reset(self, agent):
        """Begin an episode, whose agent has a new id."""
        self.agent, self.decisions = agent, 0
        self.look()

    def look(self):
        """Show another target and letter."""
        self.target, self.letter = self.rng.uniform(-1, 1), self.rng.randrange(LETTERS)

    def act(self, action):
        """Play an action and return the reward."""
        near = max(0.0, 1 - abs(action.continuous_actions[0] - self.target))
        reward = near / 2 + (action.discrete_actions[0] == self.letter) / 2
        self.decisions += 1
        self.look()
        return reward

    def info(self, reward, done=False):
        """Return what the agent sees, as a message."""
        agent = AgentInfoProto(id=self.agent, reward=reward, done=done, action_mask=[False] * LETTERS)
        letter = [float(self.letter == one) for one in range(LETTERS)]
        for name, values in (("target", [self.target]), ("letter", letter)):
            observation = ObservationProto(shape=[len(values)], name=name, dimension_properties=[1])
            observation.float_data.data.extend(values)
            agent.observations.append(observation)
        return agent


def main():
    """Play until the trainer dismisses this player."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mlagents-port", type=int, required=True)
    port = parser.parse_args().mlagents_port
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        exchange = unity_to_external_pb2_grpc.UnityToExternalProtoStub(channel).Exchange
        hello = UnityMessageProto()
        hello.header.status = FINE
        first = hello.unity_output.rl_initialization_output
        first.name, first.communication_version, first.package_version = "stand-in", VERSION, "3.0.0"
        greeting = exchange(hello, wait_for_ready=True).unity_input.rl_initialization_input
        areas = [Area(number, greeting.seed) for number in range(max(1, greeting.num_areas))]
        answer = exchange(said())
        message = announce(said())
        agents = len(areas)
        while answer.header.status == FINE:
            infos = message.unity_output.rl_output.agentInfos[BEHAVIOR].value
            given = answer.unity_input.rl_input
            if given.command == RESET:
                for number, area in enumerate(areas):
                    area.reset(number)
                infos.extend(area.info(0.0) for area in areas)
            else:
                for area, action in zip(areas, given.agent_actions[BEHAVIOR].value, strict=True):
                    reward = area.act(action)
                    if area.decisions == DECISIONS:
                        infos.append(area.info(reward, done=True))
                        area.reset(agents)
                        agents += 1
                        reward = 0.0
                    infos.append(area.info(reward))
            answer, message = exchange(message), said()


def said():
    """Return an empty message."""
    message = UnityMessageProto()
    message.header.status = FINE
    message.unity_output.rl_output.side_channel = b""
    return message


def announce(message):
    """Tell which actions the agents have."""
    parameters = message.unity_output.rl_initialization_output.brain_parameters.add(brain_name=BEHAVIOR)
    parameters.action_spec.num_continuous_actions = 1
    parameters.action_spec.num_discrete_actions = 1
    parameters.action_spec.discrete_branch_sizes.append(LETTERS)
    return message


if __name__ == "__main__":
    main()
