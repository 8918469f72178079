"""The arithmetic between the matrix products, one row at a time, compiled by Numba.

As tensor operations it would be dozens of small ones, each of which costs more to start than to run. The readable
references are `ppo/distributions.py` and `ppo/loss.py`; tests hold these functions to them.

Shapes: n rows, of a minibatch or one per lane. The `outputs` of a network [n, columns] hold the logits of all
branches, each padded to the widest, then the means, then the value where the body is shared.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numba
import numpy as np

from joybridge.config.metrics import STATISTICS
from joybridge.contract.machine_code import delete_stale
from joybridge.contract.tensors import Array

LOG_2_PI = math.log(2 * math.pi)
COUNT = len(STATISTICS)
NO_MASKS = np.zeros((0, 0, 0), np.float32)  # an array, because each type of an argument is compiled again, for seconds
NO_COUNTS = np.zeros((0, 0), np.bool_)

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F, *, parallel: bool = False) -> F:
    """Compile a function at its first call and keep the machine code in a cache on disk, where that can be written.

    What Python calls writes its results into arrays that it is given, and returns a number or nothing. For each array
    that is returned, Numba's machine code calls a Python function and does not look whether it failed, so an interrupt
    (KeyboardInterrupt) that comes there would end the process with a segmentation fault.

    parallel: iterations of numba.prange run in threads.
    """
    delete_stale(function.__code__.co_filename)
    try:
        return numba.njit(cache=True, error_model="numpy", parallel=parallel)(function)  # type: ignore[no-any-return]
    except RuntimeError:
        return numba.njit(error_model="numpy", parallel=parallel)(function)  # type: ignore[no-any-return]


class Head(NamedTuple):
    """The parts of the action distribution that do not depend on the observation."""

    mean_bias: Array  # [continuous]
    log_variance: Array  # [continuous]
    sizes: Array  # int64 [branches]: choices of each branch


class Noise(NamedTuple):
    """The random numbers behind one action per row."""

    normal: Array  # [n, continuous]: noise of the Gaussians
    uniform: Array  # [n, branches] in [0, 1): inverts the cumulative distribution of each branch


def draw_noise(rng: np.random.Generator, continuous: tuple[int, ...], discrete: tuple[int, ...]) -> Noise:
    """Return the noise of actions whose parts have these shapes, float32."""
    normal, uniform = rng.standard_normal(continuous, np.float32), rng.random(discrete, np.float32)
    return Noise(np.asarray(normal), np.asarray(uniform))


class Action(NamedTuple):
    """Sampled actions and their joint log-probabilities."""

    continuous: Array  # [n, continuous]: not clipped
    discrete: Array  # int64 [n, branches]
    log_probs: Array  # [n]


class Rows(NamedTuple):
    """Timesteps to learn from; see `Batch` in `ppo/loss.py`."""

    observations: Array  # [n, observation]
    continuous: Array  # [n, continuous]
    discrete: Array  # int64 [n, branches]
    masks: Array  # see `softmax`
    counts: Array  # bool [n, branches + continuous]: see `Conditions`; NO_COUNTS: all do
    log_probs: Array  # [n]: of when the actions were sampled, like the values
    values: Array  # [n]
    advantages: Array  # [n]
    returns: Array  # [n]


class Terms(NamedTuple):
    """What the loss of a minibatch is made of; see `Coefficients`."""

    total: int  # rows of the minibatch, of which only a part may be at hand
    clip_range: float
    entropy_coef: float
    vf_coef: float
    clip_vloss: bool
    mean: float  # of the advantages, which is taken from them
    scale: float  # that they are multiplied with then
    sum_entropy: bool


class Gradient(NamedTuple):
    """Where the derivatives of the loss are written."""

    outputs: Array  # [n, columns]
    values: Array  # [n]
    mean_bias: Array  # [continuous]
    log_variance: Array  # [continuous]


@compiled
def gather(rows: Rows, index: Array, observations: Array) -> Rows:
    """Return the rows at `index`, int64 [n]. observations [n, observation]: where theirs are written."""
    n, branches, dimensions = len(index), rows.discrete.shape[1], rows.continuous.shape[1]
    taken = Rows(
        observations,
        np.empty((n, dimensions), np.float32),
        np.empty((n, branches), np.int64),
        np.empty((n, rows.masks.shape[1], rows.masks.shape[2]), np.float32) if len(rows.masks) else rows.masks,
        np.empty((n, rows.counts.shape[1]), np.bool_) if len(rows.counts) else rows.counts,
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty(n, np.float32),
    )
    for i in range(n):
        row = index[i]
        for j in range(observations.shape[1]):
            observations[i, j] = rows.observations[row, j]
        for k in range(dimensions):
            taken.continuous[i, k] = rows.continuous[row, k]
        for b in range(branches):
            taken.discrete[i, b] = rows.discrete[row, b]
            for j in range(taken.masks.shape[2]):
                taken.masks[i, b, j] = rows.masks[row, b, j]
        for part in range(taken.counts.shape[1]):
            taken.counts[i, part] = rows.counts[row, part]
        taken.log_probs[i], taken.values[i] = rows.log_probs[row], rows.values[row]
        taken.advantages[i], taken.returns[i] = rows.advantages[row], rows.returns[row]
    return taken


@compiled
def softmax(
    outputs: Array, masks: Array, row: int, branch: int, widest: int, choices: int, p: Array, log_p: Array
) -> float:
    """Write the probabilities of one branch's choices into `p` and their logarithms into `log_p`, both [widest].

    Return the branch's entropy. masks: [n, branches, widest] of 0 or FORBIDDEN, or NO_MASKS.
    """
    highest = -np.inf
    for j in range(choices):
        log_p[j] = outputs[row, branch * widest + j]
        if len(masks):
            log_p[j] += masks[row, branch, j]
        highest = max(highest, log_p[j])
    total = 0.0
    for j in range(choices):
        p[j] = math.exp(log_p[j] - highest)
        total += p[j]
    shift = highest + math.log(total)
    entropy = 0.0
    for j in range(choices):
        p[j] /= total
        log_p[j] -= shift
        entropy -= p[j] * log_p[j]
    return entropy


@compiled
def part_counts(counts: Array, row: int, part: int) -> bool:
    """Return whether a part of the action of a row counts. counts: see `Rows`."""
    return not len(counts) or counts[row, part]


@compiled
def shares_of_entropy(counts: Array, rows: int, dimensions: int, summed: bool) -> Array:
    """Return the sum over rows of the share of each continuous action in the entropy of those that count.

    summed: it is their sum, so each of these has a share of 1; otherwise it is their mean.
    """
    shares = np.zeros(dimensions)
    if not len(counts):
        shares[:] = rows if summed else rows / max(dimensions, 1)
        return shares
    for own in counts[:, counts.shape[1] - dimensions :]:
        for k in range(dimensions):
            if own[k]:
                shares[k] += 1.0 if summed else 1.0 / own.sum()
    return shares


@compiled
def sample(outputs: Array, head: Head, masks: Array, noise: Noise, likeliest: bool, action: Action) -> None:
    """Write an action per row into `action`, sampled, or the likeliest one. masks: see `softmax`."""
    mean_bias, log_variance, sizes = head
    continuous, discrete, log_probs = action
    branches, dimensions = len(sizes), len(mean_bias)
    widest = sizes.max() if branches else 0
    p, log_p = np.empty(widest), np.empty(widest)
    for i in range(len(outputs)):
        log_prob = 0.0
        for b in range(branches):
            softmax(outputs, masks, i, b, widest, sizes[b], p, log_p)
            if likeliest:
                choice = int(np.argmax(log_p[: sizes[b]]))
            else:
                total = 0.0  # about 1; scaling by it keeps the search inside the choices that are possible
                for j in range(sizes[b]):
                    total += p[j]
                choice, cumulative = 0, p[0]
                while cumulative <= noise.uniform[i, b] * total:
                    choice += 1
                    cumulative += p[choice]
            discrete[i, b] = choice
            log_prob += log_p[choice]
        for k in range(dimensions):
            deviation = 0.0 if likeliest else noise.normal[i, k]
            mean = outputs[i, branches * widest + k] + mean_bias[k]
            continuous[i, k] = mean + math.exp(0.5 * log_variance[k]) * deviation
            log_prob -= 0.5 * (deviation * deviation + log_variance[k] + LOG_2_PI)
        log_probs[i] = log_prob


@compiled
def loss_gradient(outputs: Array, values: Array, head: Head, rows: Rows, terms: Terms, gradient: Gradient) -> Array:
    """Differentiate the branched PPO loss (`ppo_loss` in `ppo/loss.py`) by the outputs of a network.

    The rows may be a part of a minibatch; over all parts, gradients and statistics add up to those of the minibatch.
    With r the ratio, A the advantage, R the return, for a minibatch of n rows:

        d loss / d log-probability  = -A r / n, or 0 where the clipped surrogate is the smaller
        d log-probability / d logit = 1[chosen] - p
        d entropy / d logit         = -p (log p + H), H the branch's entropy
        d log-probability / d mean  = (a - mean) / variance
        d loss / d value            = 2 c (V - R) / n, c its coefficient, or 0 where the clipped value is the worse

    Parts of an action that do not count in a row add nothing to its log-probability, its entropy and its gradient.

    Return the statistics that `ppo_loss` returns, float64 [len(STATISTICS) + branches].
    """
    mean_bias, log_variance, sizes = head
    continuous, discrete, n = rows.continuous, rows.discrete, terms.total
    clip, entropy_coef = terms.clip_range, terms.entropy_coef
    branches, dimensions = len(sizes), len(mean_bias)
    widest = sizes.max() if branches else 0
    p, log_p, entropies = np.zeros((branches, widest)), np.zeros((branches, widest)), np.empty(branches)
    precision = np.exp(-log_variance)
    statistics = np.zeros(COUNT + branches)
    policy_loss = value_loss = entropy = kl = clipped_rows = 0.0
    gradient.mean_bias[:] = 0.0
    gradient.log_variance[:] = 0.0
    for i in range(len(outputs)):
        log_prob = 0.0
        for b in range(branches):
            entropies[b] = softmax(outputs, rows.masks, i, b, widest, sizes[b], p[b], log_p[b])
            if not part_counts(rows.counts, i, b):
                entropies[b] = 0.0
                p[b, :] = 0.0
                continue
            entropy += entropies[b]
            statistics[COUNT + b] += entropies[b]
            log_prob += log_p[b, discrete[i, b]]
        for k in range(dimensions):
            if not part_counts(rows.counts, i, branches + k):
                continue
            deviation = continuous[i, k] - (outputs[i, branches * widest + k] + mean_bias[k])
            log_prob -= 0.5 * (deviation * deviation * precision[k] + log_variance[k] + LOG_2_PI)

        log_ratio = log_prob - rows.log_probs[i]
        ratio = math.exp(log_ratio)
        kl += ratio - 1.0 - log_ratio
        clipped_rows += abs(ratio - 1.0) > clip
        advantage = (rows.advantages[i] - terms.mean) * terms.scale
        unclipped = ratio * advantage
        clipped = min(max(ratio, 1.0 - clip), 1.0 + clip) * advantage
        policy_loss -= min(unclipped, clipped)
        d_log_prob = -unclipped / n if unclipped <= clipped else 0.0
        for b in range(branches):
            for j in range(widest):  # p is 0 beyond the branch's own choices
                d_entropy = (log_p[b, j] + entropies[b]) * entropy_coef / n
                gradient.outputs[i, b * widest + j] = p[b, j] * (d_entropy - d_log_prob)
            if part_counts(rows.counts, i, b):
                gradient.outputs[i, b * widest + discrete[i, b]] += d_log_prob
        for k in range(dimensions):
            column = branches * widest + k
            if not part_counts(rows.counts, i, branches + k):
                gradient.outputs[i, column] = 0.0
                continue
            deviation = continuous[i, k] - (outputs[i, column] + mean_bias[k])
            gradient.outputs[i, column] = d_log_prob * deviation * precision[k]
            gradient.mean_bias[k] += gradient.outputs[i, column]
            gradient.log_variance[k] += 0.5 * d_log_prob * (deviation * deviation * precision[k] - 1.0)

        error = values[i] - rows.returns[i]
        moved = values[i] - rows.values[i]
        clipped_error = rows.values[i] + min(max(moved, -clip), clip) - rows.returns[i]
        free = not terms.clip_vloss or abs(moved) <= clip or error * error >= clipped_error * clipped_error
        value_loss += error * error if free else clipped_error * clipped_error
        gradient.values[i] = 2.0 * terms.vf_coef * error / n if free else 0.0

    entropy /= n
    shares = shares_of_entropy(rows.counts, len(outputs), dimensions, terms.sum_entropy)
    for k in range(dimensions):  # the entropy of a Gaussian does not depend on the row
        share = shares[k] / n
        entropy += share * 0.5 * (LOG_2_PI + 1.0 + log_variance[k])
        gradient.log_variance[k] -= share * 0.5 * entropy_coef
    statistics[COUNT:] /= n
    statistics[0], statistics[1], statistics[2] = policy_loss / n, value_loss / n, entropy
    statistics[3], statistics[4] = kl / n, clipped_rows / n
    return statistics
