"""Branched proximal policy optimisation (Schulman et al. 2017): the loss, its schedules and one update.

Schedules and the order of things are the original's (ML-Agents 0.7). The gradient comes from autograd here,
which is the readable reference, or in closed form from `gradient.py`, which is several times faster.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from joybridge.trainer.ppo.distributions import branch_entropy, chosen_log_probs, gaussian_log_probs
from joybridge.trainer.ppo.networks import Network, Outputs


@dataclass
class Batch:
    """Transitions to learn from; every tensor has one row per transition."""

    observations: Tensor  # [n, observation]
    continuous: Tensor  # [n, continuous]: unclipped samples
    discrete: Tensor  # int64 [n, branches]
    masks: Tensor | None  # [n, branches, widest]: 0 or FORBIDDEN, added to the logits
    log_probs: Tensor  # [n]: joint, when the action was sampled
    values: Tensor  # [n]: when the action was sampled
    advantages: Tensor  # [n], normalised
    returns: Tensor  # [n]

    def rows(self, index: Tensor) -> "Batch":
        """Return the timesteps at `index`."""
        return self._each(lambda field: field[index])

    def to(self, device: torch.device) -> "Batch":
        """Return the batch on a device."""
        return self._each(lambda field: field.to(device))

    def slice(self, start: int, end: int) -> "Batch":
        """Return the timesteps start .. end - 1 without copying them."""
        return self._each(lambda field: field[start:end])

    def _each(self, function: Callable[[Tensor], Tensor]) -> "Batch":
        fields: dict[str, Any] = {name: None if f is None else function(f) for name, f in vars(self).items()}
        return Batch(**fields)

    def __len__(self) -> int:
        return len(self.returns)


@dataclass(frozen=True)
class Coefficients:
    """What the schedules give for one update."""

    learning_rate: float
    clip: float
    entropy: float


# Sets the network's gradient of the loss on a minibatch; returns [policy loss, value loss, entropy].
Gradient = Callable[[Batch, Coefficients], Tensor]


def anneal(progress: float, learning_rate: float, clip: float, entropy: float) -> Coefficients:
    """Return the coefficients after a share `progress` of the run: linear, to 1e-10, 0.1 and 1e-5."""
    left = 1.0 - min(max(progress, 0.0), 1.0)

    def line(start: float, end: float) -> float:
        return end + (start - end) * left

    return Coefficients(line(learning_rate, 1e-10), line(clip, 0.1), line(entropy, 1e-5))


def joint_log_probs(outputs: Outputs, log_variance: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the joint log-probability of the batch's actions, [n], and their mean entropy, a number."""
    log_probs = torch.zeros_like(outputs.value)
    entropy = torch.zeros(())
    if batch.discrete.shape[1]:
        logits = outputs.logits if batch.masks is None else outputs.logits + batch.masks
        log_p = torch.log_softmax(logits, -1)
        log_probs = log_probs + chosen_log_probs(log_p, batch.discrete)
        entropy = entropy + branch_entropy(log_p).mean()
    if batch.continuous.shape[1]:
        chosen, spread = gaussian_log_probs(outputs.mean, log_variance, batch.continuous)
        log_probs, entropy = log_probs + chosen, entropy + spread
    return log_probs, entropy


def ppo_loss(network: Network, batch: Batch, coefficients: Coefficients) -> tuple[Tensor, tuple[Tensor, ...]]:
    """Return the loss of a minibatch and its parts: clipped surrogate, half the clipped value loss, entropy."""
    clip = coefficients.clip
    outputs = network(batch.observations)
    log_probs, entropy = joint_log_probs(outputs, network.log_variance, batch)
    ratio = torch.exp(log_probs - batch.log_probs)
    surrogate = torch.min(ratio * batch.advantages, ratio.clamp(1 - clip, 1 + clip) * batch.advantages)
    clipped_value = batch.values + (outputs.value - batch.values).clamp(-clip, clip)
    errors = torch.max((batch.returns - outputs.value).square(), (batch.returns - clipped_value).square())
    policy_loss, value_loss = -surrogate.mean(), errors.mean()
    loss = policy_loss + 0.5 * value_loss - coefficients.entropy * entropy
    return loss, (policy_loss, value_loss, entropy)


def autograd_gradient(network: Network, batch: Batch, coefficients: Coefficients) -> Tensor:
    """Set the gradient of the loss; return [policy loss, value loss, entropy]. The readable reference."""
    network.zero_grad(set_to_none=False)
    loss, parts = ppo_loss(network, batch, coefficients)
    loss.backward()  # type: ignore[no-untyped-call]
    return torch.stack([part.detach() for part in parts])


class Update:
    """One update from one batch, done at once or a few minibatches at a time.

    Each epoch shuffles and takes as many whole minibatches as there are; the rest is left out.
    """

    def __init__(
        self,
        gradient: Gradient,
        optimizer: torch.optim.Optimizer,
        batch: Batch,
        coefficients: Coefficients,
        *,
        epochs: int,
        minibatch: int,
        rng: np.random.Generator,
    ) -> None:
        """Prepare to learn from `batch`; `rng` shuffles. A batch smaller than a minibatch is one."""
        self.gradient, self.optimizer, self.batch, self.coefficients = gradient, optimizer, batch, coefficients
        self.minibatch = min(minibatch, len(batch))
        self.per_epoch = len(batch) // self.minibatch
        self.total = epochs * self.per_epoch
        self.rng = rng
        self.shuffled = batch
        self.parts: list[Tensor] = []

    def advance(self, share: float) -> None:
        """Learn until at least `share` of all minibatches are done."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.coefficients.learning_rate
        while len(self.parts) < min(share, 1.0) * self.total:
            number = len(self.parts) % self.per_epoch
            if number == 0:
                self.shuffled = self.batch.rows(
                    torch.from_numpy(self.rng.permutation(len(self.batch))).to(self.batch.returns.device)
                )
            rows = self.shuffled.slice(number * self.minibatch, (number + 1) * self.minibatch)
            self.parts.append(self.gradient(rows, self.coefficients))
            self.optimizer.step()

    def finish(self) -> dict[str, float]:
        """Learn from what is left; return the means of the loss's parts over all minibatches."""
        self.advance(1.0)
        means = torch.stack(self.parts).mean(0).tolist()
        return dict(zip(("policy_loss", "value_loss", "entropy"), means, strict=True))
