"""Export: the policy of a run as one file that plays one behavior of a game, checked against the trainer."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import onnxruntime as ort

from joybridge.config.errors import ExportError
from joybridge.config.files import storing, write_atomically
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.play.onnx_model import build_model
from joybridge.play.playing import Play, open_play
from joybridge.play.policy_document import decode, encode, make_document
from joybridge.policy.config_fit import find_behavior
from joybridge.v1 import bridge_pb2 as pb

ARENAS, DECISIONS = 8, 128  # that are compared
TOLERANCE = 1e-5  # of the range of an axis
TIES = 1000  # one decision in so many may differ: rounding decides between choices that are equally likely


@dataclass
class Comparison:
    """How an exported policy plays beside the trainer."""

    decisions: int = 0
    different: int = 0  # decisions with another choice, or an axis that differs by more than TOLERANCE
    largest: float = 0.0  # difference of an axis in the other decisions, as a share of its range
    forbidden: int = 0  # choices that their mask forbids

    def add(self, ours: ActArrays, theirs: ActArrays, device: pb.Device, masks: Sequence[Array], rows: Array) -> None:
        """Compare actions in some rows. theirs: of the trainer. masks: bool [lanes, choices] per branch."""
        ranges = np.array([axis.high - axis.low for axis in device.axes], np.float32)
        apart = (np.abs(ours.axes - theirs.axes) / ranges)[rows].max(axis=1, initial=0.0)
        same = (apart <= TOLERANCE) & (ours.choices == theirs.choices)[rows].all(axis=1)
        self.decisions += len(same)
        self.different += int((~same).sum())
        self.largest = max(self.largest, float(apart[same].max(initial=0.0)))
        for branch, mask in enumerate(masks):
            self.forbidden += int((~mask[np.arange(len(mask)), ours.choices[:, branch]])[rows].sum())


class Exported:
    """A model that plays in some lanes, as a program without the trainer would."""

    def __init__(self, model: bytes, behavior: pb.Behavior, lanes: int) -> None:
        """Begin new episodes. model: of `build_model`, serialized."""
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1
        self._session = ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        self.inputs = {value.name: value.shape[1:] for value in self._session.get_inputs()}
        self._outputs = [value.name for value in self._session.get_outputs()]
        self._behavior, self._lanes = behavior, lanes
        self._state = np.zeros((lanes, *self.inputs.get("state", [0])), np.float32)
        self._begins = np.ones(lanes, bool)

    def act(self, step: StepArrays, normal: Array, uniform: Array) -> ActArrays:
        """Return the actions for a step and keep the state of lanes that decide or begin an episode."""
        device = self._behavior.device
        sensors = [f"sensor.{sensor.name}" for sensor in self._behavior.sensors]
        feeds = dict(zip(sensors, step.observations, strict=True))
        feeds |= {f"mask.{branch.name}": mask for branch, mask in zip(device.branches, self.masks(step), strict=True)}
        feeds |= {"state": self._state, "normal": normal, "uniform": uniform}
        given = {name: feeds[name] for name in self.inputs}
        result = dict(zip(self._outputs, self._session.run(None, given), strict=True))
        if "next_state" in result:
            seen = slice(None) if step.deciding is None else self._begins | step.deciding
            self._state[seen] = result["next_state"][seen]
        empty = np.zeros((self._lanes, 0))
        return ActArrays(result.get("axes", empty.astype(np.float32)), result.get("choices", empty.astype(np.int32)))

    def store(self, after: StepArrays) -> None:
        """Take what followed: episodes that end begin anew."""
        self._begins = after.terminated | after.truncated
        self._state[self._begins] = 0.0

    def masks(self, step: StepArrays) -> list[Array]:
        """Return the masks of a step, bool [lanes, choices] per branch."""
        if step.masks is not None:
            return step.masks
        return [np.ones((self._lanes, len(branch.choices)), bool) for branch in self._behavior.device.branches]


def export(
    run: Path, address: str, output: Path, *, behavior: str, seed: int, deterministic: bool,
    overrides: Sequence[str] = (), checkpoint: str = "",
) -> str:  # fmt: skip
    """Write the policies that play one behavior of a run into one file; return what was written, in words.

    output: its suffix is .onnx or .json. behavior: its name; "" if the game has one. Before it is written, the
    content plays beside the trainer at the simulator at `address`. overrides: "key=value" each, options and parameters
    of the game that differ from the training. checkpoint: "best", its timesteps, or "" for the newest. Raises
    SimulatorError, CheckpointError, ConfigError, StorageError and ExportError; then nothing is written.
    """
    with open_play(
        run, address, seed=seed, episodes=ARENAS, arenas_limit=ARENAS, deterministic=deterministic, overrides=overrides,
        checkpoint=checkpoint,
    ) as play:  # fmt: skip
        index = find_behavior(play.spec, behavior, "--behavior")
        actors = [player.actor for player in play.players if player.actor.behavior == index]
        if play.config.pointer == "velocity":
            raise ExportError(
                "with `pointer: velocity` the trainer remembers where the pointer is, and exported files do not; play "
                "the policy with joybridge.play.agent, or train it with axes that move the pointer"
            )
        for actor in actors:
            if actor.config.network:
                raise ExportError(
                    f"{actor.name} has a network of its own, {actor.config.network}, which no exported file can hold; "
                    "export a policy without `network`, or play it with joybridge.play"
                )
        about = {
            "game": play.spec.name, "options": play.config.options, "layout": play.config.layout,
            "timesteps": play.timesteps,
        }  # fmt: skip
        data = encode(make_document(actors, play.spec.behaviors[index], deterministic=deterministic, about=about))
        model = build_model(decode(data)).SerializeToString(deterministic=True)
        found = compare(model, play, index)
    if found.forbidden or found.different > 1 + found.decisions // TIES:
        raise ExportError(
            f"{output}: the exported policy differs from the trainer in {found.different} of {found.decisions} "
            f"decisions and makes {found.forbidden} forbidden choices, so nothing is written; please report this"
        )
    with storing(output):
        output.parent.mkdir(parents=True, exist_ok=True)
    content = model if output.suffix == ".onnx" else data
    write_atomically(output, content)
    ties = f", {found.different} ties excepted" if found.different else ""
    return (
        f"{output}: {len(content) / 1000:.0f} kB; it plays {found.decisions:,} decisions as the trainer does{ties}, "
        f"axes within {found.largest:.0e} of their range"
    )


def compare(model: bytes, play: Play, index: int) -> Comparison:
    """Let an exported model watch the trainer play one behavior, and compare its actions with the trainer's."""
    behavior, found = play.spec.behaviors[index], Comparison()
    players = [player for player in play.players if player.actor.behavior == index]
    exported = Exported(model, behavior, players[0].lanes)
    for decision in islice(play.decisions(), DECISIONS):
        before = decision.before[index]
        normal = np.concatenate([player.noise.normal for player in players], axis=1)
        uniform = np.concatenate([player.noise.uniform for player in players], axis=1)
        acts = exported.act(before, normal, uniform)
        rows = np.ones(players[0].lanes, bool) if before.deciding is None else before.deciding
        found.add(acts, decision.acts[index], behavior.device, exported.masks(before), rows)
        exported.store(decision.after[index])
    return found
