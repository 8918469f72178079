"""What a policy thinks of what it observes, for people who watch it: values and the probabilities of its actions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from joybridge.contract.codec import StepArrays
from joybridge.layouts import CLIP, AxisTable, JointTable
from joybridge.policy.player import PolicyPlayer
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.observation_tensors import to_tensors
from joybridge.v1 import bridge_pb2 as pb

MAX_CHOICES = 12  # choices of a branch whose probabilities are shown, the likeliest


@torch.inference_mode()
def policy_outputs(player: PolicyPlayer, spec: pb.GameSpec, steps: Sequence[StepArrays]) -> dict[str, Any]:
    """Return the outputs of a policy for the present observations, for people: a value and probabilities per lane.

    A branch whose choices are places in an image has the chances of all of them, row after row, beside the likeliest.
    """
    actor = player.actor
    outputs = actor.network(to_tensors(player.observations, actor.accelerator))
    device = spec.behaviors[actor.behavior].device
    tables = [_labels(table, device) for table in actor.layout.discrete]
    maps = dict(actor.layout.space.maps)
    masks = np.zeros(outputs.logits.shape, np.float32)
    allowed = steps[actor.behavior].masks
    fill_masks(None if allowed is None else actor.layout.masks(allowed), masks)
    chances = torch.softmax(outputs.logits + torch.from_numpy(masks), -1)
    lanes = []
    for lane in range(player.lanes):
        branches = []
        for index, (name, labels) in enumerate(zip(actor.branches, tables, strict=True)):
            row = chances[lane, index].tolist()
            likeliest = sorted(range(len(labels)), key=row.__getitem__, reverse=True)[:MAX_CHOICES]
            choices = [{"label": labels[choice], "chance": row[choice]} for choice in sorted(likeliest)]
            branch: dict[str, Any] = {"name": name, "choices": choices}
            if places := maps.get(index):
                cells = [round(chance, 5) for chance in row[: places.height * places.width]]
                branch["map"] = {"height": places.height, "width": places.width, "chances": cells}
            branches.append(branch)
        axes = []
        if not actor.network.distributions:
            spread = torch.exp(0.5 * actor.network.log_variance).tolist()
            axes = [
                {"name": name, "mean": mean / CLIP, "deviation": deviation / CLIP}
                for name, mean, deviation in zip(actor.gaussians, outputs.mean[lane].tolist(), spread, strict=True)
            ]
        lanes.append({"value": float(outputs.value[lane]), "branches": branches, "axes": axes})
    return {"policy": actor.name, "lanes": lanes}


def _labels(table: AxisTable | JointTable, device: pb.Device) -> list[str]:
    """Return what each choice of a branch of a policy does."""
    if isinstance(table, AxisTable):
        return [f"{value:.2g}" for value in table.values.tolist()]
    labels = []
    for row, values in enumerate(table.values.tolist()):
        parts = []
        for branch, choice in zip(table.branches, values, strict=True):
            own = device.branches[branch]
            if len(own.choices) > 2:
                parts.append(own.choices[choice])
            elif choice:
                parts.append(own.name)
        if table.positions is not None:
            parts += [f"{value:.2g}" for value in table.positions[row].tolist()]
        labels.append(" + ".join(parts) or "none")
    return labels
