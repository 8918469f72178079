"""The arithmetic between the matrix products, a row at a time, compiled by Numba.

In tensor operations it is dozens of small ones, each of which costs more to start than to run, and softmax
over a handful of choices is among the slowest. `distributions.py` and `ppo.py` are the readable references;
tests hold these functions to them.

Shapes: n rows, of a minibatch or one per lane; a network's `outputs` [n, columns] hold the logits of all
branches, each padded to the widest, then the means, then the value where the body is shared.
"""

import math
from collections.abc import Callable
from typing import TypeVar

import numba
import numpy as np

from joybridge.contract.tensors import Array

LOG_2_PI = math.log(2 * math.pi)

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function at its first call and keep the machine code in a cache on disk."""
    return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]


@compiled
def softmax(
    outputs: Array, masks: Array | None, row: int, branch: int, widest: int, choices: int, p: Array, log_p: Array
) -> float:
    """Write the probabilities of one branch's choices into `p` and their logarithms into `log_p`, both [widest].

    Return the branch's entropy. masks: [n, branches, widest] of 0 or FORBIDDEN, or None.
    """
    highest = -np.inf
    for j in range(choices):
        log_p[j] = outputs[row, branch * widest + j]
        if masks is not None:
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
def choose(
    outputs: Array, mean_bias: Array, log_variance: Array, sizes: Array, masks: Array | None, uniform: Array,
    normal: Array, likeliest: bool, continuous: Array, discrete: Array, log_probs: Array,
) -> None:  # fmt: skip
    """Sample each lane's action; write it and its joint log-probability, [lanes].

    uniform [lanes, branches] in [0, 1) inverts the cumulative distribution of each branch, normal [lanes,
    continuous] is the Gaussians' noise; likeliest: take the likeliest action instead.
    """
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
                total = 0.0  # about 1; what is left of it by rounding decides that no impossible choice is reached
                for j in range(sizes[b]):
                    total += p[j]
                choice, cumulative = 0, p[0]
                while cumulative <= uniform[i, b] * total:
                    choice += 1
                    cumulative += p[choice]
            discrete[i, b] = choice
            log_prob += log_p[choice]
        for k in range(dimensions):
            noise = 0.0 if likeliest else normal[i, k]
            mean = outputs[i, branches * widest + k] + mean_bias[k]
            continuous[i, k] = mean + math.exp(0.5 * log_variance[k]) * noise
            log_prob -= 0.5 * (noise * noise + log_variance[k] + LOG_2_PI)
        log_probs[i] = log_prob


@compiled
def differentiate(
    outputs: Array, values: Array, mean_bias: Array, log_variance: Array, sizes: Array, masks: Array | None,
    continuous: Array, discrete: Array, old_log_probs: Array, old_values: Array, advantages: Array, returns: Array,
    clip: float, entropy_weight: float, slope: Array, value_slope: Array, mean_slope: Array, spread_slope: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Differentiate the branched PPO loss (`ppo.ppo_loss`) by a network's outputs.

    With r the ratio, A the advantage, R the return, for n rows:

        d loss / d log-probability  = -A r / n, or 0 where the clipped surrogate is the smaller
        d log-probability / d logit = 1[chosen] - p
        d entropy / d logit         = -p (log p + H), H the branch's entropy
        d log-probability / d mean  = (a - mean) / variance
        d loss / d value            = (V - R) / n, or 0 where the clipped value is the worse

    Writes d loss / d outputs into `slope` [n, columns], of the value into `value_slope` [n], which may be a column
    of it, and the sums over rows for the means' bias and the log-variances, both [continuous]. sizes: the choices
    of each branch. Return policy loss, value loss and entropy.
    """
    n, branches, dimensions = len(outputs), len(sizes), len(mean_bias)
    widest = sizes.max() if branches else 0
    p, log_p, entropies = np.zeros((branches, widest)), np.zeros((branches, widest)), np.empty(branches)
    precision = np.exp(-log_variance)
    policy_loss = value_loss = entropy = 0.0
    mean_slope[:] = 0.0
    spread_slope[:] = 0.0
    for i in range(n):
        log_prob = 0.0
        for b in range(branches):
            entropies[b] = softmax(outputs, masks, i, b, widest, sizes[b], p[b], log_p[b])
            entropy += entropies[b]
            log_prob += log_p[b, discrete[i, b]]
        for k in range(dimensions):
            apart = continuous[i, k] - (outputs[i, branches * widest + k] + mean_bias[k])
            log_prob -= 0.5 * (apart * apart * precision[k] + log_variance[k] + LOG_2_PI)

        ratio = math.exp(log_prob - old_log_probs[i])
        unclipped = ratio * advantages[i]
        clipped = min(max(ratio, 1.0 - clip), 1.0 + clip) * advantages[i]
        policy_loss -= min(unclipped, clipped)
        push = -unclipped / n if unclipped <= clipped else 0.0  # d loss / d log-probability
        for b in range(branches):
            for j in range(widest):  # p is 0 beyond the branch's own choices
                spread = (log_p[b, j] + entropies[b]) * entropy_weight / n
                slope[i, b * widest + j] = p[b, j] * (spread - push)
            slope[i, b * widest + discrete[i, b]] += push
        for k in range(dimensions):
            column = branches * widest + k
            apart = continuous[i, k] - (outputs[i, column] + mean_bias[k])
            slope[i, column] = push * apart * precision[k]
            mean_slope[k] += slope[i, column]
            spread_slope[k] += 0.5 * push * (apart * apart * precision[k] - 1.0)

        error = values[i] - returns[i]
        moved = values[i] - old_values[i]
        clipped_error = old_values[i] + min(max(moved, -clip), clip) - returns[i]
        value_loss += max(error * error, clipped_error * clipped_error)
        free = abs(moved) <= clip or error * error >= clipped_error * clipped_error
        value_slope[i] = error / n if free else 0.0

    entropy /= n
    for k in range(dimensions):  # a Gaussian's entropy does not depend on the row; the mean over dimensions counts
        entropy += 0.5 * (LOG_2_PI + 1.0 + log_variance[k]) / dimensions
        spread_slope[k] -= 0.5 * entropy_weight / dimensions
    return policy_loss / n, value_loss / n, entropy
