"""Cloning without a game: an actor learns from some of the demonstrated episodes and is measured on the others."""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.critic import fit_critic
from joybridge.demonstrations.episodes import Episode, finished_episodes, join_episodes
from joybridge.demonstrations.recorded import Demonstration
from joybridge.demonstrations.returns import Demonstrated
from joybridge.layouts.targets import covers
from joybridge.policy.actor import Actor
from joybridge.ppo.cloning import ROWS, add_cloning_gradient, cloning_loss, minibatches, refresh
from joybridge.ppo.fast.kernels import Noise
from joybridge.ppo.moments import Moments
from joybridge.ppo.sampling import sample_actions
from joybridge.ppo.update import Learner
from joybridge.v1 import bridge_pb2 as pb

HELD_OUT = 10  # one episode in so many
PATIENCE = 10  # passes without a smaller loss on held-out episodes, after which learning ends
LEAST = 0.01  # share of decisions, or of a range, below which nothing is to be learned


@dataclass(frozen=True)
class Shown:
    """What is demonstrated to one policy."""

    learned: Demonstrated
    held_out: Demonstrated | None  # None: there is one episode only
    remark: str
    unsaid: int  # decisions of held-out episodes that the layout cannot express, which are not among these


@dataclass(frozen=True)
class Fit:
    """How well a policy does what was demonstrated after some passes through the demonstrations."""

    passes: int
    loss: float  # minus the mean log-probability of what was demonstrated, in the last of these passes
    held_out: float  # likewise, of episodes that it did not learn from; NaN if there are none
    best: bool  # of the passes so far


