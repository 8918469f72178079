"""Sampling actions from the outputs of a network."""

import numpy as np
import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.ppo.continuous import log_probs_of_each, sample_each
from joybridge.ppo.fast.acting import empty_action
from joybridge.ppo.fast.kernels import NO_MASKS, Action, Head, Noise, sample
from joybridge.ppo.networks import Network

NOTHING = np.zeros(0, np.float32)


def sample_actions(
    network: Network, outputs: Tensor, masks: Array | None, noise: Noise, *, deterministic: bool
) -> Action:
    """Return an action per row of `outputs`, from `Network.heads`, with its joint log-probability.

    masks: [n, branches, widest] of 0 or FORBIDDEN, or None. deterministic: the likeliest choices, and the continuous
    actions that a noise of 0 gives.
    """
    space = network.space
    sizes = np.array(space.branches, np.int64)
    means, log_variance = NOTHING, NOTHING
    if not network.distributions:
        means, log_variance = network.mean_bias.numpy(force=True), network.log_variance.numpy(force=True)
    head = Head(means, log_variance, sizes)
    action = empty_action(noise)
    sample(outputs.numpy(force=True), head, NO_MASKS if masks is None else masks, noise, deterministic, action)
    if not network.distributions:
        return action
    normal = torch.zeros(len(outputs), len(network.noise_holds)) if deterministic else torch.from_numpy(noise.normal)
    given = network.distributions, network.continuous(outputs).cpu(), network.log_variance.cpu()
    samples = sample_each(*given, normal)
    log_probs = action.log_probs + log_probs_of_each(*given, samples).numpy()
    return Action(samples.numpy(), action.discrete, log_probs)
