"""An exported policy as plain data: everything that plays one behavior, and nothing that learns.

`onnx_model.py` builds an ONNX model from it. A JSON file is this document as it is, with each array as
`{"shape": [...], "float32": BASE64}`, little-endian and row-major. docs/exported-policies.md documents it.
"""

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from joybridge.config.errors import ExportError
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.layouts import AxisRange, AxisTable, JointTable, Split, Threshold
from joybridge.layouts.layout import GAUSSIAN, SQUASHED
from joybridge.policy.actor import Actor
from joybridge.policy.scaling import LIMIT, Scaling
from joybridge.ppo.convolutions import Activate, ImageEncoder, Residual
from joybridge.ppo.memory import Memory
from joybridge.v1 import bridge_pb2 as pb

Document = dict[str, Any]

FORMAT = "joybridge.policy.v5"


def make_document(actors: Sequence[Actor], behavior: pb.Behavior, *, deterministic: bool, about: Document) -> Document:
    """Return the policies that share the device of a behavior as one document.

    deterministic: it takes the likeliest actions instead of sampling. about: what else a reader may want to know.
    """
    seen = {sensor.name for actor in actors for sensor in actor.encoder.sensors}
    return {
        "format": FORMAT,
        **about,
        "behavior": behavior.name,
        "deterministic": deterministic,
        "sensors": [
            {"name": sensor.name, "dtype": NUMPY_TYPES[sensor.dtype].name, "shape": list(sensor.shape)}
            for sensor in behavior.sensors
            if sensor.name in seen
        ],
        "axes": [{"name": axis.name, "low": axis.low, "high": axis.high} for axis in behavior.device.axes],
        "branches": [
            {"name": branch.name, "choices": list(branch.choices)} for branch in behavior.device.branches
        ],
        "policies": [_policy(actor) for actor in actors],
    }  # fmt: skip


def encode(document: Document) -> bytes:
    """Return a document as a JSON file."""
    return json.dumps(document, default=_encode_array, indent=1, ensure_ascii=False).encode() + b"\n"


def decode(data: bytes) -> Document:
    """Return the document in a JSON file."""
    document: Document = json.loads(data, object_hook=_decode_array)
    return document


def _policy(actor: Actor) -> Document:
    """Return the network and the layout of one policy.

    The rows of the last layer are the choices of the policy's branches, one branch after the other, then the means of
    its Gaussians: neither padding nor a value.
    """
    state, space, layout = actor.state(), actor.layout.space, actor.layout
    if unknown := [name for name in space.distributions if name not in (GAUSSIAN, SQUASHED)]:
        names = ", ".join(dict.fromkeys(name.rpartition(":")[2] for name in unknown))
        raise ExportError(
            f"{actor.name}: axes are drawn from {names}, which cannot be exported; train it with another layout, "
            "such as squashed, hybrid or bucket-11"
        )
    if space.maps:
        raise ExportError(
            f"{actor.name}: layouts with a map point with convolutions, which cannot be exported; train it with "
            "another layout, such as bucket-11, or play it with the trainer"
        )
    branches, padded = len(space.branches), len(space.branches) * space.widest
    choices = [branch * space.widest + choice for branch in range(branches) for choice in range(space.branches[branch])]
    rows = [*choices, *range(padded, padded + space.continuous)]
    hidden = [
        {"weight": state[f"actor.hidden.{index}.weight"], "bias": state[f"actor.hidden.{index}.bias"]}
        for index in range(len(actor.config.hidden_sizes))
    ]
    head, sums = state["actor.head.weight"], actor.network.sums
    if sums is not None:  # ordinal logits are sums of outputs, so weights are added up once and for all
        head = sums.numpy(force=True).T @ head
    bias = np.concatenate([np.zeros(len(choices), np.float32), state["mean_bias"]])
    return {
        "name": actor.name,
        "sensors": [sensor.name for sensor in actor.encoder.numbers],
        "images": _images(actor),
        "frame_stack": actor.config.frame_stack,
        "activation": actor.config.activation,
        **({} if actor.scaling is None else {"scaling": _scaling(actor.scaling)}),
        **({} if actor.network.actor.memory is None else {"memory": _memory(actor.network.actor.memory)}),
        "layers": [*hidden, {"weight": head[rows], "bias": bias}],
        "deviations": np.exp(0.5 * state["log_variance"].astype(float)).astype(np.float32),
        "discrete": [_table(table) for table in layout.discrete],
        "continuous": [_target(target) for target in layout.continuous],
    }