def show(actor: Actor, shown: Sequence[Demonstration], config: Config) -> Shown | None:
    """Return what demonstrations show to a policy, with one episode in HELD_OUT held out; None: nothing.

    Raises ConfigError if the policy cannot express what is shown.
    """
    spec = shown[0].spec
    episodes = [
        episode
        for one in shown
        for part in one.stretches
        for episode in finished_episodes(part, actor.behavior)
        if episode.demonstrated.any()  # others play the rest, or it was discarded
    ]
    if not episodes:
        return None
    order = np.random.default_rng([config.seed, actor.behavior]).permutation(len(episodes)).tolist()
    count = max(1, len(episodes) // HELD_OUT) if len(episodes) > 1 else 0
    parts = [order[count:], order[:count]]
    learned, held_out = (
        targets(actor, [_demonstration(shown[0], [episodes[i] for i in part], spec, actor.behavior)], config)
        for part in parts
    )
    if learned.actions is None:
        raise ConfigError(learned.remark)
    decisions = 0 if held_out.actions is None else len(held_out.actions)
    other = "other is" if count == 1 else "others are"
    earned = np.mean([float((episode.rewards @ actor.encoder.weights).sum()) for episode in episodes])
    remark = f"{learned.remark}; {decisions:,} decisions of {count} {other} held out; an episode earned {earned:.4g}"
    return Shown(learned.actions, held_out.actions, remark, held_out.unsaid)


def _demonstration(
    first: Demonstration, episodes: Sequence[Episode], spec: pb.GameSpec, behavior: int
) -> Demonstration:
    return Demonstration(first.path, spec, list(join_episodes(episodes, spec, behavior)), 0)


def fit(actor: Actor, shown: Shown, passes: int) -> Generator[Fit, None, None]:
    """Let a policy learn what is shown to it; yield what each pass has reached, and keep the best one at the end.

    It ends after `passes`, or once PATIENCE of them have not made the loss on held-out episodes smaller.
    """
    learner = Learner(actor.name, actor.network, branches=actor.branches, gaussians=actor.gaussians, autograd=True)
    size = min(actor.config.minibatch_size, len(shown.learned))
    rng = np.random.default_rng([actor.seed, 1])
    gradient = learner.weights.grad
    assert gradient is not None
    least, best, best_pass = np.inf, learner.weights.detach().clone(), 0
    try:
        for number in range(1, passes + 1):
            losses, chosen = [], minibatches(refresh(actor.network, shown.learned), size, rng)
            for _ in range(len(shown.learned) // size):
                gradient.zero_()
                losses.append(add_cloning_gradient(actor.network, next(chosen), 1.0))
                learner.step(actor.config.learning_rate, actor.config.weight_decay)
            loss = float(np.mean(losses))
            held_out = np.nan if shown.held_out is None else _loss(actor, shown.held_out)
            judged = loss if shown.held_out is None else held_out
            if judged < least:
                least, best, best_pass = judged, learner.weights.detach().clone(), number
            yield Fit(number, loss, held_out, best_pass == number)
            if number - best_pass >= PATIENCE:
                break
    finally:  # also if it is interrupted, or no further pass is wanted
        with torch.no_grad():
            learner.weights.copy_(best)


@torch.no_grad()
def _loss(actor: Actor, actions: Demonstrated) -> float:
    """Return the mean loss of actions."""
    parts = _parts(actor, actions)
    return sum(float(cloning_loss(actor.network, part)) * len(part) for part in parts) / len(actions)


def teach_critic(actor: Actor, shown: Shown) -> tuple[float, dict[str, Array]]:
    """Let the critic predict what is earned by what is shown.

    Return what `fit_critic` does, and the arrays of a checkpoint with the moments of the returns, if they are scaled.
    """
    scale, arrays = 1.0, {}
    if actor.config.scale_rewards:
        moments = Moments(1)
        moments.add(shown.learned.returns.numpy(force=True)[:, None])
        scale = float(moments.deviation()[0])
        arrays = {f"{actor.name}/policy/returns.{name}": array[None] for name, array in moments.state().items()}
    held_out = iter(()) if shown.held_out is None else _parts(actor, shown.held_out)
    return fit_critic(actor.network, _parts(actor, shown.learned), held_out, scale), arrays


def _parts(actor: Actor, actions: Demonstrated) -> Iterator[Demonstrated]:
    """Yield all actions, about ROWS at once, with what a policy remembers there."""
    fresh, units = refresh(actor.network, actions), actions.units
    size = max(1, ROWS * units // len(actions))
    for start in range(0, units, size):
        yield fresh.minibatch(torch.arange(start, min(start + size, units), device=actions.discrete.device))


class Likeness(NamedTuple):
    """How well a policy does with one part of the device what was demonstrated, and how well that goes without it."""

    part: str
    ours: str
    without: str
    learned: bool  # whether the policy is better, or there is nothing to learn


def compare(actor: Actor, device: pb.Device, actions: Demonstrated) -> list[Likeness]:
    """Return what a policy does most probably beside what was demonstrated.

    A branch: how often the choice is the same; without the policy: with the most frequent choice. An axis: how far it
    is off on average, in shares of its range; without: from the median.
    """
    ours, theirs = _played(actor, device, actions)
    rows, layout = [], actor.layout
    for axis in sorted({axis for part in (*layout.continuous, *layout.discrete) for axis in covers(part)[0]}):
        span = device.axes[axis].high - device.axes[axis].low
        wanted = theirs.axes[:, axis]
        off, spread = (np.abs(other - wanted).mean() / span for other in (ours.axes[:, axis], np.median(wanted)))
        learned = _learned(off, spread)
        rows.append(Likeness(device.axes[axis].name, f"{off:.1%} off", f"{spread:.1%} off", learned))
    for branch in sorted({branch for part in (*layout.continuous, *layout.discrete) for branch in covers(part)[1]}):
        wanted = theirs.choices[:, branch]
        same, most = (wanted == ours.choices[:, branch]).mean(), np.bincount(wanted).max() / len(wanted)
        learned = _learned(1 - same, 1 - most)
        rows.append(Likeness(device.branches[branch].name, f"{same:.1%}", f"{most:.1%}", learned))
    return rows


def _learned(wrong: float, without: float) -> bool:
    """Return whether a policy errs clearly less than a guess without a policy, or there is nothing to learn."""
    return bool(without <= LEAST or wrong <= 0.95 * without)


@torch.no_grad()
def _played(actor: Actor, device: pb.Device, actions: Demonstrated) -> tuple[ActArrays, ActArrays]:
    """Return what a policy's likeliest actions make of the device, and what the demonstrated ones do."""
    ours, theirs = [], []
    for part in _parts(actor, actions):
        continuous, discrete = part.continuous.numpy(force=True), part.discrete.numpy(force=True)
        noise = Noise(np.zeros_like(continuous), np.zeros(discrete.shape, np.float32))
        masks = None if part.masks is None else part.masks.numpy(force=True)
        outputs = actor.network.heads(part.observations).outputs
        taken = sample_actions(actor.network, outputs, masks, noise, deterministic=True)
        ours.append((taken.continuous, taken.discrete))
        theirs.append((continuous, discrete))
    return _act(actor, device, ours), _act(actor, device, theirs)


def _act(actor: Actor, device: pb.Device, parts: Sequence[tuple[Array, Array]]) -> ActArrays:
    continuous, discrete = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    act = ActArrays(
        np.zeros((len(discrete), len(device.axes)), np.float32),
        np.zeros((len(discrete), len(device.branches)), np.int32),
    )
    actor.layout.write(continuous, discrete, act)
    return act
