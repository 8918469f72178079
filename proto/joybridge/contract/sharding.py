"""A session in parts: bounds of arenas, actions of a part, steps of all parts as one, and some lanes of a step."""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array

__all__ = ["join", "part_of", "rows_of", "split"]


def split(arenas: int, parts: int) -> list[int]:
    """Return the bounds of nearly equal parts: part k has the arenas from bounds[k] to bounds[k + 1] - 1."""
    return [int(bound) for bound in np.linspace(0, arenas, parts + 1).round()]


def part_of(acts: Sequence[ActArrays], bounds: Sequence[Sequence[int]], part: int) -> list[ActArrays]:
    """Return the actions of one part. bounds: per behavior, those of the lanes of the parts."""
    return [act.rows(slice(lanes[part], lanes[part + 1])) for act, lanes in zip(acts, bounds, strict=True)]


def rows_of(step: StepArrays, lanes: Array) -> StepArrays:
    """Return the step of some lanes of a behavior, by their numbers, ascending."""
    part = StepArrays(
        [sensor[lanes] for sensor in step.observations],
        step.rewards[lanes],
        step.terminated[lanes],
        step.truncated[lanes],
        None if step.masks is None else [mask[lanes] for mask in step.masks],
        None if step.deciding is None else step.deciding[lanes],
    )
    if len(step.ended):
        rows, finals = np.isin(step.ended, lanes), step.final_observations
        part.ended = np.flatnonzero(part.ends).astype(np.int32)
        part.final_observations = None if finals is None else [sensor[rows] for sensor in finals]
        part.metrics = None if step.metrics is None else step.metrics[rows]
        part.parameters = None if step.parameters is None else step.parameters[rows]
        part.interrupted = None if step.interrupted is None else step.interrupted[rows]
    return part


def join(parts: list[list[StepArrays]]) -> list[StepArrays]:
    """Return one StepArrays per behavior, with the lanes of all parts in order."""
    return [_join_lanes(list(steps)) for steps in zip(*parts, strict=True)]


def _join_lanes(parts: list[StepArrays]) -> StepArrays:
    lanes = np.cumsum([0, *(len(part.rewards) for part in parts)])
    ending = [part for part in parts if len(part.ended)]
    joined = StepArrays(
        [np.concatenate(columns) for columns in zip(*(part.observations for part in parts), strict=True)],
        np.concatenate([part.rewards for part in parts]),
        np.concatenate([part.terminated for part in parts]),
        np.concatenate([part.truncated for part in parts]),
        _join_masks(parts),
        _join_deciding(parts),
        np.concatenate([part.ended + first for part, first in zip(parts, lanes, strict=False)]).astype(np.int32),
    )
    if ending:
        finals = [part.final_observations or [] for part in ending]
        joined.final_observations = [np.concatenate(columns) for columns in zip(*finals, strict=True)]
        metrics = [part.metrics for part in ending if part.metrics is not None]
        joined.metrics = np.concatenate(metrics) if metrics else None
        parameters = [part.parameters for part in ending if part.parameters is not None]
        joined.parameters = np.concatenate(parameters) if parameters else None
        if any(part.interrupted is not None for part in ending):
            joined.interrupted = np.concatenate(
                [np.zeros(len(part.ended), bool) if part.interrupted is None else part.interrupted for part in ending]
            )
    return joined


def _join_masks(parts: list[StepArrays]) -> list[Array] | None:
    given = next((part.masks for part in parts if part.masks is not None), None)
    if given is None:
        return None
    filled = [part.masks or [np.ones((len(part.rewards), mask.shape[1]), bool) for mask in given] for part in parts]
    return [np.concatenate(columns) for columns in zip(*filled, strict=True)]


def _join_deciding(parts: list[StepArrays]) -> Array | None:
    if all(part.deciding is None for part in parts):
        return None
    return np.concatenate([part.decides for part in parts])
