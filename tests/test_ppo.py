"""The loss, its gradient in closed form, and the update."""

import math
from dataclasses import asdict, astuple
from functools import partial

import numba
import numpy as np
import pytest
import torch

from joybridge.config.config import PolicyConfig
from joybridge.config.metrics import STATISTICS
from joybridge.layouts import ActionSpace, make_layouts
from joybridge.ppo.distributions import FORBIDDEN, counting_actions
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.fast.kernels import NO_MASKS, Head, Noise, sample
from joybridge.ppo.loss import Batch, autograd_gradient, joint_log_probs
from joybridge.ppo.networks import Network, Outputs, flatten_parameters
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients, anneal
from joybridge.ppo.update import Learner, explained_variance, ppo_update
from joybridge.v1 import bridge_pb2 as pb
from tests.support.measured import interpreted

SPACES = {
    "discrete": (ActionSpace(0, (11, 11, 3)), True, False),
    "continuous": (ActionSpace(4, ()), False, False),
    "hybrid": (ActionSpace(2, (2, 2)), False, False),
    "hybrid in one tower, masked": (ActionSpace(2, (4, 3)), True, True),
    "discrete in two towers, masked": (ActionSpace(0, (5, 2)), False, True),
    "ordinal and others, masked": (ActionSpace(1, (4, 7, 3), ordinal=(0, 2)), True, True),
    "axes with choices": (ActionSpace(3, (3, 2), needs=((0, 0, 0), (1, 0, 1), (2, 1, 1))), False, True),
}


def make(space: ActionSpace, shared: bool, masked: bool, rows: int, seed: int = 0, activation: str = "swish"):
    """Return a network away from its initial state, its flat parameters, and a batch it disagrees with."""
    generator = torch.Generator().manual_seed(seed)
    normal = partial(torch.randn, generator=generator)
    network = Network(20, space, [16, 12], shared, seed, activation)
    flat = flatten_parameters(network)
    with torch.no_grad():
        flat += 0.1 * normal(flat.shape)
    columns = [torch.randint(0, size, (rows,), generator=generator) for size in space.branches]
    discrete = torch.stack(columns, 1) if columns else torch.zeros(rows, 0, dtype=torch.long)
    masks = None
    if masked:
        forbidden = (torch.rand(rows, len(space.branches), max(space.branches), generator=generator) < 0.3).float()
        masks = forbidden.scatter(-1, discrete.unsqueeze(-1), 0.0) * FORBIDDEN
    observations = Observations(normal((rows, 20)))
    outputs = network(observations)
    value = outputs.value.detach()
    batch = Batch(
        observations, normal((rows, space.continuous)), discrete, masks, torch.zeros(rows),
        value + 0.4 * normal(rows), normal(rows), value + normal(rows),
    )  # fmt: skip
    batch.log_probs = joint_log_probs(outputs, network.log_variance, batch, (), network.counting)[0].detach()
    return network, flat, batch


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("seed", range(4))
def test_the_closed_form_gradient_is_autograds(name, seed):
    compare_gradients(name, seed, "swish")


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
def test_the_closed_form_gradient_is_autograds_with_each_activation(activation):
    compare_gradients("hybrid", 1, activation)


@pytest.mark.parametrize("name", SPACES)
def test_threads_together_compute_the_gradient_of_autograd(name):
    for threads in (2, 3):
        compare_gradients(name, 2, "swish", threads)


def test_threads_give_the_same_bits_on_a_machine_with_fewer_cores_and_none_of_them_needs_a_row(monkeypatch):
    for rows in (1, 2, 131):
        network, flat, batch = make(*SPACES["hybrid"], rows=rows)
        coefficients = Coefficients(1e-3, 0.2, 0.05)
        statistics = ClosedFormGradient(network, threads=4)(batch, torch.arange(rows), coefficients)
        gradient = flat.grad.clone()
        with monkeypatch.context() as patch:
            patch.setattr(numba.config, "NUMBA_NUM_THREADS", 1)
            flat.grad.fill_(7.0)
            again = ClosedFormGradient(network, threads=4)(batch, torch.arange(rows), coefficients)
            assert again.tobytes() == statistics.tobytes()
        assert torch.equal(flat.grad, gradient)
        np.testing.assert_allclose(
            statistics, autograd_gradient(network, batch, torch.arange(rows), coefficients), atol=1e-5, rtol=1e-5
        )


