"""An exported policy, `policy.json` or `policy.onnx`, in seats: read as data, checked against the game, and played.

It needs onnxruntime, which computes the graph of an ONNX model and runs no code of a file.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnxruntime as ort
from pydantic import BaseModel

from joybridge.config.errors import ConfigError
from joybridge.config.json_files import reason_of
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.files import read_file
from joybridge.contract.sharding import rows_of
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.contract.text import printable
from joybridge.policy.document import FORMAT, Document, decode
from joybridge.policy.onnx_model import build_model, check_operators
from joybridge.v1 import bridge_pb2 as pb

MAX_FILE_BYTES = 1 << 28  # bytes
NOISE = ("normal", "uniform")


class SensorAbout(BaseModel):
    """A sensor that a policy sees."""

    name: str
    dtype: str
    shape: list[int]


class AxisAbout(BaseModel):
    """An axis that a policy moves."""

    name: str
    low: float
    high: float


class BranchAbout(BaseModel):
    """A branch that a policy chooses in."""

    name: str
    choices: list[str]


class About(BaseModel):
    """What an exported policy says of itself: the parts of its document that are compared with a game."""

    game: str
    options: dict[str, str]
    timesteps: int = 0  # that it was trained for, a remark
    behavior: str
    sensors: list[SensorAbout]
    axes: list[AxisAbout]
    branches: list[BranchAbout]


class Model:
    """An exported model that plays in some lanes, as a program without the trainer would."""

    def __init__(self, model: bytes, behavior: pb.Behavior, lanes: int) -> None:
        """Begin new episodes. model: of `build_model`, serialized."""
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4  # what is wrong with a file is said once, by the error
        # Its way to go on after an error prints, and tries the same once more.
        self._session = ort.InferenceSession(model, options, providers=["CPUExecutionProvider"], enable_fallback=0)
        self.inputs = {value.name: value.shape[1:] for value in self._session.get_inputs()}
        self.about: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        self._outputs = [value.name for value in self._session.get_outputs()]
        self._behavior = behavior
        self.kept = {name: np.zeros((lanes, *self.inputs.get(name, [0])), np.float32) for name in ("state", "memory")}
        self.begins = np.ones(lanes, bool)

    def begin(self) -> None:
        """Begin new episodes."""
        self.begins[:] = True
        for values in self.kept.values():
            values[:] = 0.0

    def act(self, step: StepArrays, normal: Array, uniform: Array, held: Array | None = None) -> ActArrays:
        """Return the actions for a step; keep `state` of lanes that decide or begin, `memory` of those that decide.

        held: the lanes of the step, by their numbers; None: all.
        """
        device, lanes = self._behavior.device, np.arange(len(self.begins)) if held is None else held
        sensors = [f"sensor.{sensor.name}" for sensor in self._behavior.sensors]
        feeds = dict(zip(sensors, step.observations, strict=True))
        masks = masks_of(step, self._behavior)
        feeds |= {f"mask.{branch.name}": mask for branch, mask in zip(device.branches, masks, strict=True)}
        feeds |= {name: values[lanes] for name, values in self.kept.items()} | {"normal": normal, "uniform": uniform}
        given = {name: feeds[name] for name in self.inputs}
        result = dict(zip(self._outputs, self._session.run(None, given), strict=True))
        deciding = step.decides
        for name, rows in (("state", self.begins[lanes] | deciding), ("memory", deciding)):
            if f"next_{name}" in result:
                self.kept[name][lanes[rows]] = result[f"next_{name}"][rows]
        empty = np.zeros((len(lanes), 0))
        return ActArrays(result.get("axes", empty.astype(np.float32)), result.get("choices", empty.astype(np.int32)))

    def store(self, after: StepArrays, held: Array | None = None) -> None:
        """Take what followed in some lanes, or in all: episodes that end start over."""
        lanes = np.arange(len(self.begins)) if held is None else held
        self.begins[lanes] = after.ends
        for values in self.kept.values():
            values[self.begins] = 0.0


def masks_of(step: StepArrays, behavior: pb.Behavior) -> list[Array]:
    """Return the masks of a step, bool [lanes, choices] per branch."""
    if step.masks is not None:
        return step.masks
    return [np.ones((len(step.rewards), len(branch.choices)), bool) for branch in behavior.device.branches]


class Exported:
    """An exported policy of a behavior, which may play in seats of several tables."""

    def __init__(self, content: bytes, where: str, spec: pb.GameSpec) -> None:
        """Read the content of a file. where: names it in errors. Raises ConfigError unless it fits a game."""
        self.where, self._spec = where, spec
        self._read(content)

    def _read(self, content: bytes) -> None:
        self._content, where, spec = content, self.where, self._spec
        about, self._model = read_exported(content, where)
        if problem := _misfit(about, spec):
            raise ConfigError(f"{where} does not fit {spec.name}: {problem}")
        self.name = about.behavior
        self.behavior = [behavior.name for behavior in spec.behaviors].index(self.name)
        self._behavior = spec.behaviors[self.behavior]
        try:
            self.seat(1).try_out()
        except ConfigError:
            raise
        except Exception as error:
            reason = printable(f"{type(error).__name__}: {reason_of(error)}")[:300]
            raise ConfigError(f"{where} cannot play: {reason}; export it again") from error

    def seat(self, lanes: int) -> "ExportedPlayer":
        """Return what plays in so many lanes."""
        return ExportedPlayer(self, Model(self._model, self._behavior, lanes), self._behavior)

    def state(self) -> dict[str, Array]:
        """Return the content of the file, for a checkpoint."""
        return {"file": np.frombuffer(self._content, np.uint8).copy()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned; who is seated already keeps the file that it has. Raises ConfigError."""
        self._read(state["file"].tobytes())


