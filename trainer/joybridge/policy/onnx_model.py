"""An exported policy as an ONNX model: from the sensors of a game to its axes and choices, in one graph.

Inputs, each with one row per lane:

    sensor.NAME    as the game sends it
    mask.NAME      bool [lanes, choices], for each branch of the device; all true if the game sends no masks
    state          float32 [lanes, numbers]: `next_state` of the lane's last decision, zeros in a new episode
    memory         float32 [lanes, numbers]: `next_memory` of the same; not of an observation with which a lane waits
    normal         float32 [lanes, Gaussians]: standard normal noise
    uniform        float32 [lanes, branches of the policies]: noise in [0, 1)

Outputs: `axes` float32 [lanes, axes], `choices` int32 [lanes, branches], `next_state` and `next_memory`. What has no
columns is left out: `state` without a frame stack, `memory` without a recurrent layer, noise if the policy is
deterministic, `axes` if the device has none.

Only operators of opset 17 and 32-bit numbers are used, which every runtime has.
"""

import json
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

from joybridge.contract.tensors import Array
from joybridge.contract.versions import own_version
from joybridge.layouts import CLIP
from joybridge.policy.document import Document
from joybridge.ppo.convolutions import FAINT
from joybridge.ppo.distributions import FORBIDDEN

OPSET, IR_VERSION = 17, 8
LANES = "lanes"  # the name of the first size of all inputs and outputs
BELOW_ONE = np.nextafter(np.float32(1), np.float32(0))
TYPES = {
    "float32": TensorProto.FLOAT,
    "int32": TensorProto.INT32,
    "uint8": TensorProto.UINT8,
    "bool": TensorProto.BOOL,
}
OPERATORS = {
    "Abs", "Add", "And", "ArgMax", "Cast", "Clip", "Concat", "Conv", "CumSum", "Div", "Elu", "Flatten", "Gather",
    "GatherElements", "Gemm", "Greater", "Identity", "Less", "LessOrEqual", "MatMul", "MaxPool", "Min", "Mul",
    "ReduceSum", "Relu", "Reshape", "Sigmoid", "Slice", "Softmax", "Sub", "Tanh", "Transpose", "Where",
}  # fmt: skip


def build_model(document: Document) -> onnx.ModelProto:
    """Return the model of a document of `make_document`."""
    builder = _Builder(document)
    graph = helper.make_graph(builder.nodes, document["behavior"], builder.inputs, builder.outputs, builder.constants)
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(graph, opset_imports=[opset], ir_version=IR_VERSION, producer_name=own_version().product)
    about = {key: value for key, value in document.items() if key != "policies"}
    helper.set_model_props(model, {"joybridge": json.dumps(about, ensure_ascii=False)})
    onnx.checker.check_model(model, full_check=True)
    return model


def check_operators(model: bytes) -> None:
    """Raise ValueError for a model that repeats, branches, calls others, or reads other files, as none of ours does."""
    loaded = onnx.load_model_from_string(model)
    graph = loaded.graph
    if unknown := sorted({node.op_type for node in graph.node} - OPERATORS):
        raise ValueError(f"it has the operator {unknown[0]}, which no exported policy has")
    outside = any(node.domain for node in graph.node) or any(one.external_data for one in graph.initializer)
    if outside or graph.sparse_initializer or loaded.functions:  # which may have external data, too
        raise ValueError("it needs something outside itself, which no exported policy does")


