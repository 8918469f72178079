"""An exported policy as plain data: everything that plays one behavior, and nothing that learns.

`onnx_model.py` builds an ONNX model from it. A JSON file is this document as it is, with each array as
`{"shape": [...], "float32": BASE64}`, little-endian and row-major. docs/exported-policies.md documents it.
"""

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from joybridge.config.errors import ExportError
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.layouts import AxisRange, AxisTable, JointTable, Split, Threshold
from joybridge.layouts.layout import SQUASHED
from joybridge.policy.actor import Actor
from joybridge.policy.scaling import LIMIT, Scaling
from joybridge.ppo.convolutions import Activate, Convolutions, DifferenceConvolution, ImageEncoder, Residual
from joybridge.ppo.memory import Memory
from joybridge.v1 import bridge_pb2 as pb

Document = dict[str, Any]

FORMAT = "joybridge.policy.v5"
MAX_EMPTY = 2**16  # of the sizes of an array without numbers, which a file of no size may claim to be of any


def make_document(actors: Sequence[Actor], behavior: pb.Behavior, *, deterministic: bool, about: Document) -> Document:
    """Return the policies that share the device of a behavior as one document.

    deterministic: it takes the likeliest actions instead of sampling. about: what else a reader may want to know.
    Raises ExportError for a layout that no file can hold.
    """
    for part in (part for actor in actors for part in actor.layout.continuous if isinstance(part, AxisRange)):
        axis = behavior.device.axes[part.axis]
        if (part.low, part.high) != (axis.low, axis.high):  # which the formats do not say
            raise ExportError(
                f"its layout moves {axis.name!r} within {part.low:g}..{part.high:g} only, which no exported file can "
                "say; play its run with `joybridge.play.agent.load`"
            )
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
        "branches": [{"name": branch.name, "choices": list(branch.choices)} for branch in behavior.device.branches],
        "policies": [_policy(actor) for actor in actors],
    }


def encode(document: Document) -> bytes:
    """Return a document as a JSON file."""
    return json.dumps(document, default=_encode_array, indent=1, ensure_ascii=False).encode() + b"\n"


def decode(data: bytes) -> Document:
    """Return the document in a JSON file."""
    document: Document = json.loads(data, object_hook=_decode_array)
    return document


def _policy(actor: Actor) -> Document:
    """Return the network and the layout of one policy."""
    state, layout = actor.state(), actor.layout
    hidden = [
        {"weight": state[f"actor.hidden.{index}.weight"], "bias": state[f"actor.hidden.{index}.bias"]}
        for index in range(len(actor.config.hidden_sizes))
    ]
    places = _places(actor)
    return {
        "name": actor.name,
        "sensors": [sensor.name for sensor in actor.encoder.numbers],
        "images": _images(actor),
        "frame_stack": actor.config.frame_stack,
        "activation": actor.config.activation,
        **({} if actor.scaling is None else {"scaling": _scaling(actor.scaling)}),
        **({} if actor.network.actor.memory is None else {"memory": _memory(actor.network.actor.memory)}),
        "layers": [*hidden, _last_layer(actor)],
        "deviations": np.exp(0.5 * state["log_variance"].astype(float)).astype(np.float32),
        "discrete": [
            _table(table) | ({"places": places[branch]} if branch in places else {})
            for branch, table in enumerate(layout.discrete)
        ],
        "continuous": [_target(target) for target in layout.continuous],
    }


def _last_layer(actor: Actor) -> Document:
    """Return the last dense layer: neither padding nor a value.

    Its rows are the choices of the policy's branches, one branch after the other, then the means of its Gaussians. For
    a branch that is a map they are what it looks for: a weight for each channel of each of its places.
    """
    network, space = actor.network, actor.layout.space
    tower, mean_bias = network.actor.head.weight.numpy(force=True), network.mean_bias.numpy(force=True)
    head, wanted = tower, {}
    if (pointers := network.pointers) is not None:
        end = pointers.columns - pointers.shared
        begin = end - sum(pointers.wanted)
        for (branch, _), pointer in zip(space.maps, pointers.each, strict=True):
            bias = pointer.bias.numpy(force=True)
            wanted[branch] = tower[begin : begin + len(bias)], bias
            begin += len(bias)
        order = pointers.order.numpy(force=True)
        head = np.where(order[:, None] < len(tower), tower[np.minimum(order, len(tower) - 1)], 0)
    if network.sums is not None:  # ordinal logits are sums of outputs, so weights are added up once and for all
        head = network.sums.numpy(force=True).T @ head
    parts = []
    for branch, size in enumerate(space.branches):
        rows = head[branch * space.widest :][:size]
        parts.append(wanted.get(branch, (rows, np.zeros(size, np.float32))))
    padded = len(space.branches) * space.widest
    parts.append((head[padded : padded + space.continuous], mean_bias))
    weight, bias = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return {"weight": weight, "bias": bias}