class ExportedPlayer:
    """An exported policy in seats of a table."""

    rng: np.random.Generator

    def __init__(self, exported: Exported, model: Model, behavior: pb.Behavior) -> None:
        """model: in all lanes of the behavior."""
        self.name, self.behavior, self.seed = exported.name, exported.behavior, 0
        self._where, self._model, self._kind = exported.where, model, behavior

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        self._model.begin()
        self._see_first(step, np.arange(len(step.rewards)))

    def act(self, step: StepArrays, act: ActArrays, held: Array) -> None:
        """Write actions into some lanes, by their numbers. Raises ConfigError if the file acts as no agent may."""
        mine, device = rows_of(step, held), self._kind.device
        normal = self.rng.standard_normal((len(held), self._columns("normal")), np.float32)
        uniform = self.rng.random((len(held), self._columns("uniform")), np.float32)
        own = self._model.act(mine, normal, uniform, held)
        low, high = (np.array([getattr(axis, end) for axis in device.axes], np.float32) for end in ("low", "high"))
        fine = ((own.axes >= low) & (own.axes <= high)).all()
        for column, mask in zip(own.choices.T, masks_of(mine, self._kind), strict=True):
            known = (column >= 0) & (column < mask.shape[1])
            fine = fine and known.all() and mask[np.arange(len(mask)), column].all()
        if not fine:
            raise ConfigError(
                f"{self._where} does what its device or a mask forbids: it is damaged, or masks leave it no choice; "
                "play its run instead"
            )
        act.axes[held], act.choices[held] = own.axes, own.choices

    def store(self, step: StepArrays, held: Array) -> None:
        """Take what followed in some lanes."""
        self._model.store(rows_of(step, held), held)
        self._see_first(step, held[step.ends[held]])

    def _see_first(self, step: StepArrays, lanes: Array) -> None:
        """See the first observations of episodes in which an agent waits: with them its frame stack begins."""
        if step.deciding is None or "state" not in self._model.inputs:
            return
        if len(waiting := lanes[~step.deciding[lanes]]):
            normal, uniform = (np.zeros((len(waiting), self._columns(name)), np.float32) for name in NOISE)
            self._model.act(rows_of(step, waiting), normal, uniform, waiting)

    def _columns(self, noise: str) -> int:
        columns: int = self._model.inputs.get(noise, [0])[0]
        return columns

    def try_out(self) -> None:
        """Play one decision of one lane that sees zeros. Raises ConfigError, and whatever a damaged file leads to."""
        seen = [np.zeros((1, *sensor.shape), NUMPY_TYPES[sensor.dtype]) for sensor in self._kind.sensors]
        nothing, device = np.zeros(1, bool), self._kind.device
        step = StepArrays(seen, np.zeros((1, len(self._kind.channels)), np.float32), nothing, nothing)
        act = ActArrays(np.zeros((1, len(device.axes)), np.float32), np.zeros((1, len(device.branches)), np.int32))
        self.rng = np.random.default_rng(0)
        self.act(step, act, np.zeros(1, np.int64))

    def state(self, held: Array) -> dict[str, Array]:
        """Return copies of what it remembers of some lanes, for a checkpoint."""
        kept = {name: values[held].copy() for name, values in self._model.kept.items()}
        return {**kept, "begins": self._model.begins[held].copy()}

    def load(self, state: dict[str, Array], held: Array) -> None:
        """Take back what `state` returned."""
        for name, values in self._model.kept.items():
            values[held] = state[name]
        self._model.begins[held] = state["begins"]


