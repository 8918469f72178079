"""Write a file `.demo` by the real ML-Agents and read it again: `demonstration.py INPUT.npz FILE.demo OUTPUT.npz`.

INPUT has a row per step of an agent. OUTPUT is what ML-Agents' own loader reads. The loader is imported without the
buffers of the trainer, which need PyTorch, and which it does not use to read a file. It imports nothing of Joybridge.
"""

import sys
from unittest import mock

import numpy as np
from mlagents_envs.communicator_objects.agent_action_pb2 import AgentActionProto
from mlagents_envs.communicator_objects.agent_info_action_pair_pb2 import AgentInfoActionPairProto
from mlagents_envs.communicator_objects.agent_info_pb2 import AgentInfoProto
from mlagents_envs.communicator_objects.brain_parameters_pb2 import ActionSpecProto, BrainParametersProto
from mlagents_envs.communicator_objects.demonstration_meta_pb2 import DemonstrationMetaProto
from mlagents_envs.communicator_objects.observation_pb2 import ObservationProto
from mlagents_envs.rpc_utils import steps_from_proto

with mock.patch.dict(sys.modules, {f"mlagents.trainers.{name}": mock.MagicMock() for name in ("buffer", "trajectory")}):
    from mlagents.trainers.demo_loader import load_demonstration, write_demo


def main():
    """Run the command line."""
    given, file, output = sys.argv[1:]
    with np.load(given) as archive:
        write(file, dict(archive))
    np.savez(output, **read(file))


def write(file, rows):
    """Write the rows."""
    sensors = sorted(name for name in rows if name.startswith("sensor "))
    pairs = []
    for row in range(len(rows["done"])):
        info = AgentInfoProto(
            reward=rows["reward"][row],
            done=rows["done"][row],
            max_step_reached=rows["interrupted"][row],
            id=rows["id"][row],
            action_mask=rows["mask"][row].tolist(),
        )
        for name in sensors:
            values = rows[name][row]
            floats = ObservationProto.FloatData(data=values.tolist())
            info.observations.add(name=name[7:], shape=values.shape, float_data=floats, dimension_properties=[1])
        action = AgentActionProto(continuous_actions=rows["continuous"][row], discrete_actions=rows["discrete"][row])
        pairs.append(AgentInfoActionPairProto(agent_info=info, action_info=action))
    actions = ActionSpecProto(
        num_continuous_actions=rows["continuous"].shape[1],
        num_discrete_actions=rows["discrete"].shape[1],
        discrete_branch_sizes=rows["sizes"].tolist(),
    )
    heading = DemonstrationMetaProto(api_version=1, demonstration_name="check", number_steps=len(pairs))
    write_demo(file, heading, BrainParametersProto(brain_name=str(rows["behavior"]), action_spec=actions), pairs)


def read(file):
    """Return what ML-Agents reads, as rows."""
    behavior, pairs, counted = load_demonstration(file)
    assert counted == len(pairs)
    rows = {name: [] for name in ("reward", "done", "interrupted", "continuous", "discrete")}
    for pair in pairs:
        decisions, ends = steps_from_proto([pair.agent_info], behavior)
        (step,) = (ends or decisions).values()
        for index, spec in enumerate(behavior.observation_specs):
            rows.setdefault(f"sensor {spec.name}", []).append(step.obs[index])
        rows["reward"].append(step.reward)
        rows["done"].append(len(ends) == 1)
        rows["interrupted"].append(len(ends) == 1 and step.interrupted)
        rows["continuous"].append(list(pair.action_info.continuous_actions))
        rows["discrete"].append(list(pair.action_info.discrete_actions))
    return {name: np.array(values) for name, values in rows.items()}


if __name__ == "__main__":
    main()
