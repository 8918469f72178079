"""The loss of branched proximal policy optimization (Schulman et al. 2017).

This is the readable reference, differentiated by autograd. `fast/` holds a twin in closed form, several times faster.
The order of operations is that of the original (ML-Agents 0.7).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.ppo.continuous import Distribution, entropies_of_each, log_probs_of_each
from joybridge.ppo.distributions import (
    branch_entropies,
    chosen_log_probs,
    entropy_of_all,
    gaussian_log_probs,
)
from joybridge.ppo.memory import Sequences
from joybridge.ppo.networks import Network, Outputs
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.own import Term
from joybridge.ppo.schedule import Coefficients
from joybridge.ppo.threads import in_threads


@dataclass
class Actions:
    """Observations, and what was done; every tensor has one row per timestep."""

    observations: Observations
    continuous: Tensor  # [n, continuous]: samples before clipping
    discrete: Tensor  # int64 [n, branches]
    masks: Tensor | None  # [n, branches, widest]: 0 or FORBIDDEN, added to the logits
    counts: Tensor | None = field(default=None, kw_only=True)  # see `Conditions`, bool [n, parts]; None: all parts do
    sequences: Sequences | None = field(default=None, kw_only=True)  # None: policies without memory

    @property
    def units(self) -> int:
        """The number of what minibatches are made of: sequences if there are any, else timesteps."""
        return len(self) if self.sequences is None else len(self.sequences.lengths)

    def minibatch(self, units: Tensor) -> Self:
        """Return the timesteps of some units."""
        if self.sequences is None:
            return self.rows(units)
        chosen = self.rows(self.sequences.rows(units))
        states, lengths = self.sequences.states[units], self.sequences.lengths[units]
        chosen.observations = chosen.observations.in_sequences(states, lengths)
        return chosen

    def rows(self, index: Tensor) -> Self:
        """Return the timesteps at `index`."""
        return self._each(lambda part: part.index_select(0, index))  # eight times as fast as part[index]

    def to(self, accelerator: torch.device) -> Self:
        """Return the same on an accelerator."""
        moved = self._each(lambda part: part.to(accelerator))
        moved.sequences = None if self.sequences is None else self.sequences.to(accelerator)
        return moved

    def _each(self, function: Callable[[Any], Any]) -> Self:
        fields: dict[str, Any] = {
            name: None if part is None else function(part) for name, part in vars(self).items() if name != "sequences"
        }
        return type(self)(**fields)

    def __len__(self) -> int:
        return len(self.observations)


@dataclass
class Batch(Actions):
    """Timesteps to learn from with PPO."""

    log_probs: Tensor  # [n]: joint, when the action was sampled
    values: Tensor  # [n]: when the action was sampled
    advantages: Tensor  # [n], normalized unless each minibatch is, or none
    returns: Tensor  # [n]


# Sets the gradient of a network on a minibatch: the units of a batch at some indices, int64. Returns its statistics,
# [len(STATISTICS) + branches].
LossGradient = Callable[[Batch, Tensor, Coefficients], Array]


def joint_log_probs(
    outputs: Outputs,
    log_variance: Tensor,
    batch: Actions,
    distributions: Sequence[Distribution] = (),
    *,
    sum_entropy: bool = False,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the joint log-probability of the actions [n], their entropy, and the entropies of the parts.

    sum_entropy: see `Coefficients`. The entropies of the parts are one per branch, and one per continuous action if
    these have other distributions than Gaussians. A part that does not count in a row adds nothing to its
    log-probability and entropy.
    """
    branches = batch.discrete.shape[1]
    chosen, counts = (None, None) if batch.counts is None else (batch.counts[:, :branches], batch.counts[:, branches:])
    log_probs = torch.zeros_like(outputs.value)
    entropy = torch.zeros(())
    entropies = torch.zeros(0)
    if branches:
        logits = outputs.logits if batch.masks is None else outputs.logits + batch.masks
        log_p = torch.log_softmax(logits, dim=-1)
        log_probs = log_probs + chosen_log_probs(log_p, batch.discrete, chosen)
        entropies = branch_entropies(log_p, chosen).mean(0)
        entropy = entropies.sum()
    if distributions:
        log_probs = log_probs + log_probs_of_each(distributions, outputs.mean, log_variance, batch.continuous, counts)
        parts = entropies_of_each(distributions, outputs.mean, log_variance)
        entropy = entropy + entropy_of_all(parts.t(), counts, summed=sum_entropy)
        entropies = torch.cat([entropies.to(parts), parts.mean(1)])
    elif batch.continuous.shape[1]:
        gaussian, gaussian_entropy = gaussian_log_probs(
            outputs.mean, log_variance, batch.continuous, counts, summed=sum_entropy
        )
        log_probs = log_probs + gaussian
        entropy = entropy + gaussian_entropy
    return log_probs, entropy, entropies


