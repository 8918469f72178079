"""A policy that was exported into a file plays a game: policy.onnx and policy.json alike, by ONNX Runtime."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime as ort

from joybridge.client.client import Session
from joybridge.config.errors import ConfigError
from joybridge.contract.files import read_file
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.play.export import Exported
from joybridge.play.onnx_model import build_model
from joybridge.play.policy_document import FORMAT, Document, decode
from joybridge.policy.config_fit import find_behavior
from joybridge.v1 import bridge_pb2 as pb

MAX_BYTES = 2**30  # of a file


class PolicyFile(NamedTuple):
    """An exported policy: what it says about itself, which is its document without the networks, and its model."""

    about: Document
    model: bytes


def read_policy_file(path: Path) -> PolicyFile:
    """Return the policy in a file. Raises ConfigError if it is none."""
    try:
        data = read_file(path, MAX_BYTES)
        if path.suffix == ".json":
            about = decode(data)
            model = build_model(about).SerializeToString() if about["format"] == FORMAT else b""
        else:
            session = ort.InferenceSession(data, providers=["CPUExecutionProvider"])
            about, model = json.loads(session.get_modelmeta().custom_metadata_map["joybridge"]), data
        form = about["format"]
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:  # ONNX Runtime has errors of its own
        raise ConfigError(f"{path} is no exported policy; `joybridge export RUN {path.name}` writes one") from error
    if form != FORMAT:
        raise ConfigError(f"{path} has the format {form!r}, expected {FORMAT!r}; export the policy again")
    return PolicyFile(about, model)


def play_file(policy: PolicyFile, session: Session, seed: int) -> Iterator[tuple[float, bool]]:
    """Let an exported policy play the arena of a session; yield the reward of each decision, and whether it was last.

    seed: of the samples. Raises ConfigError if the game shows or controls other things, and SimulatorError.
    """
    index = find_behavior(session.spec, policy.about["behavior"], "the behavior of the policy")
    behavior = session.spec.behaviors[index]
    _check_fit(policy.about, session.spec, behavior)
    lanes, random = session.steps[index].terminated.shape[0], np.random.default_rng(seed)
    exported = Exported(policy.model, behavior, lanes)
    normal, uniform = (exported.inputs.get(name, [0])[0] for name in ("normal", "uniform"))
    while True:
        noise = random.standard_normal((lanes, normal), np.float32), random.random((lanes, uniform), np.float32)
        (step,) = session.step([exported.act(session.steps[index], *noise)])
        exported.store(step)
        yield float(step.rewards.sum()), bool(len(step.ended))


def _check_fit(about: Document, spec: pb.GameSpec, behavior: pb.Behavior) -> None:
    """Check that a behavior has the device of a policy, and the sensors that the policy sees."""
    sensors = {sensor.name: [NUMPY_TYPES[sensor.dtype].name, list(sensor.shape)] for sensor in behavior.sensors}
    for sensor in about["sensors"]:
        wanted = [sensor["dtype"], sensor["shape"]]
        if (found := sensors.get(sensor["name"])) != wanted:
            raise ConfigError(
                f"{spec.name} shows {sensor['name']} as {found or 'nothing'}, the policy was trained with {wanted}"
            )
    device = behavior.device
    for kind, ours in (("axes", device.axes), ("branches", device.branches)):
        names, wanted = [each.name for each in ours], [each["name"] for each in about[kind]]
        if names != wanted:
            raise ConfigError(f"{spec.name} has the {kind} {names}, the policy was trained with {wanted}")