def compare_gradients(name, seed, activation, threads=1):
    network, flat, batch = make(*SPACES[name], rows=200, seed=seed, activation=activation)
    batch.log_probs += 0.3 * torch.randn(200, generator=torch.Generator().manual_seed(9))
    coefficients = Coefficients(1e-3, 0.2, 0.05)
    reference = autograd_gradient(network, batch, torch.arange(200), coefficients)
    gradient = flat.grad.clone()
    flat.grad.fill_(7.0)  # whatever was there before must not matter
    statistics = ClosedFormGradient(network, threads)(batch, torch.arange(200), coefficients)
    torch.testing.assert_close(flat.grad, gradient, atol=1e-6, rtol=1e-5)
    np.testing.assert_allclose(statistics, reference, atol=1e-5, rtol=1e-5)
    assert len(statistics) == len(STATISTICS) + len(SPACES[name][0].branches)
    assert gradient.abs().max() > 1e-2


@pytest.mark.slow
def test_interpreted_kernels_pass_the_tests_of_compiled_ones():
    tests = "test_the_closed_form and 0- or test_masked_choices or test_the_likeliest"
    interpreted("pytest", "-k", tests, "tests/test_ppo.py", "tests/test_distributions.py")


def test_the_ratio_is_joint_over_axes_and_branches():
    network, _, batch = make(*SPACES["hybrid"], rows=8)
    outputs = network(batch.observations)
    whole, _, _ = joint_log_probs(outputs, network.log_variance, batch)
    parts = []
    for axes, branches in ((2, 0), (0, 2)):
        part = Batch(**vars(batch))
        part.continuous, part.discrete = batch.continuous[:, :axes], batch.discrete[:, :branches]
        parts.append(joint_log_probs(outputs, network.log_variance, part)[0])
    torch.testing.assert_close(whole, parts[0] + parts[1])


def test_a_ratio_beyond_the_clip_gives_no_gradient_where_it_would_gain():
    network, flat, batch = make(*SPACES["discrete"], rows=1)
    batch.log_probs -= 1.0  # ratio e
    batch.returns = batch.values = network(batch.observations).value.detach()
    for advantage, moved in ((1.0, False), (-1.0, True)):
        batch.advantages = torch.tensor([advantage])
        ClosedFormGradient(network)(batch, torch.arange(1), Coefficients(1e-3, 0.2, 0.0))
        assert bool(flat.grad.abs().max() > 1e-6) is moved


def test_schedules_are_linear_from_their_start_to_their_end():
    config = PolicyConfig(learning_rate=3e-4, clip_range=0.2, entropy_coef=0.05)
    assert astuple(anneal(0.0, config)) == pytest.approx((3e-4, 0.2, 0.05))
    assert astuple(anneal(0.5, config))[1:] == pytest.approx((0.15, (0.05 + 1e-5) / 2))
    assert astuple(anneal(1.0, config)) == pytest.approx((1e-10, 0.1, 1e-5))


@pytest.mark.parametrize("constant", ["learning_rate", "clip_range", "entropy_coef"])
def test_each_schedule_may_be_constant(constant):
    linear = PolicyConfig(learning_rate=3e-4)
    config = linear.model_copy(update={f"{constant}_schedule": "constant"})
    changed = asdict(anneal(0.7, linear)) | {constant: getattr(linear, constant)}
    assert asdict(anneal(0.7, config)) == changed != asdict(anneal(0.7, linear))


def test_a_longer_gradient_is_shortened_to_the_longest_that_is_allowed_and_a_shorter_one_is_kept():
    for longest, shortened in ((1e-3, True), (1e3, False)):
        network, _, batch = make(*SPACES["hybrid"], rows=32)
        learner = Learner("player", network, branches=["a", "b"], gaussians=["x", "y"], autograd=False)
        ClosedFormGradient(network)(batch, torch.arange(32), Coefficients(1e-9, 0.2, 0.05))
        assert learner.weights.grad is not None
        whole = learner.weights.grad.clone()
        statistics = update(learner, batch, Coefficients(1e-9, 0.2, 0.05), epochs=1, minibatch_size=32, longest=longest)
        wanted = whole * longest / whole.norm() if shortened else whole
        torch.testing.assert_close(learner.weights.grad, wanted, atol=1e-6, rtol=1e-3)
        assert statistics["grad_norm"] == pytest.approx(float(whole.norm()), rel=1e-4)