@torch.no_grad()
def acted_log_probs(network: Network, batch: Actions, units: int) -> Tensor:
    """Return the joint log-probabilities of the actions under the network as it is, [n], so many units at once."""
    index = torch.arange(batch.units, device=batch.discrete.device)
    parts = (batch.minibatch(index[start : start + units]) for start in range(0, batch.units, units))
    return torch.cat(
        [joint_log_probs(network(p.observations), network.log_variance, p, network.distributions)[0] for p in parts]
    )


def advantage_moments(advantages: Tensor) -> tuple[Tensor, Tensor]:
    """Return the mean and the deviation by which a minibatch is normalized, as Stable-Baselines3 and CleanRL do."""
    deviation = advantages.std() if len(advantages) > 1 else torch.ones_like(advantages[0])
    return advantages.mean(), deviation + 1e-8


def ppo_loss(
    network: Network, batch: Batch, coefficients: Coefficients, term: Term | None = None
) -> tuple[Tensor, Tensor]:
    """Return the loss of a minibatch, with a term of the user's own, and its statistics [len(STATISTICS) + branches].

    The statistics: clipped surrogate, clipped value loss, entropy, an estimate of the KL divergence from the policy
    that acted (the third one of http://joschu.net/blog/kl-approx.html), the fraction of ratios beyond the clip range,
    and the entropy of each branch; last, the term.
    """
    clip, advantages = coefficients.clip_range, batch.advantages
    if coefficients.normalize_minibatch:
        mean, deviation = advantage_moments(advantages)
        advantages = (advantages - mean) / deviation
    outputs = network(batch.observations)
    log_probs, entropy, entropies = joint_log_probs(
        outputs, network.log_variance, batch, network.distributions, sum_entropy=coefficients.sum_entropy
    )
    log_ratio = log_probs - batch.log_probs
    ratio = torch.exp(log_ratio)
    surrogate = torch.min(ratio * advantages, ratio.clamp(1 - clip, 1 + clip) * advantages)
    errors = (batch.returns - outputs.value).square()
    if coefficients.clip_vloss:
        clipped_value = batch.values + (outputs.value - batch.values).clamp(-clip, clip)
        errors = torch.max(errors, (batch.returns - clipped_value).square())
    policy_loss, value_loss = -surrogate.mean(), errors.mean()
    loss = policy_loss + coefficients.vf_coef * value_loss - coefficients.entropy_coef * entropy
    approx_kl = (ratio - 1.0 - log_ratio).mean()
    clip_fraction = ((ratio - 1.0).abs() > clip).float().mean()
    statistics = torch.stack([policy_loss, value_loss, entropy, approx_kl, clip_fraction])
    parts = [statistics, entropies.to(statistics)]
    if term is not None:
        added = term(outputs, log_probs, batch)
        loss = loss + added
        parts.append(added[None].to(statistics))
    return loss, torch.cat(parts).detach()


def autograd_gradient(
    network: Network,
    batch: Batch,
    units: Tensor,
    coefficients: Coefficients,
    term: Term | None = None,
    threads: int = 1,
) -> Array:
    """Set the gradient of the loss on some units of `batch` by autograd; return the statistics."""
    network.zero_grad(set_to_none=False)
    with in_threads(threads):
        loss, statistics = ppo_loss(network, batch.minibatch(units), coefficients, term)
        loss.backward()  # type: ignore[no-untyped-call]
    return statistics.cpu().numpy()
