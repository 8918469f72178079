"""The gradient of the PPO loss in closed form: what autograd would compute, without its bookkeeping.

All of it is compiled. A test holds the result to autograd's within 1e-6. With several threads, a minibatch
is divided into as many parts, whose gradients are computed at the same time and added up.
"""

import math
from functools import partial

import numba
import numpy as np
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.ppo.fast.kernels import (
    COUNT,
    NO_COUNTS,
    NO_MASKS,
    Gradient,
    Rows,
    Terms,
    compiled,
    gather,
    loss_gradient,
)
from joybridge.ppo.fast.towers import (
    ForwardCache,
    NetworkShape,
    actor_begin,
    backward,
    critic_begin,
    forward,
    gaussians,
    hidden_width,
    matrix,
    shape_of,
)
from joybridge.ppo.loss import Batch, advantage_moments
from joybridge.ppo.networks import Network, flatten_parameters
from joybridge.ppo.schedule import Coefficients


class ClosedFormGradient:
    """Sets the gradient of a network on minibatches; a `LossGradient` as `Learner` takes it."""

    def __init__(self, network: Network, threads: int = 1) -> None:
        """Work on `network`. threads: also the number of parts, so that results do not depend on the machine."""
        weights = flatten_parameters(network)
        assert weights.grad is not None
        self.weights, self.gradient, self.shape = weights.detach().numpy(), weights.grad.numpy(), shape_of(network)
        self.threads = threads
        self.parts = np.zeros((threads, len(weights)), np.float32)
        self.workspaces = np.zeros((threads, 0), np.float32)

    def __call__(self, batch: Batch, rows: Tensor, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on some rows of `batch`; return the statistics that `ppo_loss` returns."""
        timesteps = Rows(
            batch.observations.numbers.numpy(),
            batch.continuous.numpy(),
            batch.discrete.numpy(),
            NO_MASKS if batch.masks is None else batch.masks.numpy(),
            NO_COUNTS if batch.counts is None else batch.counts.numpy(),
            batch.log_probs.numpy(),
            batch.values.numpy(),
            batch.advantages.numpy(),
            batch.returns.numpy(),
        )
        parts = min(self.threads, len(rows))
        size = workspace_size(self.shape, math.ceil(len(rows) / parts))
        if size > self.workspaces.shape[1]:
            self.workspaces = np.zeros((self.threads, size), np.float32)
        given = self.weights, self.gradient, self.shape, timesteps, rows.numpy()
        mean, deviation = advantage_moments(batch.advantages[rows]) if coefficients.normalize_minibatch else (0.0, 1.0)
        terms = Terms(
            len(rows),
            coefficients.clip_range,
            coefficients.entropy_coef,
            coefficients.vf_coef,
            coefficients.clip_vloss,
            float(mean),
            1.0 / float(deviation),
            coefficients.sum_entropy,
        )
        statistics: Array = np.empty((parts, COUNT + len(self.shape.choices)))
        if self.threads == 1:
            part_gradient(*given, terms, self.workspaces[0, :size], statistics[0])
        else:
            numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))
            gradient_in_parts(*given, terms, self.parts[:parts], self.workspaces, statistics)
        return statistics[0]  # type: ignore[no-any-return]


@compiled
def workspace_size(shape: NetworkShape, rows: int) -> int:
    """Return how many numbers `part_gradient` works with, for so many rows."""
    return rows * (shape.widths[0] + 4 * hidden_width(shape) + 2 * shape.widths.max())  # type: ignore[no-any-return]


@compiled
def part_gradient(
    weights: Array,
    gradient: Array,
    shape: NetworkShape,
    batch: Rows,
    index: Array,
    terms: Terms,
    workspace: Array,
    statistics: Array,
) -> None:
    """Write the gradients of the loss on the rows at `index`, by all parameters, and the statistics.

    workspace: overwritten. The system may take as long to map new memory each time as the
    products take.
    """
    n, inputs, hidden = len(index), shape.widths[0], len(index) * hidden_width(shape)
    rows = gather(batch, index, matrix(workspace, 0, n, inputs))
    pieces = workspace[n * inputs : n * inputs + 4 * hidden].reshape((4, hidden))
    spare = workspace[n * inputs + 4 * hidden :].reshape((2, -1))
    kept, critic_kept = ForwardCache(pieces[0], pieces[1]), ForwardCache(pieces[2], pieces[3])

    outputs = forward(weights, shape, actor_begin(shape), shape.columns, rows.observations, kept)
    value_outputs = outputs
    if not shape.shared:
        value_outputs = forward(weights, shape, critic_begin(shape), 1, rows.observations, critic_kept)
    estimates = value_outputs[:, -1] + weights[shape.means]
    if len(shape.sums):
        outputs = np.dot(outputs, shape.sums)

    d_outputs, d_values = np.empty_like(outputs), np.empty(n, np.float32)
    free = gaussians(gradient, shape)
    statistics[:] = loss_gradient(
        outputs,
        estimates,
        gaussians(weights, shape),
        rows,
        terms,
        Gradient(d_outputs, d_values, free.mean_bias, free.log_variance),
    )

    if shape.shared:
        d_outputs[:, -1] = d_values
    else:
        critic = critic_begin(shape)
        backward(weights, gradient, shape, critic, rows.observations, critic_kept, d_values.reshape((n, 1)), spare)
    gradient[shape.means] = d_values.sum()
    if len(shape.sums):
        d_outputs = np.dot(d_outputs, shape.sums.T)
    backward(weights, gradient, shape, actor_begin(shape), rows.observations, kept, d_outputs, spare)


@compiled
def add_up(parts: Array, total: Array) -> None:
    """Write the sum of the rows of `parts` into `total`, which may be the first of them."""
    total[:] = parts[0]
    for part in range(1, len(parts)):
        for i in range(len(total)):
            total[i] += parts[part, i]


@partial(compiled, parallel=True)
def gradient_in_parts(
    weights: Array,
    gradient: Array,
    shape: NetworkShape,
    batch: Rows,
    index: Array,
    terms: Terms,
    parts: Array,
    workspaces: Array,
    statistics: Array,
) -> None:
    """Do what `part_gradient` does for a whole minibatch, in threads.

    parts [parts, parameters]: where the gradient of each part is written. workspaces [parts, .]: see `part_gradient`.
    statistics [parts, .]: the first row becomes those of the whole minibatch.
    """
    total, count = len(index), len(parts)
    for part in numba.prange(count):
        own = index[total * part // count : total * (part + 1) // count]
        space = workspaces[part, : workspace_size(shape, len(own))]
        part_gradient(weights, parts[part], shape, batch, own, terms, space, statistics[part])
    add_up(parts, gradient)
    add_up(statistics, statistics[0])