@pytest.mark.parametrize(("target_kl", "epochs"), [(1e-9, 1), (1e9, 4), (None, None)])
def test_an_update_ends_after_the_epoch_that_moved_the_policy_farther_than_its_target(target_kl, epochs):
    network, _, batch = make(*SPACES["discrete"], rows=64)
    learner = Learner("player", network, branches=["a", "b", "c"], gaussians=[], autograd=False)
    statistics = update(learner, batch, Coefficients(1e-3, 0.2, 0.0), epochs=4, minibatch_size=16, target_kl=target_kl)
    assert statistics.get("epochs") == epochs
    assert int(learner.moments["step"]) == 4 * (epochs or 4)


def test_an_epoch_takes_whole_minibatches_of_all_rows_and_leaves_the_rest():
    network, _, batch = make(*SPACES["discrete"], rows=70)
    sizes, seen = [], []

    def spy(batch: Batch, rows: torch.Tensor, coefficients: Coefficients) -> np.ndarray:
        sizes.append(len(rows))
        seen.append(batch.returns[rows])
        return np.zeros(len(STATISTICS) + 3)

    learner = Learner("player", network, branches=["a", "b", "c"], gaussians=[], autograd=False)
    learner.gradient = spy
    update(learner, batch, epochs=3, minibatch_size=32)
    assert sizes == [32] * 6
    assert len(torch.cat(seen[:2]).unique()) == 64
    assert not torch.equal(seen[0], seen[2])


def test_an_update_raises_the_probability_of_what_paid():
    network, _, batch = make(ActionSpace(0, (4,)), True, False, rows=256)
    batch.advantages = torch.where(batch.discrete[:, 0] == 2, 1.5, -0.5)
    before = torch.softmax(network(batch.observations).logits, -1)[:, 0, 2].mean()
    learner = Learner("player", network, branches=["button"], gaussians=[], autograd=False)
    statistics = update(learner, batch, Coefficients(1e-2, 0.2, 0.0), epochs=4, minibatch_size=64)
    assert torch.softmax(network(batch.observations).logits, -1)[:, 0, 2].mean() > before + 0.05
    assert statistics["approx_kl"] > 0 and 0 < statistics["clip_fraction"] < 1 and statistics["grad_norm"] > 0
    assert statistics["entropy"] == pytest.approx(statistics["entropy_button"])
    assert statistics["learning_rate"] == 1e-2


def test_the_compiled_step_of_adam_is_that_of_pytorch():
    networks = [make(*SPACES["hybrid"], rows=8)[0] for _ in range(2)]
    compiled, reference = (
        Learner("player", network, branches=["a", "b"], gaussians=["x", "y"], autograd=autograd)
        for network, autograd in zip(networks, (False, True), strict=True)
    )
    generator = torch.Generator().manual_seed(3)
    for step in range(20):
        gradient = 10.0 ** (step % 5 - 3) * torch.randn(compiled.weights.shape, generator=generator)
        for learner in (compiled, reference):
            learner.weights.grad = gradient.clone()
            learner.step(1e-3 * (step + 1))
    torch.testing.assert_close(compiled.weights, reference.weights, atol=1e-6, rtol=1e-6)
    for name, moment in compiled.moments.items():
        torch.testing.assert_close(moment, reference.moments[name], atol=1e-6, rtol=2e-6, msg=name)


def test_the_entropy_of_each_gaussian_is_reported_by_the_name_of_its_axis():
    network, _, batch = make(*SPACES["continuous"], rows=64)
    learner = Learner("player", network, branches=[], gaussians=["x", "y", "z", "w"], autograd=True)
    statistics = update(learner, batch, Coefficients(1e-9, 0.2, 0.0), epochs=1, minibatch_size=64)
    truth = torch.distributions.Normal(0.0, torch.exp(0.5 * network.log_variance)).entropy()
    assert [statistics[f"entropy_{axis}"] for axis in "xyzw"] == pytest.approx(truth.tolist())


def test_a_critic_that_predicts_the_returns_explains_all_of_their_variance_and_a_constant_one_nothing():
    returns = torch.tensor([1.0, 2.0, 4.0])
    assert explained_variance(returns, returns) == pytest.approx(1.0)
    assert explained_variance(torch.full((3,), 5.0), returns) == pytest.approx(0.0)
    assert explained_variance(-returns, returns) < 0
    assert explained_variance(returns, torch.ones(3)) == 0.0


