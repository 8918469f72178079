"""What every step must satisfy, whether it follows a Start, an Act or a Reset."""

import numpy as np

from joybridge.conformance.expectations import Violation, expect
from joybridge.conformance.step_view import StepView, tensor_error
from joybridge.v1 import bridge_pb2 as pb


def expect_tensor(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...], what: str) -> None:
    """Raise Violation unless a tensor has a dtype, a shape and the bytes of both."""
    error = tensor_error(tensor, dtype, shape)
    expect(not error, f"{what} with {error}", f"{pb.Dtype.Name(dtype)} {list(shape)}")


def expect_observations(view: StepView, final: bool = False) -> None:
    """Raise Violation unless there is one tensor per sensor, each with a row per lane, or per ended lane if final."""
    tensors = view.message.ended.final_observations if final else view.message.observations
    rows, what = (int(view.ended.sum()), "final observations") if final else (view.lanes, "observations")
    sensors = view.behavior.sensors
    expect(len(tensors) == len(sensors), f"{len(tensors)} {what} of {view.where}", f"{len(sensors)}, one per sensor")
    for tensor, sensor in zip(tensors, sensors, strict=True):
        expect_tensor(tensor, sensor.dtype, (rows, *sensor.shape), f"{what} of sensor {sensor.name!r} of {view.where}")


def expect_finite(view: StepView, final: bool = False) -> None:
    """Raise Violation if an observation is NaN or infinite."""
    for sensor, values in view.observations(final):
        if sensor.dtype == pb.DTYPE_FLOAT32:
            finite = np.isfinite(values)
            if not finite.all():
                raise Violation(f"{values[~finite][:1]} from sensor {sensor.name!r} of {view.where}", "finite numbers")


def expect_in_bounds(view: StepView, final: bool = False) -> None:
    """Raise Violation if an observation is outside the bounds of its sensor."""
    for sensor, values in view.observations(final):
        flat = values.reshape(len(values), -1).astype(np.float64)
        size = flat.shape[1]
        for bounds, sign, side in ((sensor.low, 1, "at least"), (sensor.high, -1, "at most")):
            if len(bounds) in (1, size):
                bad = sign * flat < sign * np.array(bounds)
                if bad.any():
                    limit = np.broadcast_to(np.array(bounds), flat.shape)[bad][:1]
                    got = f"{flat[bad][:1]} from sensor {sensor.name!r} of {view.where}"
                    raise Violation(got, f"{side} {limit}")


def expect_masks(view: StepView) -> None:
    """Raise Violation unless the masks match the branches and allow at least one choice per lane."""
    masks, branches = view.message.masks, view.behavior.device.branches
    expect(len(masks) in (0, len(branches)), f"{len(masks)} masks of {view.where}", f"0 or {len(branches)}")
    for index, (mask, branch) in enumerate(zip(masks, branches, strict=False)):
        what = f"mask of {branch.name!r} of {view.where}"
        expect_tensor(mask, pb.DTYPE_BOOL, (view.lanes, len(branch.choices)), what)
        stuck = np.flatnonzero(~view.allowed(index).any(axis=1))
        got = f"no allowed choice of {branch.name!r} in lanes {stuck.tolist()} of {view.where}"
        expect(not stuck.size, got, "at least one allowed choice")


def expect_deciding(view: StepView) -> None:
    """Raise Violation unless deciding is absent or has one flag per lane."""
    if view.message.HasField("deciding"):
        expect_tensor(view.message.deciding, pb.DTYPE_BOOL, (view.lanes,), f"deciding of {view.where}")


def expect_flags(view: StepView) -> None:
    """Raise Violation unless terminated and truncated have one flag per lane."""
    expect_tensor(view.message.terminated, pb.DTYPE_BOOL, (view.lanes,), f"terminated of {view.where}")
    expect_tensor(view.message.truncated, pb.DTYPE_BOOL, (view.lanes,), f"truncated of {view.where}")


def expect_rewards(view: StepView) -> None:
    """Raise Violation unless rewards have one row per lane and one column per channel."""
    shape = (view.lanes, len(view.behavior.channels))
    expect_tensor(view.message.rewards, pb.DTYPE_FLOAT32, shape, f"rewards of {view.where}")


def expect_finite_rewards(view: StepView) -> None:
    """Raise Violation if a reward is NaN or infinite."""
    if (rewards := view.rewards) is not None:
        expect(np.isfinite(rewards).all(), f"rewards {rewards.tolist()} of {view.where}", "finite numbers")


def expect_no_ends(view: StepView) -> None:
    """Raise Violation if a step reports the end of an episode."""
    expect(not view.ended.any(), f"ended lanes {np.flatnonzero(view.ended).tolist()} of {view.where}", "none")
    expect(not view.message.HasField("ended"), f"the field ended of {view.where}", "no such field")


def expect_no_rewards(view: StepView) -> None:
    """Raise Violation if a reward is not 0."""
    rewards = view.rewards
    expect(rewards is None or not rewards.any(), f"rewards {rewards} of {view.where}", "zeros")


# Of every step: observations, rewards, flags, masks and deciding are well-formed and within bounds.
VALID = (
    expect_observations,
    expect_finite,
    expect_in_bounds,
    expect_rewards,
    expect_flags,
    expect_finite_rewards,
    expect_masks,
    expect_deciding,
)
