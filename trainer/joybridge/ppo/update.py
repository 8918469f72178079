"""The learner of one policy: its optimizer (Adam), and an update from a batch."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch.optim.adam import adam

from joybridge.config.errors import DivergedError
from joybridge.config.metrics import STATISTICS
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.tensors import Array
from joybridge.ppo.cloning import Cloning, add_cloning_gradient
from joybridge.ppo.fast.adam import adam_step
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.loss import Batch, LossGradient, acted_log_probs, autograd_gradient
from joybridge.ppo.networks import Network, flatten_parameters
from joybridge.ppo.own import load_term
from joybridge.ppo.schedule import Coefficients

KL = STATISTICS.index("approx_kl")
LOSSES = ("policy_loss", "value_loss", "entropy")
BETAS = (0.9, 0.999)  # of Adam
EQUAL = 1e-10  # of the mean square of values: a variance that is an error of float32


class Learner:
    """Improves a network: the gradient of the loss, and Adam with its moments."""

    def __init__(
        self,
        name: str,
        network: Network,
        *,
        branches: Sequence[str],
        gaussians: Sequence[str],
        autograd: bool,
        threads: int = 1,
        adam_eps: float = 1e-8,
    ) -> None:
        """Learn for `network`, whose parameters are moved into one tensor.

        name: of the policy, for errors. branches, gaussians: what its outputs act on, for the names of statistics.
        autograd: take the gradient from autograd, the reference, rather than from its closed form, which needs the
        processor, no images, no memory, and Gaussians or choices. threads: that compute it. adam_eps: see `step`.
        """
        self.name, self.network, self.gaussians, self.adam_eps = name, network, gaussians, adam_eps
        self.threads = threads
        self.weights = flatten_parameters(network)
        self.moments = {
            "step": torch.zeros((), device=self.weights.device),
            "exp_avg": torch.zeros_like(self.weights, requires_grad=False),
            "exp_avg_sq": torch.zeros_like(self.weights, requires_grad=False),
        }
        self.closed = not (autograd or network.distributions or network.encoders or network.state_size)
        self.gradient: LossGradient = (
            ClosedFormGradient(network, threads)
            if self.closed
            else partial(autograd_gradient, network, threads=threads)
        )
        parts = [*branches, *(gaussians if network.distributions else ())]  # whose entropies the gradient returns
        self.statistics = [*STATISTICS, *(f"entropy_{name}" for name in parts)]

    def add_term(self, name: str) -> None:
        """Add a term of the user's own, "module:function", to the loss; its figure is loss_FUNCTION. By autograd.

        Raises ConfigError.
        """
        self.closed = False
        self.gradient = partial(autograd_gradient, self.network, term=load_term(name), threads=self.threads)
        self.statistics.append(f"loss_{name.rpartition(':')[2]}")

    def state(self) -> dict[str, Array]:
        """Return copies of the optimizer's moments for a checkpoint."""
        return {name: moment.cpu().numpy().copy() for name, moment in self.moments.items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        for name, array in state.items():
            self.moments[name].copy_(torch.from_numpy(array))

    @torch.no_grad()
    def step(self, learning_rate: float, weight_decay: float = 0.0) -> None:
        """Move the weights against their gradient with Adam (Kingma and Ba, 2015), whose epsilon is `adam_eps`.

        weight_decay: of AdamW (Loshchilov and Hutter, 2019), times the learning rate: what the weights lose before.
        """
        if weight_decay:
            self.weights *= 1.0 - learning_rate * weight_decay
        weights, gradient = self.weights, self.weights.grad
        step, mean, square = self.moments["step"], self.moments["exp_avg"], self.moments["exp_avg_sq"]
        assert gradient is not None
        if self.closed:
            step += 1
            adam_step(
                weights.detach().numpy(),
                gradient.numpy(),
                mean.numpy(),
                square.numpy(),
                float(step),
                learning_rate,
                *BETAS,
                self.adam_eps,
            )
            return
        adam(
            [weights],
            [gradient],
            [mean],
            [square],
            [],
            [step],
            fused=True,
            amsgrad=False,
            beta1=BETAS[0],
            beta2=BETAS[1],
            lr=learning_rate,
            weight_decay=0.0,
            eps=self.adam_eps,
            maximize=False,
        )


def ppo_update(
    learner: Learner,
    batch: Batch,
    coefficients: Coefficients,
    config: PolicyConfig,
    rng: np.random.Generator,
    cloning: Cloning | None = None,
) -> dict[str, float]:
    """Improve the network of `learner` on `batch`; return statistics by name, means over all minibatches.

    Each epoch shuffles the batch with `rng` and takes as many whole minibatches as there are; the rest is left out. A
    batch smaller than a minibatch is one. With memory, a minibatch is whole sequences that hold about `minibatch_size`
    timesteps. cloning: for each minibatch, the gradient of one of demonstrations is added; if it is alone, `target_kl`
    does not count. Raises DivergedError.
    """
    max_grad_norm, target_kl = config.max_grad_norm, config.target_kl
    accelerator = batch.returns.device
    size = min(max(1, config.minibatch_size * batch.units // len(batch)), batch.units)  # in units
    if batch.counts is not None:  # when actions were sampled, it was not known yet which of their parts count
        batch.log_probs = acted_log_probs(learner.network, batch, size)
    rows: list[Array] = []
    losses: list[float] = []  # of cloning
    if cloning is not None and cloning.alone:
        batch.advantages.zero_()
        coefficients, target_kl = replace(coefficients, entropy_coef=0.0), None
    done, divergence = 0, 0.0  # epochs; of the last one
    norm = torch.zeros(())  # of the last gradient, if gradients are clipped
    while done < config.epochs and (target_kl is None or divergence <= target_kl):
        order = torch.from_numpy(rng.permutation(batch.units)).to(accelerator)
        for start in range(0, batch.units - size + 1, size):
            rows.append(learner.gradient(batch, order[start : start + size], coefficients))
            if cloning is not None:
                losses.append(add_cloning_gradient(learner.network, next(cloning.minibatches), cloning.coef))
            if max_grad_norm is not None:
                norm = torch.nn.utils.clip_grad_norm_(learner.weights, max_grad_norm)
            learner.step(coefficients.learning_rate, config.weight_decay)
        done += 1
        divergence = float(np.mean([row[KL] for row in rows[-(batch.units // size) :]]))
    statistics = dict(zip(learner.statistics, np.mean(rows, axis=0).tolist(), strict=True))
    if found := not_finite(learner, statistics):
        raise DivergedError(
            f"the network of {learner.name} is no longer finite ({', '.join(found)}); look for huge rewards or "
            "observations, or take a smaller learning_rate in a new run"
        )
    assert learner.weights.grad is not None
    if not learner.network.distributions:
        log_variance = learner.network.log_variance.tolist()
        entropies = [0.5 * (math.log(2 * math.pi * math.e) + value) for value in log_variance]
        statistics |= {f"entropy_{name}": entropy for name, entropy in zip(learner.gaussians, entropies, strict=True)}
    if max_grad_norm is None:
        norm = torch.linalg.vector_norm(learner.weights.grad)
    if target_kl is not None:
        statistics["epochs"] = done
    if losses:
        statistics["cloning_loss"] = float(np.mean(losses))
    return statistics | {
        "explained_variance": explained_variance(batch.values, batch.returns),
        "grad_norm": float(norm),  # of the last minibatch, before it was clipped
        "learning_rate": coefficients.learning_rate,
    }


def not_finite(learner: Learner, statistics: dict[str, float]) -> list[str]:
    """Return which losses and parameters are infinite or NaN."""
    found = [f"{name} {statistics[name]:g}" for name in LOSSES if not math.isfinite(statistics[name])]
    if not learner.weights.isfinite().all():
        named = learner.network.named_parameters()
        found.append(f"parameters {', '.join(name for name, tensor in named if not tensor.isfinite().all())}")
    return found


def explained_variance(values: torch.Tensor, returns: torch.Tensor) -> float:
    """Return 1 - var(returns - values) / var(returns): 1 for a perfect critic, 0 for a constant one.

    It is 0 as well where all returns are equal, to the precision of float32.
    """
    variance = float(returns.var(correction=0))
    if variance <= EQUAL * float(returns.square().mean()):
        return 0.0
    return 1.0 - float((returns - values).var(correction=0)) / variance
