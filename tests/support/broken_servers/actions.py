"""Servers that take what they must refuse, or ignore what counts."""

import numpy as np

from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers.gauntlet import Gauntlet
from tests.support.broken_servers.serving import Honest, broken, change, floats


def acts(request):
    return [act for act in request.act.behaviors if act.axes.dtype == pb.DTYPE_FLOAT32 and act.axes.data]


@broken("axis_without_its_choice_has_no_effect")
class EveryAxisCounts(Gauntlet):
    def force(self, player):
        return player.axes[:, 1:]


@broken("nan_axis_is_refused", "infinite_axis_is_refused")
class NotANumberIsZero(Honest):
    def request(self, request):
        for act in acts(request):
            if len(act.axes.data) == 4 * np.prod(act.axes.shape):
                change(act.axes, np.where(np.isfinite(floats(act.axes)), floats(act.axes), np.float32(0.5)))
        return request


@broken(
    "axis_above_high_is_refused",
    "axis_below_low_is_refused",
    "axis_far_out_of_range_is_refused",
    "invalid_action_in_the_last_lane_is_refused",
)
class ClipsAxes(Honest):
    def request(self, request):
        for act in acts(request):
            shape = list(act.axes.shape)
            if len(shape) == 2 and shape[1] <= 2 and len(act.axes.data) == 4 * np.prod(shape):
                values = floats(act.axes)
                low = np.array([-1.0, 0.5][: shape[1]], np.float32)
                high = np.array([1.0, 2.0][: shape[1]], np.float32)
                change(act.axes, np.where(np.isfinite(values), np.clip(values, low, high), values))
        return request


@broken("masked_choice_is_refused")
class ForgetsItsMasks(Honest):
    def _unpack(self, act):
        for previous in self.previous:
            previous.masks = None
        return super()._unpack(act)


@broken("choices_of_another_dtype_are_refused")
class AnyDtypeOfChoices(Honest):
    def request(self, request):
        for act in request.act.behaviors:
            if act.choices.dtype == pb.DTYPE_FLOAT32:
                act.choices.dtype = pb.DTYPE_INT32
                act.choices.data = np.frombuffer(act.choices.data, "<f4").astype("<i4").tobytes()
        return request


@broken("extra_behavior_is_refused")
class IgnoresExtraBehaviors(Honest):
    def request(self, request):
        if request.HasField("act"):
            del request.act.behaviors[3:]
        return request


@broken(
    "actions_of_lanes_that_a_script_plays_are_ignored",
    "script_after_the_last_is_refused",
    "negative_script_is_refused",
    "scripts_with_an_extra_lane_are_refused",
    "scripts_of_another_dtype_are_refused",
)
class KnowsNoScripts(Honest):
    def request(self, request):
        for act in request.act.behaviors:
            act.ClearField("scripts")
        return request


@broken("scripts_of_0_leave_all_lanes_to_the_client")
class CountsScriptsFrom0(Gauntlet):
    def step(self, acts):
        for act in acts:
            if act.scripts is not None:
                act.scripts = np.minimum(act.scripts + 1, 2)
        return super().step(acts)
