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
of the reward channels. Training uses the same code. With `flatten=False` an observation is a dict with the array of
each sensor in its own dtype and shape; with more than one frame, the first axis is that of the frames. Images are never
flattened: a game that shows some needs `flatten=False`.

Actions. The layout defines the action space: a MultiDiscrete, a Box from -1 to 1, or for both a Dict with the Box as
"continuous" and the MultiDiscrete as "discrete". Continuous actions outside of the Box act like the nearest bound.

Infos. Every info holds, about the next step:

    "action_mask"   which choices are allowed: bool [choices], the choices of all branches side by side;
                    [num_envs, choices] in BridgeVectorEnv. `sample_allowed` draws a random action that obeys it.
    "deciding"      whether the lane acts: a bool, or bool [num_envs]. False if it waits for other agents; its action is
                    then ignored.

At the end of an episode the info also holds the metrics of the episode by name.

Masks. A forbidden choice raises ActionError and is not played. With `forbidden="first_allowed"`, the first allowed
choice of its branch is played instead. Continuous actions, as those of threshold-T, are never an error: where they
would make a forbidden choice, they make the first allowed one. Training does the same.

Others. `BridgeEnv("noughts", others=["script:perfect"])` and `BridgeVectorEnv(…, others=["runs/x"])` leave the first
agent of each arena to you, and let others hold all other seats: policies of runs, exported files, scripts of the game.

Pictures. With `render_mode="rgb_array"`, `render` returns the picture after the last step. The simulator draws in a
step, so steps are drawn from the first call of `render` until the next reset, and the first picture is black.

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
from joybridge.gym.spaces import sample_allowed
from joybridge.gym.vector_env import BridgeVectorEnv

__all__ = ["ActionError", "BridgeEnv", "BridgeParallelEnv", "BridgeVectorEnv", "sample_allowed"]

registration.register_games()
