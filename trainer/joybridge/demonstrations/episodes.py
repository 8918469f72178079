"""Demonstrations as single episodes, which is what the formats of others hold, and episodes as demonstrations."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from joybridge.contract.codec import ActArrays, Codec, Format, StepArrays, pack, pack_act
from joybridge.contract.tensors import NUMPY_TYPES, Array, TensorError
from joybridge.demonstrations.recorded import RecordedEpisodes
from joybridge.v1 import bridge_pb2 as pb

LANES = 256  # of a stretch that is made of episodes


class Episode(NamedTuple):
    """An episode of one agent: decision t leads from observation t to observation t + 1."""

    observations: list[Array]  # per sensor [decisions + 1, *shape]
    act: ActArrays  # [decisions, …]
    rewards: Array  # float32 [decisions, channels]
    terminated: bool
    truncated: bool  # if it is not terminated either, it is unfinished
    masks: list[Array] | None  # per branch bool [decisions + 1, choices]; None: all allowed
    deciding: Array  # bool [decisions + 1]
    demonstrated: Array  # bool [decisions]
    metrics: Array | None = None  # float32 [metrics]

    def __len__(self) -> int:
        """Return the number of decisions."""
        return len(self.rewards)


def finished_episodes(stretch: RecordedEpisodes, behavior: int) -> Iterator[Episode]:
    """Yield the finished episodes of all lanes of a behavior, lane by lane."""
    demonstrated = [stretch.demonstrated(number, behavior) for number in range(len(stretch.acts))]
    for lane in range(len(stretch.steps[0][behavior].terminated)):
        begin = 0
        for end, step in enumerate(stretch.steps[1:], start=1):
            if step[behavior].terminated[lane] or step[behavior].truncated[lane]:
                own = np.array([shown[lane] for shown in demonstrated[begin:end]])
                yield _one_lane(stretch, behavior, lane, begin, end, own)
                begin = end


def _one_lane(
    stretch: RecordedEpisodes, behavior: int, lane: int, begin: int, end: int, demonstrated: Array
) -> Episode:
    """Return the episode that begins at one step and ends at another."""
    steps = [step[behavior] for step in stretch.steps[begin : end + 1]]
    acts = [act[behavior] for act in stretch.acts[begin:end]]
    before, last = steps[:-1], steps[-1]
    row = int(np.flatnonzero(last.ended == lane)[0])
    final = last.final_observations or []
    masks = None
    if any(step.masks is not None for step in before):
        choices = next(step.masks for step in before if step.masks is not None)
        masks = [
            np.array(
                [
                    *(np.ones_like(one[0]) if step.masks is None else step.masks[branch][lane] for step in before),
                    np.ones_like(one[0]),
                ]
            )
            for branch, one in enumerate(choices)
        ]
    seen = [[*(step.observations[sensor][lane] for step in before), one[row]] for sensor, one in enumerate(final)]
    return Episode(
        list(map(np.array, seen)),
        ActArrays(np.array([act.axes[lane] for act in acts]), np.array([act.choices[lane] for act in acts])),
        np.array([step.rewards[lane] for step in steps[1:]]),
        bool(last.terminated[lane]),
        bool(last.truncated[lane]),
        masks,
        np.array([*(step.deciding is None or bool(step.deciding[lane]) for step in before), True]),
        demonstrated,
        None if last.metrics is None else last.metrics[row],
    )


def check_episode(episode: Episode, behavior: pb.Behavior) -> None:
    """Raise TensorError unless an episode is one of a behavior: dtypes, shapes, numbers, ranges and masks."""
    decisions = len(episode)
    if not decisions:
        raise TensorError("it has no decision")
    for sensor, values in zip(behavior.sensors, episode.observations, strict=True):
        Format(sensor.dtype, (decisions + 1, *sensor.shape), f"sensor {sensor.name}").unpack(pack(values))
    Format(pb.DTYPE_FLOAT32, (decisions, len(behavior.channels)), "rewards").unpack(pack(episode.rewards))
    alone = pb.Behavior()
    alone.CopyFrom(behavior)
    alone.agents_per_arena = 1
    masks = None if episode.masks is None else [mask[:-1] for mask in episode.masks]
    nothing = np.zeros(decisions, bool)
    step = StepArrays([], episode.rewards, nothing, nothing, masks, episode.deciding[:-1])
    try:
        Codec(alone, decisions).unpack_act(pack_act(episode.act), step)  # decisions as lanes
    except TensorError as error:
        raise TensorError(str(error).replace(" in lane ", " in decision ")) from None


def exact(values: Array, dtype: Any) -> Array:
    """Return numbers in another type; only float32 may round them. Raises ValueError."""
    with np.errstate(over="ignore", invalid="ignore"):
        cast = values.astype(dtype)
    if cast.dtype.kind != "f" and not (cast == values).all():
        raise ValueError(f"{values[cast != values][0]} is no {cast.dtype}")
    return cast


def join_episodes(episodes: Sequence[Episode], spec: pb.GameSpec, behavior: int) -> Iterator[RecordedEpisodes]:
    """Yield the stretches in which each episode has a lane; the other behaviors have none."""
    ordered = sorted(episodes, key=len)  # so that few lanes wait for the longest
    for begin in range(0, len(ordered), LANES):
        yield _join(ordered[begin : begin + LANES], spec, behavior)


def _join(episodes: Sequence[Episode], spec: pb.GameSpec, behavior: int) -> RecordedEpisodes:
    longest = len(episodes[-1])
    observations = [
        _side_by_side(parts, longest + 1) for parts in zip(*(one.observations for one in episodes), strict=True)
    ]
    axes, choices, rewards, demonstrated = (
        _side_by_side(parts, longest)
        for parts in zip(
            *((one.act.axes, one.act.choices, one.rewards, one.demonstrated) for one in episodes), strict=True
        )
    )
    deciding = _side_by_side([one.deciding[:-1] for one in episodes], longest + 1)
    branches = spec.behaviors[behavior].device.branches
    masks = None
    if any(one.masks is not None for one in episodes):
        masks = [
            _side_by_side([_mask(one, number, len(branch.choices)) for one in episodes], longest + 1, True)
            for number, branch in enumerate(branches)
        ]
    ends = np.array([len(one) for one in episodes])
    terminated, truncated = (
        np.array(part) for part in zip(*((one.terminated, one.truncated) for one in episodes), strict=True)
    )
    nobody = [_nobody(one) for one in spec.behaviors]
    earned = np.concatenate([np.zeros_like(rewards[:1]), rewards])
    stretch = RecordedEpisodes([], [], [])
    for number in range(longest + 1):
        over = ends == number
        step = StepArrays(
            [sensor[number] for sensor in observations],
            earned[number],
            over & terminated,
            over & truncated,
            None if masks is None else [mask[number] for mask in masks],
            deciding[number],
        )
        step.ended = np.flatnonzero(step.ends).astype(np.int32)
        if len(step.ended):
            step.final_observations = [sensor[number][step.ended] for sensor in observations]
        stretch.steps.append([step if index == behavior else one[0] for index, one in enumerate(nobody)])
    for number in range(longest):
        act = ActArrays(axes[number], choices[number])
        stretch.acts.append([act if index == behavior else one[1] for index, one in enumerate(nobody)])
        lanes = np.flatnonzero(demonstrated[number]).tolist()
        stretch.held.append([lanes if index == behavior else [] for index in range(len(nobody))])
    return stretch


def _side_by_side(parts: Sequence[Array], longest: int, rest: float = 0) -> Array:
    """Return arrays [length, …] as one [longest, arrays, …], filled up with `rest`."""
    joined = np.full((longest, len(parts), *parts[0].shape[1:]), rest, parts[0].dtype)
    for lane, part in enumerate(parts):
        joined[: len(part), lane] = part
    return joined


def _mask(episode: Episode, branch: int, choices: int) -> Array:
    return np.ones((len(episode) + 1, choices), bool) if episode.masks is None else episode.masks[branch]


def _nobody(behavior: pb.Behavior) -> tuple[StepArrays, ActArrays]:
    """Return the step and the act of no lane at all."""
    sensors = [np.zeros((0, *one.shape), NUMPY_TYPES[one.dtype]) for one in behavior.sensors]
    nothing, device = np.zeros(0, bool), behavior.device
    step = StepArrays(sensors, np.zeros((0, len(behavior.channels)), np.float32), nothing, nothing)
    axes, choices = (np.zeros((0, len(part))) for part in (device.axes, device.branches))
    return step, ActArrays(axes.astype(np.float32), choices.astype(np.int32))
