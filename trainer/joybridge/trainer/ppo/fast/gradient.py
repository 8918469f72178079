"""The gradient of the PPO loss in closed form: what autograd would compute, without its bookkeeping.

All of it is one compiled function. A test holds the result to autograd's within 1e-6.
"""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.trainer.ppo.fast.kernels import NO_MASKS, Action, Gradient, Head, Target, compiled, loss_gradient
from joybridge.trainer.ppo.fast.towers import Dense, Form, backward, dense, form, forward, hidden_width
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.networks import Network
from joybridge.trainer.ppo.schedule import Coefficients


class ClosedFormGradient:
    """Sets the gradient of a network on minibatches; a `LossGradient` as `Learner` takes it."""

    def __init__(self, network: Network) -> None:
        """Work on `network`, whose parameters must have gradients to write to (see `flatten_parameters`)."""
        self.form = form(network)
        self.parameters, self.gradients = dense(network), dense(network, gradients=True)
        self.head = Head(
            network.mean_bias.detach().numpy(), network.log_variance.detach().numpy(),
            np.array(network.space.branches, np.int64),
        )  # fmt: skip
        assert network.mean_bias.grad is not None
        assert network.log_variance.grad is not None
        self.head_gradients = network.mean_bias.grad.numpy(), network.log_variance.grad.numpy()

    def __call__(self, batch: Batch, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on `batch`; return the statistics that `ppo_loss` returns."""
        action = Action(batch.continuous.numpy(), batch.discrete.numpy(), batch.log_probs.numpy())
        return network_gradient(
            self.parameters, self.gradients, self.form, batch.observations.numpy(), self.head, self.head_gradients,
            NO_MASKS if batch.masks is None else batch.masks.numpy(),
            Target(action, batch.values.numpy(), batch.advantages.numpy(), batch.returns.numpy()),
            coefficients.clip_range, coefficients.entropy_coef,
        )  # fmt: skip


@compiled
def network_gradient(
    network: Dense, gradients: Dense, form: Form, observations: Array, head: Head, head_gradients: tuple[Array, Array],
    masks: Array, target: Target, clip: float, entropy_coef: float,
) -> Array:  # fmt: skip
    """Write the gradients of the loss by all parameters; return the statistics that `ppo_loss` returns.

    head_gradients: where those of mean_bias and log_variance are written. masks: see `softmax`.
    """
    n = len(observations)
    kept = n * hidden_width(network.actor)
    values, slopes = np.empty(kept, np.float32), np.empty(kept, np.float32)
    outputs = forward(network.actor, form.activation, observations, values, slopes)
    value_outputs, critic_values, critic_slopes = outputs, values, slopes
    if not form.shared:
        kept = n * hidden_width(network.critic)
        critic_values, critic_slopes = np.empty(kept, np.float32), np.empty(kept, np.float32)
        value_outputs = forward(network.critic, form.activation, observations, critic_values, critic_slopes)
    estimates = value_outputs[:, -1] + network.value_bias[0]
    if len(form.sums):
        outputs = np.dot(outputs, form.sums)

    d_outputs, d_values = np.empty_like(outputs), np.empty(n, np.float32)
    statistics = loss_gradient(
        outputs, estimates, head, masks, target, clip, entropy_coef,
        Gradient(d_outputs, d_values, head_gradients[0], head_gradients[1]),
    )  # fmt: skip

    if form.shared:
        d_outputs[:, -1] = d_values
    else:
        d_value_outputs = d_values.reshape((n, 1))
        backward(network.critic, gradients.critic, observations, critic_values, critic_slopes, d_value_outputs)
    gradients.value_bias[0] = d_values.sum()
    if len(form.sums):
        d_outputs = np.dot(d_outputs, form.sums.T)
    backward(network.actor, gradients.actor, observations, values, slopes, d_outputs)
    return statistics
