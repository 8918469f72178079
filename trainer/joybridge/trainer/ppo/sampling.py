"""Sampling actions from the outputs of a network."""

import numpy as np
import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.trainer.ppo.continuous import log_probs_of_each, sample_each
from joybridge.trainer.ppo.fast.kernels import Action, Head, Noise, sample
from joybridge.trainer.ppo.networks import Network

NOTHING = np.zeros(0, np.float32)


def sample_actions(
    network: Network, outputs: Tensor, masks: Array | None, noise: Noise, action: Action, *, deterministic: bool
) -> None:
    """Write an action per row of `outputs`, from `Network.heads`, into `action`, with its joint log-probability.

    masks: [n, branches, widest] of 0 or FORBIDDEN, or None. deterministic: the likeliest choices, and the continuous
    actions that a noise of 0 gives.
    """
    sizes = np.array(network.space.branches, np.int64)
    if not network.distributions:
        head = Head(network.mean_bias.numpy(force=True), network.log_variance.numpy(force=True), sizes)
        sample(outputs.numpy(force=True), head, masks, noise, deterministic, action)
        return
    sample(outputs.numpy(force=True), Head(NOTHING, NOTHING, sizes), masks, noise, deterministic, action)
    normal = torch.from_numpy(np.zeros_like(noise.normal) if deterministic else noise.normal)
    given = network.distributions, network.continuous(outputs).cpu(), network.log_variance.cpu()
    samples = sample_each(*given, normal)
    action.continuous[:] = samples.numpy()
    action.log_probs[:] += log_probs_of_each(*given, samples)[0].numpy()
