"""Demonstrations as targets of policies: what each policy would have had to do, and what it cannot express."""

from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.demonstrations.files import chosen_demonstrations, load_demonstration
from joybridge.demonstrations.of_games import load_translated
from joybridge.demonstrations.recorded import Demonstration
from joybridge.demonstrations.returns import Demonstrated, discounted_returns
from joybridge.demonstrations.shown_pictures import Numbered, gather_pictures, number_pictures
from joybridge.layouts import Layout
from joybridge.layouts.conditions import Conditions
from joybridge.layouts.targets import covers
from joybridge.policy.actor import Actor
from joybridge.policy.encoder import FrameStack
from joybridge.policy.lineup import Lineup
from joybridge.policy.policy import Policy
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.memory import Sequences, cut
from joybridge.ppo.observation_tensors import Observations
from joybridge.v1 import bridge_pb2 as pb


def demonstrate(
    policies: Sequence[Policy], config: Config, run: Path, spec: pb.GameSpec, lineup: Lineup | None, *, resumed: bool
) -> Iterator[str]:
    """Give all policies what the demonstrations of a configuration show them; yield remarks.

    lineup: of the games, if there are several. Raises ConfigError if there is nothing to learn, RecordingError and
    StorageError.
    """
    if config.demonstrations is None:
        return
    files, remarks = chosen_demonstrations(Path(config.demonstrations), run, resumed=resumed)
    yield from remarks
    shown = [load_translated(file, lineup) if lineup else load_demonstration(file, spec) for file in files]
    yield from filter(None, (demonstration.remark() for demonstration in shown))
    for policy in policies:
        wanted = targets(policy.actor, shown, config, lineup)
        if wanted.unsaid and wanted.actions is None:
            raise ConfigError(wanted.remark)
        policy.demonstrated = wanted.actions
        yield wanted.remark
    if all(policy.demonstrated is None for policy in policies):
        raise ConfigError(f"demonstrations: {config.demonstrations} holds no decision of a finished episode")


class Targets(NamedTuple):
    """What a policy clones of what is demonstrated to it."""

    actions: Demonstrated | None  # None: nothing is shown to it
    remark: str
    unsaid: int = 0  # decisions that its layout cannot express, beside the actions


def targets(actor: Actor, shown: Sequence[Demonstration], config: Config, lineup: Lineup | None = None) -> Targets:
    """Return what a policy clones. lineup: of the games, if there are several. Raises ConfigError."""
    if config.pointer == "velocity":
        raise ConfigError("pointer: demonstrations show places of the pointer, not movements; clone without `pointer`")
    if any(hand.delay for hand in config.hands):
        raise ConfigError(
            "hand.delay: demonstrations show what the device got, so a policy that clones them would be late twice; "
            "clone without `hand.delay`"
        )
    if actor.config.scale_observations == "running":
        raise ConfigError(
            f"scale_observations: the moments of {actor.name} change in training, so demonstrations cannot be scaled "
            "alike; set it to bounds or none"
        )
    numbered = number_pictures([part for demonstration in shown for part in demonstration.stretches], actor.behavior)
    begun = count()  # episodes
    of_stretches = [demonstration.kind for demonstration in shown for _ in demonstration.stretches]
    by_kind = [
        (kind, part)
        for kind, stretch in zip(of_stretches, numbered, strict=True)
        for part in _decisions(actor, stretch, begun)
    ]
    kinds = np.repeat([kind for kind, _ in by_kind], [len(part.sources) for _, part in by_kind])
    found = [part for _, part in by_kind]
    if not found:
        return Targets(None, f"{actor.name}: no decision of a finished episode is demonstrated")
    numbers, sources, episodes_of, returns, axes, choices = (
        np.concatenate(parts)
        for parts in zip(
            *((p.numbers, p.sources, p.episodes, p.returns, p.act.axes, p.act.choices) for p in found), strict=True
        )
    )
    masks = None
    if any(part.masks is not None for part in found):
        device = shown[0].spec.behaviors[actor.behavior].device
        masks = [
            _join_masks([p.masks for p in found], [len(p.sources) for p in found], i, len(branch.choices))
            for i, branch in enumerate(device.branches)
        ]
    act, layout = ActArrays(axes, choices), actor.layout
    continuous, discrete = layout.read(act)
    device = shown[0].spec.behaviors[actor.behavior].device
    said, moved = _compare(layout, device, act, continuous, discrete, masks)
    episodes = len(np.unique(episodes_of))
    remark = f"{actor.name}: {int(said.sum()):,} decisions of {episodes:,} episodes are cloned"
    if lineup:
        of_games = [len(np.unique(episodes_of[kinds == kind])) for kind in range(len(lineup.games))]
        remark += (
            f" ({', '.join(f'{number:,} of {game}' for number, game in zip(of_games, lineup.games, strict=True))})"
        )
    if not said.any():
        none = (
            f"demonstrations: {config.layout} can say none of the {len(said):,} decisions that are demonstrated to "
            f"{actor.name}; choose another layout, such as hybrid, which can express all"
        )
        return Targets(None, none, len(said))
    if not said.all():
        remark += f"; {int((~said).sum()):,} are left out, because {config.layout} cannot make these presses"
    if len(moved) and moved[said].max() > 1e-6:
        remark += (
            f"; axes are moved to the nearest value of {config.layout}, by {moved[said].mean():.1%} of their range on "
            f"average, {moved[said].max():.1%} at most"
        )
    rows = np.flatnonzero(said)
    if actor.network.state_size:  # the decisions of an episode side by side
        rows = rows[np.argsort(episodes_of[rows], kind="stable")]
    additions = _additions(layout, masks, discrete)
    own = [torch.from_numpy(np.ascontiguousarray(part[rows])) for part in (continuous, discrete)]
    pictures = gather_pictures(actor.encoder, numbered, actor.behavior, sources[rows])
    seen = Observations(torch.from_numpy(numbers[rows]), pictures)
    masked = None if additions is None else torch.from_numpy(additions[rows])
    conditions = lineup.conditions(layout, kinds[rows], only_with=True) if lineup else Conditions(layout, device)
    counts = torch.from_numpy(conditions.counts(choices[rows])) if conditions else None
    earned = torch.from_numpy(returns[rows])
    learned = Demonstrated(seen, own[0], own[1], masked, earned, counts=counts)
    if actor.network.state_size:
        begins, lengths, parts = cut(episodes_of[rows], actor.config.memory.length)
        states = np.zeros((len(begins), actor.network.state_size), np.float32)
        learned.sequences = Sequences(*map(torch.from_numpy, (begins, lengths, states, parts)))
    return Targets(learned.to(actor.accelerator), remark, int((~said).sum()))


