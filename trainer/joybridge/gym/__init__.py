"""The games of any joybridge.v1 server as Gymnasium and PettingZoo environments.

    envs = BridgeVectorEnv("shooting_birds", arenas=60)                 # many arenas, one call for all of them
    env = BridgeEnv("shooting_birds", layout="bucket-11")               # one arena with one agent
    env = BridgeParallelEnv("shooting_birds", layout="multiagent")      # PettingZoo: one arena, several agents
    env = BridgeEnv("my_game:MyGame")                                   # a game of your own; the class works as well

Games. An environment starts a simulator in a child process and ends it in `close`, or when the environment is garbage
collected. Pass `simulator="HOST:PORT"` to use one that is running. Importing this module registers the built-in games:
`gymnasium.make("joybridge/ShootingBirds-v0")` and `gymnasium.make_vec` work. The longer
"joybridge.gym:joybridge/ShootingBirds-v0" works without the import.

Defaults. Arguments have the names, meanings and defaults of the keys of a training configuration.

Observations. A frame is the sensors in the order of the spec, flattened side by side, float32. An observation is the
last `frame_stack` frames, oldest first, with zeros before the first frame of an episode. A reward is the weighted sum
of the reward channels. Training uses the same code.

Actions. The layout defines the action space: a MultiDiscrete, a Box from -1 to 1, or for both a Dict with the Box as
"continuous" and the MultiDiscrete as "discrete". Continuous actions outside of the Box act like the nearest bound.

Infos. At the end of an episode the info holds the metrics of the episode by name. Before, it may hold:

    "action_mask"   which choices are allowed in the next step, where the game masks any: bool [choices], the choices of
                    all branches side by side; [num_envs, choices] in BridgeVectorEnv. `sample_mask` turns it into what
                    `action_space.sample` takes. A forbidden choice raises SimulatorError and closes the session.
    "deciding"      which lanes act in the next step, where some wait for other agents. Actions of waiting lanes are
                    ignored.

Errors. Arguments that cannot be used raise ConfigError, actions that cannot be used ActionError; both are ValueErrors.
SimulatorError is raised if the simulator refuses or fails, and SimulatorLost if it cannot be reached. All of them are
JoybridgeErrors.

Processes. gRPC does not survive a fork. A program that has created an environment must start further processes by
spawning, for example AsyncVectorEnv with context="spawn". BridgeVectorEnv needs no further processes.
"""

from joybridge.gym import registration
from joybridge.gym.parallel_env import BridgeParallelEnv
from joybridge.gym.player import ActionError
from joybridge.gym.single_env import BridgeEnv
from joybridge.gym.spaces import sample_mask
from joybridge.gym.vector_env import BridgeVectorEnv

__all__ = ["ActionError", "BridgeEnv", "BridgeParallelEnv", "BridgeVectorEnv", "sample_mask"]

registration.register_games()
