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
from joybridge.ppo.fast.kernels import COUNT, NO_COUNTS, NO_MASKS, Gradient, Rows, Terms, compiled, loss_gradient, take
from joybridge.ppo.fast.towers import (
    Form,
    Kept,
    actor_begin,
    backward,
    critic_begin,
    form,
    forward,
    gaussians,
    hidden_width,
    matrix,
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
        self.weights, self.gradient, self.form = weights.detach().numpy(), weights.grad.numpy(), form(network)
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
        size = workspace_size(self.form, math.ceil(len(rows) / parts))
        if size > self.workspaces.shape[1]:
            self.workspaces = np.zeros((self.threads, size), np.float32)
        given = self.weights, self.gradient, self.form, timesteps, rows.numpy()
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
        statistics: Array = np.empty((parts, COUNT + len(self.form.choices)))
        if self.threads == 1:
            write_gradient(*given, terms, self.workspaces[0, :size], statistics[0])
        else:
            numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))
            gradient_in_parts(*given, terms, self.parts[:parts], self.workspaces, statistics)
        return statistics[0]  # type: ignore[no-any-return]


@compiled
def workspace_size(form: Form, rows: int) -> int:
    """Return how many numbers `part_gradient` works with, for so many rows."""
    return rows * (form.widths[0] + 4 * hidden_width(form) + 2 * form.widths.max())  # type: ignore[no-any-return]


@compiled
def part_gradient(
    weights: Array, gradient: Array, form: Form, batch: Rows, index: Array, terms: Terms, workspace: Array
) -> Array:
    """Write the gradients of the loss on the rows at `index`, by all parameters; return the statistics.

    workspace: overwritten. The system may take as long to map new memory each time as the
    products take.
    """
    n, inputs, hidden = len(index), form.widths[0], len(index) * hidden_width(form)
    rows = take(batch, index, matrix(workspace, 0, n, inputs))
    pieces = workspace[n * inputs : n * inputs + 4 * hidden].reshape((4, hidden))
    spare = workspace[n * inputs + 4 * hidden :].reshape((2, -1))
    kept, critic_kept = Kept(pieces[0], pieces[1]), Kept(pieces[2], pieces[3])

    outputs = forward(weights, form, actor_begin(form), form.columns, rows.observations, kept)
    value_outputs = outputs
    if not form.shared:
        value_outputs = forward(weights, form, critic_begin(form), 1, rows.observations, critic_kept)
    estimates = value_outputs[:, -1] + weights[form.means]
    if len(form.sums):
        outputs = np.dot(outputs, form.sums)

    d_outputs, d_values = np.empty_like(outputs), np.empty(n, np.float32)
    free = gaussians(gradient, form)
    statistics = loss_gradient(
        outputs,
        estimates,
        gaussians(weights, form),
        rows,
        terms,
        Gradient(d_outputs, d_values, free.mean_bias, free.log_variance),
    )

    if form.shared:
        d_outputs[:, -1] = d_values
    else:
        critic = critic_begin(form)
        backward(weights, gradient, form, critic, rows.observations, critic_kept, d_values.reshape((n, 1)), spare)
    gradient[form.means] = d_values.sum()
    if len(form.sums):
        d_outputs = np.dot(d_outputs, form.sums.T)
    backward(weights, gradient, form, actor_begin(form), rows.observations, kept, d_outputs, spare)
    return statistics


@compiled
def write_gradient(
    weights: Array,
    gradient: Array,
    form: Form,
    batch: Rows,
    index: Array,
    terms: Terms,
    workspace: Array,
    statistics: Array,
) -> None:
    """Do what `part_gradient` does, and write the statistics."""
    statistics[:] = part_gradient(weights, gradient, form, batch, index, terms, workspace)


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
    form: Form,
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
        space = workspaces[part, : workspace_size(form, len(own))]
        statistics[part] = part_gradient(weights, parts[part], form, batch, own, terms, space)
    add_up(parts, gradient)
    add_up(statistics, statistics[0])