class _Builder:
    """The inputs, nodes, constants and outputs of a model. Methods add nodes and return the names of their results."""

    def __init__(self, document: Document) -> None:
        self.inputs: list[onnx.ValueInfoProto] = []
        self.outputs: list[onnx.ValueInfoProto] = []
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self._axes, self._branches = document["axes"], document["branches"]
        self._ranges: dict[str, int] = {}  # how many columns of `state`, `normal` and `uniform` are in use
        self._deterministic = document["deterministic"]
        self._shapes = {sensor["name"]: sensor["shape"] for sensor in document["sensors"]}
        sensors = {
            sensor["name"]: self._input(f"sensor.{sensor['name']}", sensor["dtype"], sensor["shape"])
            for sensor in document["sensors"]
        }
        self._frames = {
            name: self._node("Flatten", self._node("Cast", value, to=TensorProto.FLOAT))
            for name, value in sensors.items()
        }
        self._masks = [
            self._input(f"mask.{branch['name']}", "bool", [len(branch["choices"])]) for branch in self._branches
        ]
        axes, choices = [""] * len(self._axes), [""] * len(self._masks)  # each [lanes, 1]
        self._images: list[list[str]] = []  # of the present policy: each of its images after each step of its encoder
        self._next: dict[str, list[str]] = {"state": [], "memory": []}  # what follows these inputs
        for policy in document["policies"]:
            self._play(policy, axes, choices)
        for name in ("state", "memory", "normal", "uniform"):
            if name in self._ranges:
                self._input(name, "float32", [self._ranges[name]])
        if axes:
            self._output("axes", "float32", len(axes), self._side_by_side(axes))
        if choices:
            self._output("choices", "int32", len(choices), self._cast(self._side_by_side(choices), "int32"))
        for name, values in self._next.items():
            if values:
                self._output(f"next_{name}", "float32", self._ranges[name], self._side_by_side(values))

    def _play(self, policy: Document, axes: list[str], choices: list[str]) -> None:
        """Add one policy: its columns of `axes` and `choices`, and what it remembers."""
        outputs = self._network(policy, self._observe(policy))
        row = 0
        for table in policy["discrete"]:
            places = table.get("places", [])
            size = sum(place["channels"] for place in places) or len(table["values"])
            logits = self._columns(outputs, row, size)
            choice = self._choose(table, self._point(places, logits) if places else logits)
            row += size
            if "axis" in table:
                axes[table["axis"]] = self._node("Gather", self._constant(table["values"]), choice)
                continue
            for branch, values in zip(table["branches"], zip(*table["values"], strict=True), strict=True):
                choices[branch] = self._node("Gather", self._constant(values, np.int64), choice)
            for axis, positions in zip(
                table.get("axes", ()), zip(*table.get("positions", ()), strict=True), strict=True
            ):
                axes[axis] = self._node("Gather", self._constant(positions), choice)
        if targets := policy["continuous"]:
            sample = self._columns(outputs, row, len(targets))
            if not self._deterministic:
                noise = self._node("Mul", self._take("normal", len(targets)), self._constant(policy["deviations"]))
                sample = self._node("Add", sample, noise)
            clipped = self._node("Clip", sample, self._constant(-CLIP), self._constant(CLIP))
            shares = self._node("Div", clipped, self._constant(CLIP))
            for column, target in enumerate(targets):
                share = self._columns(shares, column, 1)
                if target.get("squashed"):
                    share = self._node("Tanh", self._columns(sample, column, 1))
                if "axis" in target:
                    axes[target["axis"]] = self._move(share, self._axes[target["axis"]])
                else:
                    choices[target["branch"]] = self._press(share, target)

    def _observe(self, policy: Document) -> str:
        """Return what the dense layers of a policy get, and keep what it sees again in the next decision."""
        frames = policy["frame_stack"]
        parts = []
        self._images = []
        if policy["sensors"]:
            frame = self._side_by_side([self._frames[name] for name in policy["sensors"]])
            size = sum(math.prod(self._shapes[name]) for name in policy["sensors"])
            parts.append(self._stack(self._scale(policy, frame), size, frames))
        for image in policy["images"]:
            height, width, channels = image["shape"]
            pixels = self._frames[image["sensor"]]
            stack = self._stack(pixels, height * width * channels, frames)
            value = self._reshape(stack, [-1, frames, height, width, channels])
            value = self._node("Transpose", value, perm=[0, 1, 4, 2, 3])
            value = self._reshape(value, [-1, frames * channels, height, width])
            value = self._node("Div", value, self._constant(image["white"]))
            self._images.append(self._encode(image["steps"], policy["activation"], value))
            parts.append(self._node("Flatten", self._images[-1][-1]))
            parts += [self._moments(self._images[-1][one["step"]], one["grid"]) for one in image.get("moments", ())]
        return self._side_by_side(parts)

    def _moments(self, image: str, grid: Array) -> str:
        """Return x, y and mass of what each channel of an image [lanes, channels, height, width] finds."""
        x, y = grid
        masses = self._reshape(self._node("Mul", image, image), [0, 0, len(x)])
        mass = self._node("ReduceSum", masses, self._constant([2], np.int64), keepdims=0)
        places = [self._node("MatMul", masses, self._constant(row)) for row in (x, y)]
        total = self._node("Add", mass, self._constant(FAINT))
        share = self._node("Div", mass, self._node("Add", mass, self._constant(1)))
        return self._side_by_side([*(self._node("Div", place, total) for place in places), share])

    def _stack(self, newest: str, size: int, frames: int) -> str:
        """Return the last frames or pictures side by side, oldest first; all but the oldest are remembered."""
        if frames == 1:
            return newest
        older = size * (frames - 1)
        stack = self._side_by_side([self._take("state", older), newest])
        self._next["state"].append(self._columns(stack, size, older))
        return stack

    def _scale(self, policy: Document, frame: str) -> str:
        if scaling := policy.get("scaling"):
            frame = self._node("Sub", frame, self._constant(scaling["shift"]))
            frame = self._node("Mul", frame, self._constant(scaling["scale"]))
            if limit := scaling.get("limit"):
                frame = self._node("Clip", frame, self._constant(-limit), self._constant(limit))
        return frame

    def _encode(self, steps: list[Document], activation: str, value: str) -> list[str]:
        """Return an image [lanes, channels, height, width] after each of the steps of an encoder."""
        after = []
        for step in steps:
            if step["kind"] == "activation":
                value = self._activate(activation, value)
            elif step["kind"] == "residual":
                value = self._node("Add", value, self._encode(step["steps"], activation, value)[-1])
            else:
                window = {
                    "kernel_shape": step["size"],
                    "strides": [step["stride"]] * 2,
                    "pads": [step["padding"]] * 4,
                }
                if step["kind"] == "convolution":
                    weight, bias = self._constant(step["weight"]), self._constant(step["bias"])
                    value = self._node("Conv", value, weight, bias, **window)
                else:
                    value = self._node("MaxPool", value, **window)
            after.append(value)
        return after

    def _point(self, places: list[Document], wanted: str) -> str:
        """Return the logits of the cells of a map. wanted: a weight for each channel of each of its places."""
        begin, logits = 0, ""
        for place in places:
            weight = self._reshape(self._columns(wanted, begin, place["channels"]), [-1, place["channels"], 1, 1])
            image = self._images[place["image"]][place["step"]]
            found = self._node("ReduceSum", self._node("Mul", image, weight), self._constant([1], np.int64), keepdims=0)
            part = self._node("MatMul", self._node("Flatten", found), self._constant(place["weight"].T))
            logits = self._node("Add", logits, part) if logits else part
            begin += place["channels"]
        return logits

    def _network(self, policy: Document, value: str) -> str:
        for number, layer in enumerate(policy["layers"]):
            if number:
                value = self._activate(policy["activation"], value)
            if "memory" in policy and layer is policy["layers"][-1]:
                value = self._remember(policy["memory"], value)
            value = self._dense(layer, value)
        return value

    def _dense(self, layer: Document, value: str) -> str:
        return self._node("Gemm", value, self._constant(layer["weight"]), self._constant(layer["bias"]), transB=1)

    def _remember(self, memory: Document, value: str) -> str:
        """Return what a recurrent layer puts out, and keep its state."""
        size = memory["state"]["weight"].shape[1]
        last = self._take("memory", size)
        given, kept = self._dense(memory["input"], value), self._dense(memory["state"], last)
        if memory["kind"] == "gru":
            (reset, update, new), (by_reset, by_update, by_new) = (
                self._split(gates, size, 3) for gates in (given, kept)
            )
            reset = self._node("Sigmoid", self._node("Add", reset, by_reset))
            update = self._node("Sigmoid", self._node("Add", update, by_update))
            new = self._node("Tanh", self._node("Add", new, self._node("Mul", reset, by_new)))
            # (1 - update) new + update last
            out = self._node("Add", new, self._node("Mul", update, self._node("Sub", last, new)))
            self._next["memory"].append(out)
            return out
        write, keep, new, show = self._split(self._node("Add", given, kept), size, 4)
        kept_cells = self._node("Mul", self._node("Sigmoid", keep), self._take("memory", size))
        written = self._node("Mul", self._node("Sigmoid", write), self._node("Tanh", new))
        cells = self._node("Add", kept_cells, written)
        out = self._node("Mul", self._node("Sigmoid", show), self._node("Tanh", cells))
        self._next["memory"] += [out, cells]
        return out

    def _split(self, gates: str, size: int, count: int) -> list[str]:
        return [self._columns(gates, size * gate, size) for gate in range(count)]

    def _activate(self, activation: str, value: str) -> str:
        if activation == "swish":
            return self._node("Mul", value, self._node("Sigmoid", value))
        return self._node(activation.capitalize(), value)  # Tanh, Relu or Elu

    def _choose(self, table: Document, logits: str) -> str:
        """Return the chosen row of a table, int64 [lanes, 1]; masked rows are never chosen."""
        if "branches" in table:
            allowed = ""
            for branch, values in zip(table["branches"], zip(*table["values"], strict=True), strict=True):
                part = self._node("Gather", self._masks[branch], self._constant(values, np.int64), axis=1)
                allowed = self._node("And", allowed, part) if allowed else part
            if allowed:  # a joint table of axes alone has no masks
                logits = self._node("Where", allowed, logits, self._constant(FORBIDDEN))
        if self._deterministic:
            return self._node("ArgMax", logits, axis=1, keepdims=1)
        # The number of cumulative probabilities up to the noise, which is scaled as their sum is only about 1.
        sums = self._node("CumSum", self._node("Softmax", logits, axis=1), self._constant(1, np.int64))
        uniform = self._node("Min", self._take("uniform", 1), self._constant(BELOW_ONE))
        level = self._node("Mul", uniform, self._columns(sums, len(table["values"]) - 1, 1))
        passed = self._cast(self._node("LessOrEqual", sums, level), "int64")
        return self._node("ReduceSum", passed, self._constant([1], np.int64), keepdims=1)

    def _move(self, share: str, axis: Document) -> str:
        """Return the value of an axis at a share in -1..1 of its range."""
        low, high = axis["low"], axis["high"]
        moved = self._node("Mul", share, self._constant((high - low) / 2))
        value = self._node("Add", moved, self._constant((low + high) / 2))
        return self._node("Clip", value, self._constant(low), self._constant(high))

    def _press(self, share: str, target: Document) -> str:
        """Return the choice of a branch at a share in -1..1, or the first allowed one, int64 [lanes, 1]."""
        mask, threshold = self._masks[target["branch"]], target.get("threshold")
        if threshold is None:
            count = len(self._branches[target["branch"]]["choices"])
            part = self._node("Div", self._node("Add", share, self._constant(1)), self._constant(2))
            index = self._cast(self._node("Mul", part, self._constant(count)), "int64")
            choice = self._node("Min", index, self._constant(count - 1, np.int64))
        elif threshold == 0:
            choice = self._cast(self._node("Greater", share, self._constant(0)), "int64")
        else:
            choice = self._cast(self._node("Less", self._node("Abs", share), self._constant(threshold)), "int64")
        first = self._node("ArgMax", self._cast(mask, "int32"), axis=1, keepdims=1)
        return self._node("Where", self._node("GatherElements", mask, choice, axis=1), choice, first)

    # ------------------------------------------------------------------------------------------------- small parts

    def _node(self, operator: str, *inputs: str, **attributes: Any) -> str:
        assert operator in OPERATORS, operator  # else nobody could read the model
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def _constant(self, values: npt.ArrayLike, dtype: npt.DTypeLike = np.float32) -> str:
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.array(values, dtype), name))
        return name

    def _input(self, name: str, dtype: str, shape: list[int]) -> str:
        self.inputs.append(helper.make_tensor_value_info(name, TYPES[dtype], [LANES, *shape]))
        return name

    def _output(self, name: str, dtype: str, columns: int, value: str) -> None:
        self.outputs.append(helper.make_tensor_value_info(name, TYPES[dtype], [LANES, columns]))
        self.nodes.append(helper.make_node("Identity", [value], [name]))

    def _take(self, name: str, count: int) -> str:
        """Return the next columns of an input that the policies share."""
        begin = self._ranges.get(name, 0)
        self._ranges[name] = begin + count
        return self._columns(name, begin, count)

    def _columns(self, value: str, begin: int, count: int) -> str:
        bounds = [self._constant([number], np.int64) for number in (begin, begin + count, 1)]
        return self._node("Slice", value, *bounds)

    def _side_by_side(self, values: list[str]) -> str:
        return self._node("Concat", *values, axis=1)

    def _reshape(self, value: str, shape: list[int]) -> str:
        return self._node("Reshape", value, self._constant(shape, np.int64))

    def _cast(self, value: str, dtype: str) -> str:
        return self._node("Cast", value, to=TensorProto.INT64 if dtype == "int64" else TYPES[dtype])
