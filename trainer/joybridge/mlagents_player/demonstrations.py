"""Files `.demo` of ML-Agents as demonstrations. A file is of one behavior.

It holds messages, each after its size as a varint: a DemonstrationHeading at its beginning, BehaviorParameters at byte
33, and a DemonstrationStep for every observation of an agent.

Unity writes a step before it decides. So the action in a step is the one that led to it, and what an agent did upon an
observation stands in the agent's next step. (The trainer of ML-Agents takes the action beside the observation.)
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError

from joybridge.client.demonstration_log import SUFFIX
from joybridge.client.recording import MAX_FILE_BYTES, RecordingError
from joybridge.contract.codec import ActArrays
from joybridge.contract.files import read_file
from joybridge.contract.tensors import NUMPY_TYPES, Array, TensorError
from joybridge.contract.text import printable
from joybridge.demonstrations.episodes import Episode, check_episode, exact, join_episodes
from joybridge.demonstrations.formats import Format
from joybridge.demonstrations.recorded import Demonstration
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.records import FLOAT
from joybridge.mlagents_player.records import is_image, scale_axes
from joybridge.v1 import bridge_pb2 as pb

HEADING_BYTES = 32  # bytes for the heading, after its size
MAX_SIZE_BYTES = 5  # bytes of a size


def is_mlagents(path: Path) -> bool:
    """Return whether a file is one of ML-Agents: it begins with the size of its heading."""
    if path.suffix != SUFFIX or not path.is_file():
        return False
    with path.open("rb") as file:
        first = file.read(1)
    return first != b"" and first[0] <= HEADING_BYTES


def load_mlagents(path: Path, spec: pb.GameSpec) -> Demonstration:
    """Return what a file holds. Raises RecordingError unless it fits a behavior of this spec."""
    try:
        data = read_file(path, MAX_FILE_BYTES)
        heading, _ = _message(data, 0)
        counted = ml.DemonstrationHeading.FromString(heading).steps
        parameters, place = _message(data, HEADING_BYTES + 1)
        actions = ml.BehaviorParameters.FromString(parameters)
        index = _behavior(path, actions, spec)
        steps = []
        while place < len(data):
            try:
                body, after = _message(data, place)
            except EOFError:
                break
            steps.append(ml.DemonstrationStep.FromString(body))
            if not steps[-1].agent.observations:  # a small file could hold very many of them
                raise ValueError(f"the step at byte {place:,} has no observations")
            place = after
    except (OSError, EOFError, ValueError, DecodeError) as error:
        raise RecordingError(
            f"{path} is no demonstration of ML-Agents that can be read ({error or 'it is cut off'}); restore it from a "
            "copy, or take it out of the folder"
        ) from error
    episodes = list(_episodes(path, steps, spec.behaviors[index], list(actions.action_spec.branch_sizes)))
    stretches = list(join_episodes(episodes, spec, index))
    return Demonstration(path, spec, stretches, len(data) - place, max(0, counted - len(steps)))


def _message(data: bytes, place: int) -> tuple[bytes, int]:
    """Return the message at a place, and the place after it. Raises EOFError if it is cut off, and ValueError."""
    size = 0
    for count in range(MAX_SIZE_BYTES):
        if place + count >= len(data):
            raise EOFError
        size |= (data[place + count] & 0x7F) << 7 * count
        if data[place + count] < 0x80:
            begin = place + count + 1
            if begin + size > len(data):
                raise EOFError
            return data[begin : begin + size], begin + size
    raise ValueError(f"byte {place:,} is no size of a message")


def _behavior(path: Path, parameters: ml.BehaviorParameters, spec: pb.GameSpec) -> int:
    """Return the number of the behavior that a file is of. Raises RecordingError."""
    names = [behavior.name for behavior in spec.behaviors]
    name = names[0] if len(names) == 1 else parameters.name
    if name not in names:
        raise RecordingError(
            f"{path} is of the behavior {printable(parameters.name)!r}, expected one of {', '.join(names)}"
        )
    if not parameters.HasField("action_spec"):
        raise RecordingError(f"{path} says nothing of its actions: it is older than ML-Agents 2.0; record it again")
    behavior = spec.behaviors[names.index(name)]
    actions, device = parameters.action_spec, behavior.device
    came = (actions.continuous_actions, [size for size in actions.branch_sizes if size > 1])
    wanted = (len(device.axes), [len(branch.choices) for branch in device.branches])
    if came != wanted:
        raise RecordingError(
            f"{path} has {came[0]} continuous actions and branches of {came[1]} choices, expected {wanted[0]} and "
            f"{wanted[1]}, which is the device of {name}"
        )
    return names.index(name)


def _episodes(
    path: Path, steps: Sequence[ml.DemonstrationStep], behavior: pb.Behavior, sizes: Sequence[int]
) -> Iterator[Episode]:
    """Yield the episodes of all agents, those that are unfinished last. Raises RecordingError.

    sizes: of the branches there. One with a single choice is none here, as in `joybridge serve --unity`.
    """
    running: dict[int, list[ml.DemonstrationStep]] = {}
    episodes = []
    for step in steps:
        running.setdefault(step.agent.id, []).append(step)
        if step.agent.done:
            episodes.append(running.pop(step.agent.id))
    for number, parts in enumerate([*episodes, *running.values()]):
        if len(parts) == 1:  # nothing was decided
            continue
        try:
            episode = _episode(parts, behavior, sizes)
            check_episode(episode, behavior)
        except (TensorError, ValueError) as error:
            raise RecordingError(f"{path}, episode {number}: {error}; record it again") from error
        yield episode


def _episode(steps: Sequence[ml.DemonstrationStep], behavior: pb.Behavior, sizes: Sequence[int]) -> Episode:
    """Return an episode of an agent. Raises ValueError."""
    device, last = behavior.device, steps[-1].agent
    low, high = (np.array([getattr(axis, bound) for axis in device.axes], np.float32) for bound in ("low", "high"))
    continuous = _rows([np.frombuffer(step.action.continuous, FLOAT) for step in steps[1:]], "continuous", len(low))
    if not np.isfinite(continuous).all():
        raise ValueError("a continuous action is not a number")
    discrete = _rows([np.array(step.action.discrete, np.int32) for step in steps[1:]], "discrete", len(sizes))
    always = np.ones(len(steps), bool)
    return Episode(
        _sensors([step.agent for step in steps], behavior),
        ActArrays(scale_axes(continuous, low, high), discrete[:, np.array(sizes, int) > 1]),
        _rewards([step.agent for step in steps[1:]], behavior),
        last.done and not last.interrupted,
        last.done and last.interrupted,
        _masks([step.agent.action_mask for step in steps], sizes),
        always,
        always[1:],
    )


def _rewards(agents: Sequence[ml.Agent], behavior: pb.Behavior) -> Array:
    """Return the rewards, float32 [decisions, channels]; 0 in channels of which the file says nothing."""
    own, group = ([getattr(agent, name) for agent in agents] for name in ("reward", "group_reward"))
    if len(behavior.channels) == 1:
        return np.add(own, group, dtype=np.float32)[:, None]
    known = {"reward": own, "group_reward": group}  # the channels of `joybridge serve --unity`
    return np.array([known.get(channel.name, [0.0] * len(own)) for channel in behavior.channels], np.float32).T


def _sensors(agents: Sequence[ml.Agent], behavior: pb.Behavior) -> list[Array]:
    """Return what each sensor has shown, [steps, *shape]. Sensors have their names, or else their order."""
    names = [one.name for one in agents[0].observations]
    wanted = [sensor.name for sensor in behavior.sensors]
    order = [names.index(name) for name in wanted] if sorted(names) == sorted(wanted) else list(range(len(wanted)))
    for agent in agents:
        own = [one.name for one in agent.observations]
        shapes = [list(one.shape) for one in agent.observations]
        if (
            own != names
            or len(shapes) != len(wanted)
            or any(shapes[place] not in _shapes(sensor) for place, sensor in zip(order, behavior.sensors, strict=True))
        ):
            expected = ", ".join(f"{one.name} {_shapes(one)[0]}" for one in behavior.sensors)
            raise ValueError(f"it observes {[printable(name) for name in own]} of {shapes}, expected {expected}")
        if any(one.WhichOneof("values") != "floats" for one in agent.observations):
            raise ValueError("an observation is compressed; set the compression of its sensor to none")
    found = []
    for place, sensor in zip(order, behavior.sensors, strict=True):
        shape = list(agents[0].observations[place].shape)
        parts = [np.frombuffer(agent.observations[place].floats.data, FLOAT) for agent in agents]
        values = _rows(parts, sensor.name, int(np.prod(shape))).reshape(len(agents), *shape)
        if len(shape) == 3:
            values = values.transpose(0, 2, 3, 1)
        if is_image(sensor):
            values = np.rint(values.astype(np.float64) * 255)
        found.append(exact(values.reshape(len(agents), *sensor.shape), NUMPY_TYPES[sensor.dtype]))
    return found


def _shapes(sensor: pb.Sensor) -> list[list[int]]:
    """Return the shapes that a sensor may have there: of an image, with its channels first, or of a vector."""
    whole, vector = list(sensor.shape), [int(np.prod(sensor.shape))]
    if len(whole) == 3:
        whole = [whole[2], *whole[:2]]
    return [whole] if is_image(sensor) else [whole, vector]


def _masks(flags: Sequence[bytes], sizes: Sequence[int]) -> list[Array] | None:
    """Return the masks of each branch, bool [steps, choices], None if there are none. Raises ValueError."""
    if not any(flags):
        return None
    rows = [np.frombuffer(one or bytes(sum(sizes)), np.uint8) for one in flags]
    parts = np.split(_rows(rows, "action_mask", sum(sizes)) == 0, np.cumsum(sizes)[:-1], axis=1)
    return [part for part, size in zip(parts, sizes, strict=True) if size > 1]


def _rows(parts: Sequence[Array], name: str, width: int) -> Array:
    """Return arrays of the same length as rows. Raises ValueError."""
    for part in parts:
        if len(part) != width:
            raise ValueError(f"{name} has {len(part)} values, expected {width}")
    return np.array(parts).reshape(len(parts), width)


FORMAT = Format(
    kind="a demonstration of ML-Agents",
    patterns=(f"*{SUFFIX}",),
    find=lambda path: path if is_mlagents(path) else None,
    load=load_mlagents,
)
