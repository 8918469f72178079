"""Which policies play a game under a layout, and arrays for their actions."""

from typing import NamedTuple

import numpy as np

from joybridge.contract.codec import ActArrays, lane_count
from joybridge.layouts.layout import Layout
from joybridge.layouts.mixed import check_names, make_layouts
from joybridge.v1 import bridge_pb2 as pb


class Role(NamedTuple):
    """What one policy plays: a behavior, or a part of its device."""

    name: str  # of the policy
    behavior: int  # index in the spec
    layout: Layout


def list_roles(layout: str, spec: pb.GameSpec) -> list[Role]:
    """Return the roles of all policies that play a game with a layout. Raises ConfigError."""
    check_names(layout, spec)
    return [
        Role(_policy_name(behavior.name, part, alone=len(spec.behaviors) == 1), index, made)
        for index, behavior in enumerate(spec.behaviors)
        for part, made in make_layouts(layout, behavior.device, behavior.name).items()
    ]


def _policy_name(behavior: str, part: str, *, alone: bool) -> str:
    """Return the name of the policy that holds `part` ("": all) of a behavior's device."""
    if not part:
        return behavior
    return part if alone else f"{behavior}-{part}"


def make_acts(spec: pb.GameSpec, arenas: int) -> list[ActArrays]:
    """Return arrays for the actions of all lanes, at rest: axes as near to 0 as they go, first choices."""
    acts = []
    for behavior in spec.behaviors:
        lanes, device = lane_count(behavior, arenas), behavior.device
        rest = np.array([min(max(0.0, axis.low), axis.high) for axis in device.axes], np.float32)
        acts.append(ActArrays(np.tile(rest, (lanes, 1)), np.zeros((lanes, len(device.branches)), np.int32)))
    return acts