def _images(actor: Actor) -> list[Document]:
    """Return how the actor sees each of its images."""
    if not actor.network.encoders:
        return []
    encoder, frames = actor.network.encoders[0], actor.config.frame_stack  # the other one is the critic's
    assert isinstance(encoder, ImageEncoder)
    documents = []
    for (name, image), body in zip(actor.encoder.images.items(), encoder.bodies, strict=True):
        blank = torch.zeros(1, image.channels * frames, image.height, image.width, device=actor.accelerator)
        steps = [*_steps([*body.stages, nn.Flatten(), *body.dense], blank)]
        documents.append({"sensor": name, "shape": [*image.shape], "white": body.white, "steps": steps})
    return documents


def _steps(layers: Iterable[nn.Module], values: Tensor) -> Iterator[Document]:
    """Yield what layers do to an image, step by step. values: any one, [1, channels, height, width].

    A dense layer is a convolution whose window is the whole image, so that a runtime needs nothing else.
    """
    shape = values.shape[1:]
    for layer in layers:
        match layer:
            case nn.Sequential():
                yield from _steps(layer, values)
            case nn.Conv2d():
                yield _convolution(layer.weight, layer.bias, layer.stride[0], int(layer.padding[0]))
            case nn.Flatten():
                shape = values.shape[1:]
            case nn.Linear():
                yield _convolution(layer.weight.view(-1, *shape), layer.bias, 1, 0)
            case nn.MaxPool2d():
                size, stride, padding = layer.kernel_size, layer.stride, layer.padding
                yield {"kind": "maximum", "size": [size, size], "stride": stride, "padding": padding}
            case Residual():
                yield {"kind": "residual", "steps": list(_steps([layer.layers], values))}
            case Activate():
                yield {"kind": "activation"}
        values = layer(values)


def _convolution(weight: Tensor, bias: Tensor | None, stride: int, padding: int) -> Document:
    assert bias is not None
    return {
        "kind": "convolution", "size": list(weight.shape[2:]), "stride": stride, "padding": padding,
        "weight": weight.numpy(force=True), "bias": bias.numpy(force=True),
    }  # fmt: skip


def _memory(memory: Memory) -> Document:
    """Return the recurrent layer in front of the last dense layer; the rows of its gates in PyTorch's order."""
    arrays = {name: weight.numpy(force=True) for name, weight in memory.layer.named_parameters()}
    return {
        "kind": memory.kind,
        "input": {"weight": arrays["weight_ih_l0"], "bias": arrays["bias_ih_l0"]},
        "state": {"weight": arrays["weight_hh_l0"], "bias": arrays["bias_hh_l0"]},
    }


def _scaling(scaling: Scaling) -> Document:
    document = {"shift": scaling.shift, "scale": scaling.scale}
    return document if scaling.moments is None else document | {"limit": LIMIT}


def _table(table: AxisTable | JointTable) -> Document:
    document: Document = {"values": table.values.tolist()}
    if isinstance(table, AxisTable):
        document = {"axis": table.axis, **document}
    else:
        document = {"branches": list(table.branches), **document}
        if table.positions is not None:
            document |= {"axes": list(table.axes), "positions": table.positions.tolist()}
    return document


def _target(target: AxisRange | Threshold | Split) -> Document:
    if isinstance(target, AxisRange):
        return {"axis": target.axis} | ({"squashed": True} if target.distribution == SQUASHED else {})
    if isinstance(target, Threshold):
        return {"branch": target.branch, "threshold": target.threshold}
    return {"branch": target.branch}


def _encode_array(array: Array) -> Document:
    data = np.ascontiguousarray(array, "<f4").tobytes()
    return {"shape": list(array.shape), "float32": base64.b64encode(data).decode()}


def _decode_array(value: Document) -> Document | Array:
    if set(value) != {"shape", "float32"}:
        return value
    return np.frombuffer(base64.b64decode(value["float32"]), "<f4").reshape(value["shape"])
