"""Valid acts to make invalid, for the checks that expect a refusal."""

from collections.abc import Iterator

import numpy as np

from joybridge.conformance.expectations import skip_unless
from joybridge.conformance.recording import act_request
from joybridge.conformance.subject import Subject
from joybridge.contract.codec import pack
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.v1 import bridge_pb2 as pb

PARTS = {"axes": "axes", "choices": "branches"}  # fields of BehaviorAct -> of Device


def acts_with(subject: Subject, field: str) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int, int]]:
    """Yield requests, a valid Act to send next, the index of a behavior that has `field`, and a deciding lane."""
    part = PARTS[field]
    behaviors = [index for index, kind in enumerate(subject.spec.behaviors) if getattr(kind.device, part)]
    skip_unless(behaviors, f"no device has {part}")
    for index in behaviors:
        prefix, act, lane = subject.acting(index)
        yield prefix, act, index, lane


def acts_of_each_behavior(subject: Subject) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int]]:
    """Yield requests, a valid Act to send next, and the index of a behavior that has a deciding lane."""
    for index in range(len(subject.spec.behaviors)):
        prefix, act, _ = subject.acting(index)
        yield prefix, act, index


def read(tensor: pb.Tensor) -> Array:
    """Return a copy of the values of a valid tensor."""
    return np.frombuffer(tensor.data, NUMPY_TYPES[tensor.dtype]).reshape(tuple(tensor.shape)).copy()


def changed(act: pb.Act, behavior: int, field: str, values: Array) -> pb.PlayRequest:
    """Return a request with a copy of an Act that has other axes or choices for one behavior."""
    request = act_request(act)
    getattr(request.act.behaviors[behavior], field).CopyFrom(pack(values))
    return request
