"""Drive games through the real `mlagents_envs`, under its own Python: `drive.py OUTPUT GAME:PORT …`.

Writes everything that it saw and did into OUTPUT, one NumPy archive per game, for `tools.check_mlagents` to compare.
The last game is timed instead. It imports nothing of Joybridge.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from mlagents_envs.base_env import ActionTuple
from mlagents_envs.environment import UnityEnvironment
from mlagents_envs.side_channel.engine_configuration_channel import EngineConfigurationChannel
from mlagents_envs.side_channel.environment_parameters_channel import EnvironmentParametersChannel
from mlagents_envs.side_channel.stats_side_channel import StatsSideChannel

SEED, ARENAS, TIMED_ARENAS = 3, 4, 64
STEPS, TIMED_STEPS = 120, 400
RESET_AT = 70  # an early reset, with another parameter where the game has it
PARAMETERS = {"shooting_birds": ("bird_speed", (0.5, 1.5))}


def main():
    """Run the command line."""
    warnings.simplefilter("ignore")
    output, *games = sys.argv[1:]
    *driven, timed = [(game.partition(":")[0], int(game.partition(":")[2])) for game in games]
    for game, port in driven:
        np.savez(Path(output) / f"{game}.npz", **drive(game, port))
    print(f"{measure(timed[1]):.0f} agent-steps/s")


def drive(game, port):
    """Play a game with random allowed actions and return what happened, by "step/behavior/what"."""
    parameters, engine, statistics = EnvironmentParametersChannel(), EngineConfigurationChannel(), StatsSideChannel()
    env = UnityEnvironment(
        None, base_port=port, seed=SEED, num_areas=ARENAS, side_channels=[parameters, engine, statistics]
    )
    engine.set_configuration_parameters(time_scale=20.0)
    name, values = PARAMETERS.get(game, ("", ()))
    if name:
        parameters.set_float_parameter(name, values[0])
    record, rng = {}, np.random.default_rng(SEED)
    try:
        env.reset()
        for step in range(STEPS):
            if step == RESET_AT:
                if name:
                    parameters.set_float_parameter(name, values[1])
                env.reset()
            for behavior, spec in env.behavior_specs.items():
                decisions, ends = env.get_steps(behavior)
                key = f"{step}/{behavior}"
                for index, seen in enumerate(decisions.obs):
                    record[f"{key}/obs{index}"] = seen
                    record[f"{key}/final{index}"] = ends.obs[index]
                for index, mask in enumerate(decisions.action_mask or ()):
                    record[f"{key}/mask{index}"] = mask
                record[f"{key}/ids"], record[f"{key}/ended_ids"] = decisions.agent_id, ends.agent_id
                record[f"{key}/reward"], record[f"{key}/ended_reward"] = decisions.reward, ends.reward
                record[f"{key}/interrupted"] = ends.interrupted
                if len(decisions):
                    act = choose(spec.action_spec, decisions, rng)
                    record[f"{key}/continuous"], record[f"{key}/discrete"] = act.continuous, act.discrete
                    env.set_actions(behavior, act)
            env.step()
        told = statistics.get_and_reset_stats()
        for statistic, values in told.items():
            record[f"statistics/{statistic}"] = np.array([value for value, _ in values], np.float32)
    finally:
        env.close()
    return record


def choose(spec, decisions, rng):
    """Return random actions that the masks allow."""
    count = len(decisions)
    continuous = rng.uniform(-1.0, 1.0, (count, spec.continuous_size)).astype(np.float32)
    discrete = np.zeros((count, spec.discrete_size), np.int32)
    for branch, size in enumerate(spec.discrete_branches):
        forbidden = decisions.action_mask[branch] if decisions.action_mask else np.zeros((count, size), bool)
        discrete[:, branch] = (rng.random((count, size)) + ~forbidden).argmax(axis=1)
    return ActionTuple(continuous, discrete)


def measure(port):
    """Return agent-steps per second with many agents that all act in every step."""
    env = UnityEnvironment(None, base_port=port, seed=SEED, num_areas=TIMED_ARENAS, side_channels=[StatsSideChannel()])
    try:
        env.reset()
        ((behavior, spec),) = env.behavior_specs.items()
        act = spec.action_spec.empty_action(TIMED_ARENAS)
        for _ in range(20):
            env.step()
        begin = time.perf_counter()
        for _ in range(TIMED_STEPS):
            env.get_steps(behavior)
            env.set_actions(behavior, act)
            env.step()
        return TIMED_STEPS * TIMED_ARENAS / (time.perf_counter() - begin)
    finally:
        env.close()


if __name__ == "__main__":
    main()
