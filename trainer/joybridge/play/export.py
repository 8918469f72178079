"""Export: the policy of a run as one file that plays one behavior of a game, checked against the trainer."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from joybridge.config.errors import ExportError
from joybridge.config.files import storing, write_atomically
from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.layouts import list_roles
from joybridge.play.playing import Play, PlaySpec, open_play
from joybridge.policy.config_fit import find_behavior
from joybridge.policy.document import decode, encode, make_document
from joybridge.policy.exportable import export_refusal
from joybridge.policy.exported import Model, masks_of
from joybridge.policy.onnx_model import build_model
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


def export(plays: PlaySpec, output: Path, *, behavior: str) -> str:
    """Write the policies that play one behavior of a run into one file; return what was written, in words.

    output: its suffix is .onnx or .json. behavior: its name; "" if the game has one. Before it is written, the
    content plays beside the trainer at the simulator. Raises SimulatorError, CheckpointError, ConfigError,
    StorageError and ExportError; then nothing is written.
    """
    with open_play(plays, episodes=ARENAS, arenas_limit=ARENAS) as play:
        index = find_behavior(play.spec, behavior, "--behavior")
        actors = [player.actor for player in play.players if player.actor.behavior == index]
        for role in list_roles(play.config.layout, play.spec):
            if role.behavior == index and (reason := export_refusal(play.config, role)):
                raise ExportError(f"{role.name}: {reason}")
        about = {
            "game": play.spec.name,
            "options": play.config.options,
            "layout": play.config.layout,
            "timesteps": play.timesteps,
        }
        data = encode(make_document(actors, play.spec.behaviors[index], deterministic=plays.deterministic, about=about))
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
    axes = f", axes within {found.largest:.0e} of their range" if play.spec.behaviors[index].device.axes else ""
    size = f"{len(content) / 1000:.0f} kB"
    return f"{output}: {size}; it plays {found.decisions:,} decisions as the trainer does{ties}{axes}"


def compare(model: bytes, play: Play, index: int) -> Comparison:
    """Let an exported model watch the trainer play one behavior, and compare its actions with the trainer's."""
    behavior, found = play.spec.behaviors[index], Comparison()
    players = [player for player in play.players if player.actor.behavior == index]
    exported = Model(model, behavior, players[0].lanes)
    for decision in islice(play.decisions(), DECISIONS):
        before = decision.before[index]
        normal = np.concatenate([player.noise.normal for player in players], axis=1)
        uniform = np.concatenate([player.noise.uniform for player in players], axis=1)
        acts = exported.act(before, normal, uniform)
        rows = before.decides
        found.add(acts, decision.acts[index], behavior.device, masks_of(before, behavior), rows)
        exported.store(decision.after[index])
    return found