class _Shown(NamedTuple):
    """What some lanes decide at one time."""

    numbers: Array  # what they see but images, float32 [rows, frame_stack x numbers]
    sources: Array  # the numbers of the pictures that they see, [rows, frame_stack]
    episodes: Array  # the number of the episode of each, [rows]
    returns: Array  # of each, [rows]
    act: ActArrays
    masks: Sequence[Array] | None


def _decisions(actor: Actor, numbered: Numbered, begun: Iterator[int]) -> Iterator[_Shown]:
    """Yield what is demonstrated in a stretch, one decision after the other. begun: numbers the episodes."""
    index, stretch, frames = actor.behavior, numbered.stretch, actor.config.frame_stack
    ends = stretch.ends(index)
    if not len(ends):  # a dataset is of another behavior
        return
    numbers, sources = FrameStack(len(ends), actor.encoder.size, frames), FrameStack(len(ends), 1, frames, np.int64)
    numbers.begin(actor.see(stretch.steps[0][index].observations).numbers)
    sources.begin(numbered.numbers(0))
    past = np.zeros((len(ends), actor.past.size), np.float32)
    episodes = np.array([next(begun) for _ in ends])
    returns = discounted_returns(stretch, index, actor.encoder.rewards, actor.config.gamma)
    for number, act in enumerate(stretch.acts):
        lanes = stretch.demonstrated(number, index) & (number <= ends)
        if lanes.any():
            masks = stretch.steps[number][index].masks
            own = None if masks is None else [mask[lanes] for mask in masks]
            done = ActArrays(act[index].axes[lanes], act[index].choices[lanes])
            seen = np.concatenate([past[lanes], numbers.now[lanes]], axis=1)
            yield _Shown(seen, sources.now[lanes], episodes[lanes], returns[number, lanes], done, own)
        past = actor.past.note(past, act[index], stretch.steps[number][index].deciding)
        after = stretch.steps[number + 1][index]
        actor.past.settle(past, actor.encoder.rewards(after), after)
        numbers.push(actor.see(after.observations).numbers, after)
        sources.push(numbered.numbers(number + 1), after)
        episodes[after.ended] = [next(begun) for _ in after.ended]


def _join_masks(parts: Sequence[Sequence[Array] | None], rows: Sequence[int], branch: int, choices: int) -> Array:
    """Return the masks of one branch, bool [rows, choices]; where there are none, all choices are allowed."""
    masks = [np.ones((n, choices), bool) if part is None else part[branch] for part, n in zip(parts, rows, strict=True)]
    return np.concatenate(masks)


def _compare(
    layout: Layout,
    device: pb.Device,
    wanted: ActArrays,
    continuous: Array,
    discrete: Array,
    masks: Sequence[Array] | None,
) -> tuple[Array, Array]:
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
