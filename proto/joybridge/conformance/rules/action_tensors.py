"""Tensors of actions: a wrong shape, dtype or length is refused with INVALID_ARGUMENT and a text that names it."""

from collections.abc import Callable

import numpy as np

from joybridge.conformance.expectations import skip_unless
from joybridge.conformance.invalid_acts import PARTS, acts_of_each_behavior, acts_with, changed, read
from joybridge.conformance.recording import act_request
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import Subject
from joybridge.contract.codec import pack
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

Change = Callable[[pb.Tensor], pb.Tensor | None]


def _array(change: Callable[[Array], Array]) -> Change:
    """Return the change of a tensor that changes its array."""
    return lambda tensor: pack(np.ascontiguousarray(change(read(tensor))))


def _data(change: Callable[[bytes], bytes]) -> Change:
    """Return the change of a tensor that changes its data alone."""
    return lambda tensor: pb.Tensor(dtype=tensor.dtype, shape=tensor.shape, data=change(tensor.data))


OTHER_DTYPES = {"axes": lambda values: values.view(np.int32), "choices": lambda values: values.astype(np.float32)}
FORMS = {"axes": "Axes are FLOAT32", "choices": "Choices are INT32"}
TENSORS = [  # name, section, rule, field of BehaviorAct, how its tensor is changed
    (f"{field}_{name}_refused", section, rule, field, change)
    for field, form in FORMS.items()
    for shape, parts in [(f"{form} [lanes, {PARTS[field]}].", PARTS[field])]
    for name, section, rule, change in (
        ("with_a_missing_lane_are", "BehaviorAct", shape, _array(lambda values: values[:-1])),
        ("with_an_extra_lane_are", "BehaviorAct", shape, _array(lambda values: np.concatenate([values, values[:1]]))),
        ("with_an_extra_column_are", "BehaviorAct", shape,
         _array(lambda values: np.concatenate([values, values[:, :1]], axis=1))),
        ("with_one_dimension_are", "BehaviorAct", shape, _array(lambda values: values.reshape(-1))),
        ("of_another_dtype_are", "BehaviorAct",
         f"{form}; the server does not reinterpret or convert other types.", _array(OTHER_DTYPES[field])),
        ("without_a_dtype_are", "Dtype", "DTYPE_UNSPECIFIED is never valid.",
         lambda tensor: pb.Tensor(shape=tensor.shape, data=tensor.data)),
        ("with_a_missing_byte_are", "Tensor", "A tensor has exactly the bytes of its elements.",
         _data(lambda data: data[:-1])),
        ("with_extra_bytes_are", "Tensor", "A tensor has exactly the bytes of its elements.",
         _data(lambda data: data + bytes(4))),
    )
]  # fmt: skip
ABSENT = [  # name, section, rule, field of BehaviorAct, how its tensor is changed
    (
        f"missing_{field}_are_refused",
        "BehaviorAct",
        f"{field.capitalize()} are absent only if the device has no {part}.",
        field,
        lambda tensor: None,
    )
    for field, part in PARTS.items()
]
FOREIGN = [  # name, section, rule, field of BehaviorAct, its dtype
    (
        f"{field}_for_a_device_without_{PARTS[field]}_are_refused",
        "BehaviorAct",
        f"{field.capitalize()} are absent if the device has no {PARTS[field]}.",
        field,
        dtype,
    )
    for field, dtype in (("axes", np.float32), ("choices", np.int32))
]
BEHAVIORS = (  # name, section, rule, how the behaviors of an Act are changed
    (
        "missing_behavior_is_refused",
        "Act",
        "An Act has one BehaviorAct per behavior of the spec.",
        lambda behaviors: behaviors[:-1],
    ),
    (
        "extra_behavior_is_refused",
        "Act",
        "An Act has one BehaviorAct per behavior of the spec.",
        lambda behaviors: [*behaviors, behaviors[-1]],
    ),
)


@table([*TENSORS, *ABSENT])
def _tensor_is_refused(subject: Subject, field: str, change: Change) -> None:
    for prefix, act, index, _ in acts_with(subject, field):
        tensor = change(getattr(act.behaviors[index], field))
        act.behaviors[index].ClearField(field)
        if tensor is not None:
            getattr(act.behaviors[index], field).CopyFrom(tensor)
        subject.expect_refused(*prefix, act_request(act), words=[field])


@table(FOREIGN)
def _tensor_without_parts_is_refused(subject: Subject, field: str, dtype: type) -> None:
    without = [index for index, kind in enumerate(subject.spec.behaviors) if not getattr(kind.device, PARTS[field])]
    skip_unless(without, f"every device has {PARTS[field]}")
    for index in without:
        prefix, act, _ = subject.acting(index)
        lanes = subject.short_session.first[index].lanes
        subject.expect_refused(*prefix, changed(act, index, field, np.zeros((lanes, 1), dtype)), words=[field])


@check("Act")
def act_without_behaviors_is_refused(subject: Subject) -> None:
    """An Act has one BehaviorAct per behavior of the spec."""
    subject.expect_refused(subject.start(), act_request(pb.Act()), words=["behavior"])


@table(BEHAVIORS)
def _behaviors_are_refused(subject: Subject, change: Callable[[list[pb.BehaviorAct]], list[pb.BehaviorAct]]) -> None:
    for prefix, act, _ in acts_of_each_behavior(subject):
        invalid = pb.Act(behaviors=change(list(act.behaviors)))
        subject.expect_refused(*prefix, act_request(invalid), words=["behavior"])


@check("Act")
def behaviors_in_another_order_are_refused(subject: Subject) -> None:
    """An Act lists the behaviors in the order of the spec."""
    sizes = {(len(b.device.axes), len(b.device.branches), b.agents_per_arena) for b in subject.spec.behaviors}
    differ = len(sizes) == len(subject.spec.behaviors) > 1
    skip_unless(differ, "the game does not have several behaviors with tensors of different shapes")
    words = [behavior.name for behavior in subject.spec.behaviors]
    for prefix, act, _ in acts_of_each_behavior(subject):
        subject.expect_refused(*prefix, act_request(pb.Act(behaviors=reversed(act.behaviors))), words=words)
