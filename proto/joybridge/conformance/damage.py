"""Legal acts with one thing made wrong in them, for the checks of illegal actions."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from joybridge.conformance.registry import DoesNotApply, needs
from joybridge.conformance.subject import Subject, act_request
from joybridge.contract.tensors import NUMPY_TYPES, Array, pack
from joybridge.v1 import bridge_pb2 as pb

KINDS = {"axes": pb.DTYPE_FLOAT32, "choices": pb.DTYPE_INT32}


def each_with(subject: Subject, field: str) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int, int]]:
    """Yield requests, a legal act after them, a behavior that has axes or choices, and a lane that decides."""
    what = "axes" if field == "axes" else "branches"
    behaviors = [index for index, kind in enumerate(subject.spec.behaviors) if getattr(kind.device, what)]
    needs(behaviors, f"no device has {what}")
    for index in behaviors:
        prefix, act, lane = subject.acting(index)
        yield prefix, act, index, lane


def each_behavior(subject: Subject) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int, int]]:
    """Yield requests, a legal act after them, every behavior in turn, and a lane that decides."""
    for index in range(len(subject.spec.behaviors)):
        prefix, act, lane = subject.acting(index)
        yield prefix, act, index, lane


def actions_of(act: pb.Act, behavior: int, field: str) -> Array:
    """Return a copy of some actions."""
    tensor = getattr(act.behaviors[behavior], field)
    return np.frombuffer(tensor.data, NUMPY_TYPES[KINDS[field]]).reshape(tuple(tensor.shape)).copy()


def refuse_axis(subject: Subject, value: Callable[[pb.Axis], np.float32], *words: str) -> None:
    """Expect a value of each axis to be refused, naming the axis or one of some other words."""
    for prefix, act, index, lane in each_with(subject, "axes"):
        good = actions_of(act, index, "axes")
        for place, axis in enumerate(subject.spec.behaviors[index].device.axes):
            if not math.isfinite(value(axis)) or not axis.low <= value(axis) <= axis.high:
                bad = good.copy()
                bad[lane, place] = value(axis)
                act.behaviors[index].axes.CopyFrom(pack(bad))
                subject.refused(*prefix, act_request(act), words=[axis.name, *words])


def refuse_choice(subject: Subject, value: Callable[[pb.Branch], int]) -> None:
    """Expect a value of each branch to be refused, naming the branch."""
    for prefix, act, index, lane in each_with(subject, "choices"):
        good = actions_of(act, index, "choices")
        for place, branch in enumerate(subject.spec.behaviors[index].device.branches):
            bad = good.copy()
            bad[lane, place] = value(branch)
            act.behaviors[index].choices.CopyFrom(pack(bad))
            subject.refused(*prefix, act_request(act), words=[branch.name])


def refuse_array(subject: Subject, field: str, damage: Callable[[Array], Array]) -> None:
    """Expect actions that were made another array to be refused by their field."""
    for prefix, act, index, _ in each_with(subject, field):
        values = damage(actions_of(act, index, field))
        getattr(act.behaviors[index], field).CopyFrom(pack(np.ascontiguousarray(values)))
        subject.refused(*prefix, act_request(act), words=[field])


def refuse_tensor(subject: Subject, field: str, damage: Callable[[pb.Tensor], pb.Tensor | None]) -> None:
    """Expect a damaged tensor, or none, to be refused by its field."""
    for prefix, act, index, _ in each_with(subject, field):
        tensor = damage(getattr(act.behaviors[index], field))
        act.behaviors[index].ClearField(field)
        if tensor is not None:
            getattr(act.behaviors[index], field).CopyFrom(tensor)
        subject.refused(*prefix, act_request(act), words=[field])


def refuse_surplus(subject: Subject, field: str, part: str) -> None:
    """Expect actions for which a device has nothing to be refused by their field."""
    without = [index for index, kind in enumerate(subject.spec.behaviors) if not getattr(kind.device, part)]
    if not without:
        raise DoesNotApply(f"every device has {part}")
    for index in without:
        prefix, act, _ = subject.acting(index)
        lanes = subject.brief.first[index].lanes
        getattr(act.behaviors[index], field).CopyFrom(pack(np.zeros((lanes, 1), NUMPY_TYPES[KINDS[field]])))
        subject.refused(*prefix, act_request(act), words=[field])
