"""Demonstrations as targets of policies: what each policy would have had to do, and what it cannot say."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.demonstrations.files import chosen_demonstrations, load_demonstration
from joybridge.demonstrations.recorded import Demonstration
from joybridge.layouts import Layout
from joybridge.layouts.targets import covers
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import Stacks
from joybridge.policy.policy import Policy
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.loss import Actions
from joybridge.ppo.memory import Sequences, cut
from joybridge.ppo.observation import Observation, join
from joybridge.ppo.observation_tensors import to_tensors
from joybridge.v1 import bridge_pb2 as pb


def demonstrate(
    policies: Sequence[Policy], config: Config, run: Path, spec: pb.GameSpec, *, resumed: bool
) -> Iterator[str]:
    """Give all policies what the demonstrations of a configuration show them; yield remarks.

    Raises ConfigError if there is nothing to learn, RecordingError and StorageError.
    """
    if config.demonstrations is None:
        return
    files, remarks = chosen_demonstrations(Path(config.demonstrations), run, resumed=resumed)
    yield from remarks
    shown = [load_demonstration(file, spec) for file in files]
    yield from filter(None, (demonstration.remark() for demonstration in shown))
    for policy in policies:
        if policy.config.scale_observations == "running":
            raise ConfigError(
                f"scale_observations: the moments of {policy.actor.name} change in training, so demonstrations cannot "
                "be scaled alike; set it to bounds or none"
            )
        policy.demonstrated, remark = targets(policy.actor, shown, config)
        yield remark
    if all(policy.demonstrated is None for policy in policies):
        raise ConfigError(f"demonstrations: {config.demonstrations} holds no decision of a finished episode")


def targets(actor: Actor, shown: Sequence[Demonstration], config: Config) -> tuple[Actions | None, str]:
    """Return what a policy clones, None if nothing is shown to it, and a remark. Raises ConfigError."""
    found = list(_decisions(actor, shown))
    if not found:
        return None, f"{actor.name}: no decision of a finished episode is demonstrated"
    episodes_of = np.concatenate([part[4] for part in found])
    observations = join([part[0] for part in found])
    axes, choices = (np.concatenate([part[i] for part in found]) for i in (1, 2))
    masks = None
    if any(part[3] is not None for part in found):
        device = shown[0].spec.behaviors[actor.behavior].device
        masks = [_join_masks([part[3] for part in found], [len(part[1]) for part in found], i, len(branch.choices))
                 for i, branch in enumerate(device.branches)]  # fmt: skip
    act, layout = ActArrays(axes, choices), actor.layout
    continuous, discrete = layout.read(act)
    device = shown[0].spec.behaviors[actor.behavior].device
    said, moved = _compare(layout, device, act, continuous, discrete, masks)
    episodes = sum(demonstration.episodes(actor.behavior)[0] for demonstration in shown)
    remark = f"{actor.name}: {int(said.sum()):,} decisions of {episodes:,} episodes are cloned"
    if not said.any():
        raise ConfigError(
            f"demonstrations: {config.layout} can say none of the {len(said):,} decisions that are demonstrated to "
            f"{actor.name}; choose another layout, as hybrid, which can say all"
        )
    if not said.all():
        remark += f"; {int((~said).sum()):,} are left out, because {config.layout} cannot press what they press"
    if len(moved) and moved[said].max() > 1e-6:
        remark += (
            f"; axes are moved to the nearest value of {config.layout}, by {moved[said].mean():.1%} of their range on "
            f"average, {moved[said].max():.1%} at most"
        )
    additions = _additions(layout, masks, discrete)
    own = [torch.from_numpy(np.ascontiguousarray(part[said])) for part in (continuous, discrete)]
    seen = to_tensors(observations.rows(said), torch.device("cpu"))
    masked = None if additions is None else torch.from_numpy(additions[said])
    learned = Actions(observations=seen, continuous=own[0], discrete=own[1], masks=masked)
    if actor.network.state_size:
        learned = _in_sequences(actor, learned, episodes_of[said])
    return learned.to(actor.accelerator), remark


def _in_sequences(actor: Actor, actions: Actions, episodes: Array) -> Actions:
    """Return actions with the rows of each episode side by side, as sequences."""
    order = np.argsort(episodes, kind="stable")
    begins, lengths, parts = cut(episodes[order], actor.config.memory.length)
    states = np.zeros((len(begins), actor.network.state_size), np.float32)
    ordered = actions.rows(torch.from_numpy(order))
    ordered.sequences = Sequences(*map(torch.from_numpy, (begins, lengths, states, parts)))
    return ordered


def _decisions(
    actor: Actor, shown: Sequence[Demonstration]
) -> Iterator[tuple[Observation, Array, Array, Sequence[Array] | None, Array]]:
    """Yield observations, axes, choices, masks and numbers of episodes of all lanes that a decision is demonstrated in.

    Decisions of an episode have the same number, and the earlier one is yielded first.
    """
    index, begun = actor.behavior, 0
    for stretch in (stretch for demonstration in shown for stretch in demonstration.stretches):
        ends, first = stretch.ends(index), stretch.steps[0][index]
        if not len(ends):  # a dataset is of another behavior
            continue
        stack = Stacks(actor.encoder, len(ends), actor.config.frame_stack)
        stack.begin(actor.see(first.observations))
        episodes = begun + np.arange(len(ends))
        begun += len(ends)
        for number, act in enumerate(stretch.acts):
            lanes = stretch.demonstrated(number, index) & (number <= ends)
            if lanes.any():
                masks = stretch.steps[number][index].masks
                own = None if masks is None else [mask[lanes] for mask in masks]
                yield stack.now.rows(lanes), act[index].axes[lanes], act[index].choices[lanes], own, episodes[lanes]
            after = stretch.steps[number + 1][index]
            episodes[after.ended] = begun + np.arange(len(after.ended))
            begun += len(after.ended)
            stack.push(actor.see(after.observations), after)


def _join_masks(parts: Sequence[Sequence[Array] | None], rows: Sequence[int], branch: int, choices: int) -> Array:
    """Return the masks of one branch, bool [rows, choices]; where there are none, all choices are allowed."""
    masks = [np.ones((n, choices), bool) if part is None else part[branch] for part, n in zip(parts, rows, strict=True)]
    return np.concatenate(masks)


def _compare(
    layout: Layout, device: pb.Device, wanted: ActArrays, continuous: Array, discrete: Array,
    masks: Sequence[Array] | None,
) -> tuple[Array, Array]:  # fmt: skip
    """Return whether a layout presses what was pressed, bool [rows], and how far it moves axes, [rows, axes].

    The second is in shares of their ranges.
    """
    got = ActArrays(wanted.axes.copy(), wanted.choices.copy())
    layout.write(continuous, discrete, got, masks)
    own = sorted({axis for part in (*layout.continuous, *layout.discrete) for axis in covers(part)[0]})
    span = np.array([device.axes[axis].high - device.axes[axis].low for axis in own], np.float32)
    moved = np.abs(got.axes - wanted.axes)[:, own] / span if own else np.zeros(0)
    return (got.choices == wanted.choices).all(axis=1), moved


def _additions(layout: Layout, masks: Sequence[Array] | None, discrete: Array) -> Array | None:
    """Return what to add to the logits, [rows, branches, widest]; None where all choices are allowed."""
    if masks is None:
        return None
    additions = np.zeros((*discrete.shape, layout.space.widest), np.float32)
    fill_masks(layout.masks(masks), additions)
    return additions
