"""Sampling actions from the outputs of a network."""

import numpy as np
import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.layouts import ActionSpace
from joybridge.layouts.layout import conditions_met
from joybridge.ppo.continuous import log_probs_of_each, sample_each
from joybridge.ppo.distributions import FORBIDDEN, counting_actions
from joybridge.ppo.fast.kernels import NO_MASKS, Action, Head, Noise, sample
from joybridge.ppo.networks import Network

NOTHING = np.zeros(0, np.float32)


def sample_actions(
    network: Network, outputs: Tensor, masks: Array | None, noise: Noise, action: Action, *, deterministic: bool
) -> None:
    """Write an action per row of `outputs`, from `Network.heads`, into `action`, with its joint log-probability.

    masks: [n, branches, widest] of 0 or FORBIDDEN, or None. Where branches count only with some choices of others,
    those that do not count are masked here. deterministic: the likeliest choices, and the continuous actions that a
    noise of 0 gives.
    """
    space = network.space
    sizes, counting = np.array(space.branches, np.int64), space.counting()
    if network.distributions:
        head = Head(NOTHING, NOTHING, sizes, counting)
    else:
        means, log_variance = network.mean_bias.numpy(force=True), network.log_variance.numpy(force=True)
        head = Head(means, log_variance, sizes, counting)
    sample(outputs.numpy(force=True), head, NO_MASKS if masks is None else masks, noise, deterministic, action)
    if space.given:
        assert masks is not None
        leave_one_choice(space, action.discrete, masks)
        sample(outputs.numpy(force=True), head, masks, noise, deterministic, action)
    if not network.distributions:
        return
    normal = torch.from_numpy(np.zeros_like(noise.normal) if deterministic else noise.normal)
    given = network.distributions, network.continuous(outputs).cpu(), network.log_variance.cpu()
    samples = sample_each(*given, normal)
    action.continuous[:] = samples.numpy()
    counts = counting_actions(torch.from_numpy(counting), torch.from_numpy(action.discrete))
    action.log_probs[:] += log_probs_of_each(*given, samples, counts).numpy()


def leave_one_choice(space: ActionSpace, discrete: Array, masks: Array) -> None:
    """Leave only the first allowed choice of branches that do not count with what others have chosen, and choose it.

    Such a branch has the probability 1 and the entropy 0, so it adds nothing to the loss. discrete [n, branches]: what
    was chosen. It and masks [n, branches, widest] are changed.
    """
    if not space.given:
        return
    branches, met = conditions_met(space.given, discrete)
    lanes, columns = np.nonzero(~met)
    columns = branches[columns]
    first = masks[lanes, columns].argmax(axis=1)
    masks[lanes, columns] = FORBIDDEN
    masks[lanes, columns, first] = 0.0
    discrete[lanes, columns] = first