def _places(actor: Actor) -> dict[int, list[Document]]:
    """Return what each branch that is a map sees of its cells: in each stage of each image, how much of each place."""
    pointers = actor.network.pointers
    if pointers is None:
        return {}
    found = {}
    for (branch, _), pointer in zip(actor.layout.space.maps, pointers.each, strict=True):
        found[branch] = [
            {
                "image": image,
                "step": _stage_ends(_body(actor, image), _blank(actor, image))[stage],
                "channels": channels,
                "weight": np.kron(pointer.get_buffer(f"rows{part}").cpu(), pointer.get_buffer(f"columns{part}").cpu()),
            }
            for part, (image, stage, channels) in enumerate(pointer.parts)
        ]
    return found


def _stage_ends(body: Convolutions, values: Tensor) -> list[int]:
    """Return the number of the last step of each stage of convolutions. values: any image."""
    counts = []
    for stage in body.stages:
        counts.append(len([*_steps([stage], values)]))
        values = stage(values)
    return [end - 1 for end in accumulate(counts)]


def _images(actor: Actor) -> list[Document]:
    """Return how the actor sees each of its images."""
    if not actor.network.encoders:
        return []
    documents = []
    for number, (name, image) in enumerate(actor.encoder.images.items()):
        body = _body(actor, number)
        steps = [*_steps([*body.stages, nn.Flatten(), *body.dense], _blank(actor, number))]
        document = {"sensor": name, "shape": [*image.shape], "white": body.white, "steps": steps}
        documents.append(document | _moments(body, _blank(actor, number)))
    return documents


def _moments(body: Convolutions, values: Tensor) -> Document:
    """Return after which steps moments are taken, and where the places of their maps are. values: any image."""
    if not body.moments:
        return {}
    ends = zip(_stage_ends(body, values), body.moments, strict=True)
    return {"moments": [{"step": step, "grid": each.get_buffer("grid")[:2].numpy(force=True)} for step, each in ends]}


def _body(actor: Actor, image: int) -> Convolutions:
    """Return what an image passes through; a second encoder is the critic's."""
    encoder = actor.network.encoders[0]
    assert isinstance(encoder, ImageEncoder)
    return encoder.bodies[image]


def _blank(actor: Actor, image: int) -> Tensor:
    """Return a stack of black pictures, [1, channels, height, width]."""
    form = _body(actor, image).image
    channels = form.channels * actor.config.frame_stack
    return torch.zeros(1, channels, form.height, form.width, device=actor.accelerator)


def _steps(layers: Iterable[nn.Module], values: Tensor) -> Iterator[Document]:
    """Yield what layers do to an image, step by step. values: any one, [1, channels, height, width].

    A dense layer is a convolution whose window is the whole image, so that a runtime needs nothing else.
    """
    shape = values.shape[1:]
    for layer in layers:
        match layer:
            case nn.Sequential():
                yield from _steps(layer, values)
            case DifferenceConvolution(convolution=nn.Conv2d() as inner):
                yield _convolution(layer.seen, inner.bias, inner.stride[0], int(inner.padding[0]))
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
        "kind": "convolution",
        "size": list(weight.shape[2:]),
        "stride": stride,
        "padding": padding,
        "weight": weight.numpy(force=True),
        "bias": bias.numpy(force=True),
    }


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
    array = np.frombuffer(base64.b64decode(value["float32"]), "<f4").reshape(value["shape"])
    if array.size == 0 and sum(array.shape) > MAX_EMPTY:
        raise ValueError(f"an array of shape {value['shape']} holds nothing")
    return array
