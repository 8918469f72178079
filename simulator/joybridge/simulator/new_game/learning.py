"""How agents begin to learn that observe numbers, or see an image: the keys of a configuration that follow from it."""

from joybridge.contract.limits import element_count
from joybridge.v1 import bridge_pb2 as pb

ROLLOUT = 60  # decisions, at most
CELLS_ACROSS = 16  # of the map in which a pointer is placed
NEVER_ACTS = """\
  # penalty_ramp: 100000  # if it learns to do nothing because misses cost: timesteps over which penalties grow
"""
WIDE = """\
  log_std_init: 1.1       # axes are first tried over their whole range; 0: around the middle, which is safer to play
"""


def images(spec: pb.GameSpec) -> list[pb.Sensor]:
    """Return the sensors of a game that are images."""
    return [sensor for behavior in spec.behaviors for sensor in behavior.sensors if sensor.HasField("image")]


def layout(spec: pb.GameSpec) -> str:
    """Return the line of a layout: for a pointer that is placed in the image it sees, one that points into it."""
    seen = [sensor for sensor in images(spec) if not sensor.image.centered]
    kinds = [[axis.kind for axis in behavior.device.axes] for behavior in spec.behaviors]
    if not images(spec):
        name, others = "hybrid", "bucket-5, threshold-0.0, multiagent"
    elif seen and all(each == [pb.AXIS_KIND_POSITION] * 2 for each in kinds):
        height, width = seen[0].shape[:2]
        name = f"map-{CELLS_ACROSS}x{max(1, round(CELLS_ACROSS * height / width))}"
        others = "bucket-7, hybrid\n# A pointer is put on centers of cells: more for small targets, fewer for large."
        if any(len(behavior.device.branches) > 1 for behavior in spec.behaviors):
            x, y = (f"{axis.name}={name}" for axis in spec.behaviors[0].device.axes)
            others += f" It presses\n# one button at a time; several at once: hybrid, {x}, {y}"
    elif any(kinds):
        name, others = "bucket-7", "hybrid, multiagent"
    else:  # buttons alone, which may belong together
        name, others = "hybrid", "multiagent"
    return f"layout: {name:<18}# how the policy controls axes and buttons; others: {others}"


def policy(spec: pb.GameSpec) -> str:
    """Return the key `policy`, with a comment for each key in it."""
    return _of_images(spec) if images(spec) else _of_numbers(spec)


def _of_images(spec: pb.GameSpec) -> str:
    height, width, *_ = images(spec)[0].shape
    rollout = min(64, spec.max_episode_decisions or 64)
    return f"""\
policy:
  image_encoder: auto     # convolutions over the image of {width}x{height}; learning takes about ten times as long as
                          # from numbers, so begin with a small image: the options of the game may have one
  frame_stack: 2          # images that it sees at once; more if things move that two do not show
  hidden_sizes: [128]     # units per hidden layer, behind the convolutions
  activation: relu
  rollout_steps: {rollout:<9}# decisions of every arena between two updates
  time_horizon: {rollout:<10}# decisions after which the return is bootstrapped from the value
  gamma: 0.97             # discount per decision; closer to 1 if rewards come late
  scale_rewards: true
  minibatch_size: 256
  epochs: 3               # how often an update goes through its rollout; fewer if the reward breaks down
  learning_rate: 1.0e-3   # lower if the reward fluctuates
  entropy_coef: 0.01      # higher for more exploration; lower if the policy does not converge
{NEVER_ACTS}"""


def _of_numbers(spec: pb.GameSpec) -> str:
    numbers = max(sum(element_count(sensor) for sensor in behavior.sensors) for behavior in spec.behaviors)
    units = 32 if numbers <= 8 else 64 if numbers <= 64 else 128
    rollout = min(ROLLOUT, spec.max_episode_decisions or ROLLOUT)
    wide = WIDE if any(behavior.device.axes for behavior in spec.behaviors) else ""
    return f"""\
policy:
  frame_stack: 1          # observations per network input; more if one observation does not show how things move
  hidden_sizes: {f"[{units}, {units}]":<10}# units per hidden layer; an observation has {numbers} numbers
  rollout_steps: {rollout:<9}# decisions of every arena between two updates
  time_horizon: {rollout:<10}# decisions after which the return is bootstrapped from the value
  gamma: 0.99             # discount per decision; closer to 1 if rewards come late
  minibatch_size: 256     # smaller, as 64, where arenas and rollouts are made smaller for a short training
  epochs: 10              # how often an update goes through its rollout; fewer if the reward breaks down
  learning_rate: 2.0e-3   # lower if the reward fluctuates
  target_kl: 0.03         # ends an update that changes the policy too much, as of a clone that is sure of its axes
  entropy_coef: 0.003     # higher for more exploration; lower if the policy does not converge
{NEVER_ACTS}{wide}"""