def load_exported(path: Path, spec: pb.GameSpec) -> Exported:
    """Read an exported policy. Raises ConfigError unless it fits a game."""
    return Exported(read_policy_file(path), str(path), spec)


def read_policy_file(path: Path) -> bytes:
    """Return the content of a file. Raises ConfigError."""
    try:
        return read_file(path, MAX_FILE_BYTES)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read: {printable(str(error))}") from error


def read_exported(content: bytes, where: str) -> tuple[About, bytes]:
    """Return what an exported policy says of itself, and its ONNX model.

    content: of a policy.json or a policy.onnx. where: names it in errors. Raises ConfigError.
    """
    try:
        if content.lstrip()[:1] == b"{":
            document = decode(content)
            _check_format(document, where)
            content = build_model(document).SerializeToString()
        check_operators(content)
        document = json.loads(Model(content, pb.Behavior(), 0).about["joybridge"])
        _check_format(document, where)
        return About.model_validate(document), content
    except ConfigError:
        raise
    except Exception as error:  # whatever is wrong with a file, it is one sentence
        reason = printable(f"{type(error).__name__}: {reason_of(error)}")[:300]
        raise ConfigError(
            f"{where} is no exported policy: {reason}; write one with `joybridge export RUN policy.json`"
        ) from error


def _check_format(document: Document, where: str) -> None:
    if document["format"] != FORMAT:
        form = printable(str(document["format"]))[:100]
        raise ConfigError(f"{where} does not fit: its format is {form}, expected {FORMAT}; export it again")


def _misfit(about: About, spec: pb.GameSpec) -> str:
    """Return what about a policy does not fit a game, "" if it fits."""
    behaviors = {behavior.name: behavior for behavior in spec.behaviors}
    if about.behavior not in behaviors:
        return f"it plays {printable(about.behavior)[:100]}, and the game has {', '.join(behaviors)}"
    behavior = behaviors[about.behavior]
    sensors = {one.name: (NUMPY_TYPES[one.dtype].name, list(one.shape)) for one in behavior.sensors}
    for sensor in about.sensors:
        if sensors.get(sensor.name) != (sensor.dtype, sensor.shape):
            return f"the sensor {printable(sensor.name)[:100]} is not the same"
    axes = [AxisAbout(name=axis.name, low=axis.low, high=axis.high) for axis in behavior.device.axes]
    branches = [BranchAbout(name=branch.name, choices=list(branch.choices)) for branch in behavior.device.branches]
    return _device_misfit("axes", axes, about.axes) or _device_misfit("branches", branches, about.branches)


def _device_misfit(
    kind: str, ours: Sequence[AxisAbout | BranchAbout], trained: Sequence[AxisAbout | BranchAbout]
) -> str:
    """Return how parts of the game's device differ from those that a policy was trained with, "" if they do not."""
    if ours == trained:
        return ""
    names, others = [part.name for part in ours], [part.name for part in trained]
    differ = "" if names != others else " and other choices or ranges"
    return printable(f"it has the {kind} {names}, the policy was trained with {others}")[:400] + differ