def update(
    learner, batch, coefficients=Coefficients(1e-3, 0.2, 0.05), *, epochs, minibatch_size, longest=None, target_kl=None  # noqa: B008
):  # fmt: skip
    return ppo_update(
        learner, batch, coefficients, epochs=epochs, minibatch_size=minibatch_size, rng=np.random.default_rng(0),
        max_grad_norm=longest, target_kl=target_kl,
    )  # fmt: skip


def test_the_network_begins_as_the_original_does():
    network = Network(132, ActionSpace(2, (11, 3)), [300, 300], False, 0)
    for layer in network.actor.layers:
        fan_in = layer.weight.shape[1]
        assert layer.weight.std().item() == pytest.approx((1 / fan_in) ** 0.5, rel=0.05)
        assert layer.weight.abs().max().item() <= 2 * (1.3 / fan_in) ** 0.5
        assert not layer.bias.any()
    assert network.actor.head.weight.std().item() == pytest.approx((0.01 / 300) ** 0.5, rel=0.05)
    assert network.critic is not None
    assert network.critic.head.weight.abs().max().item() <= (6 / 301) ** 0.5
    assert not network.log_variance.any()
    observations = Observations(torch.randn(3, 132))
    outputs = network(observations)
    assert outputs.logits.shape == (3, 2, 11)
    assert (torch.softmax(outputs.logits, -1)[:, 1, 3:] == 0).all()
    torch.testing.assert_close(network.heads(observations)[1], outputs.value)


def test_an_axis_that_does_not_count_adds_nothing_in_the_old_and_in_the_new_policy():
    """One axis per choice: 0.5, 0.3 and 0.2, of which the second is chosen; all axes have mean 0.1, deviation 0.5."""
    space = ActionSpace(3, (3,), needs=((0, 0, 0), (1, 0, 1), (2, 0, 2)))
    logits = torch.tensor([0.5, 0.3, 0.2]).log().reshape(1, 1, 3)
    means, log_variance = torch.full((1, 3), 0.1, requires_grad=True), torch.full((3,), math.log(0.25))
    empty = torch.zeros(1)
    continuous = torch.tensor([[9.0, 0.4, -9.0]])
    batch = Batch(Observations(torch.zeros(1, 1)), continuous, torch.tensor([[1]]), None, empty, empty, empty, empty)
    outputs = Outputs(logits, means, torch.zeros(1))
    counting = torch.from_numpy(space.counting())
    log_probs, entropy, _ = joint_log_probs(outputs, log_variance, batch, (), counting)
    assert float(log_probs.detach()) == pytest.approx(-1.609765, abs=1e-6)
    assert float(entropy) == pytest.approx(1.755444, abs=1e-6)
    (gradient,) = torch.autograd.grad(log_probs.sum(), means)
    assert gradient[0, 0] == gradient[0, 2] == 0.0 and gradient[0, 1] == pytest.approx(0.3 / 0.25)
    head = Head(np.full(3, 0.1, np.float32), log_variance.numpy(), np.array([3]), space.counting())
    flat = np.concatenate([logits.numpy().ravel(), np.zeros(3)]).astype(np.float32)[None]
    noise = Noise(np.array([[5.0, 0.6, -5.0]], np.float32), np.array([[0.6]], np.float32))
    sampled = sample(flat, head, NO_MASKS, noise, False)
    assert sampled.discrete[0, 0] == 1 and sampled.log_probs[0] == pytest.approx(-1.609765, abs=1e-6)


@pytest.mark.parametrize("layout", ["hybrid", "beta", "squashed"])
def test_layouts_of_continuous_axes_know_with_which_choice_an_axis_counts(layout):
    axes = [pb.Axis(name=name, low=0.0, high=1.0) for name in ("turn", "power", "free")]
    axes[0].only_with.CopyFrom(pb.Condition(branch="act", choice="turn"))
    axes[1].only_with.CopyFrom(pb.Condition(branch="act", choice="kick"))
    branches = [pb.Branch(name="press", choices=["no", "yes"]), pb.Branch(name="act", choices=["kick", "turn", "wait"])]
    space = make_layouts(layout, pb.Device(axes=axes, branches=branches))[""].space
    assert space.needs == ((0, 1, 1), (1, 1, 0))
    choices = torch.tensor([[0, 0], [1, 1], [1, 2]])
    counts = counting_actions(torch.from_numpy(space.counting()), choices)
    assert counts is not None
    assert counts.tolist() == [[False, True, True], [True, False, True], [False, False, True]]
