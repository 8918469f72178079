"""The loss, its gradient in closed form, and the update."""

from dataclasses import asdict, astuple, replace
from functools import partial

import numba
import numpy as np
import pytest
import torch

from joybridge.config.config import Config
from joybridge.config.metrics import STATISTICS
from joybridge.config.policy_config import PolicyConfig
from joybridge.layouts import ActionSpace
from joybridge.ppo.distributions import FORBIDDEN
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.loss import Batch, acted_log_probs, autograd_gradient, joint_log_probs, ppo_loss
from joybridge.ppo.networks import Network, Towers, flatten_parameters
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients, anneal
from joybridge.ppo.update import Learner, explained_variance, ppo_update
from tests.support.measured import interpreted

SAME = Coefficients(1e-3, 0.2, 0.05)
CONDITIONAL = "parts that do not always count, masked"
SPACES = {
    "discrete": (ActionSpace(0, (11, 11, 3)), True, False),
    "continuous": (ActionSpace(4, ()), False, False),
    "hybrid": (ActionSpace(2, (2, 2)), False, False),
    "hybrid in one tower, masked": (ActionSpace(2, (4, 3)), True, True),
    "discrete in two towers, masked": (ActionSpace(0, (5, 2)), False, True),
    "ordinal and others, masked": (ActionSpace(1, (4, 7, 3), ordinal=(0, 2)), True, True),
    CONDITIONAL: (ActionSpace(3, (3, 2), ordinal=(1,)), False, True),
}


def make(space: ActionSpace, shared: bool, masked: bool, rows: int, seed: int = 0, activation: str = "swish"):
    """Return a network away from its initial state, its flat parameters, and a batch it disagrees with."""
    generator = torch.Generator().manual_seed(seed)
    normal = partial(torch.randn, generator=generator)
    network = Network(20, space, Towers([16, 12], shared, activation), seed)
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
        observations,
        normal((rows, space.continuous)),
        discrete,
        masks,
        torch.zeros(rows),
        value + 0.4 * normal(rows),
        normal(rows),
        value + normal(rows),
    )
    batch.log_probs = joint_log_probs(outputs, network.log_variance, batch)[0].detach()
    return network, flat, batch


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.promise("M1")
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


@pytest.mark.parametrize("name", ["hybrid", CONDITIONAL])
@pytest.mark.parametrize(
    "terms", [{"vf_coef": 1.3}, {"clip_vloss": False}, {"normalize_minibatch": True}, {"sum_entropy": True}]
)
def test_the_closed_form_gradient_is_autograds_with_the_terms_of_other_programs(name, terms):
    for threads in (1, 2):
        compare_gradients(name, 3, "tanh", threads, Coefficients(1e-3, 0.2, 0.05, **terms))
    assert not torch.equal(*(gradient_of(name, coefficients) for coefficients in (SAME, replace(SAME, **terms))))


@pytest.mark.parametrize("autograd", [False, True])
def test_a_sum_of_entropies_is_the_entropy_of_the_joint_distribution(autograd):
    network, _, batch = make(*SPACES["hybrid"], rows=50)
    outputs = network(batch.observations)
    axes = torch.distributions.Normal(outputs.mean, torch.exp(0.5 * network.log_variance)).entropy()
    choices = torch.distributions.Categorical(logits=outputs.logits).entropy()
    gradient = partial(autograd_gradient, network) if autograd else ClosedFormGradient(network)
    for entropy, expected in (("sum", axes.sum(1)), ("mean", axes.mean(1))):
        coefficients = anneal(0.0, PolicyConfig(entropy=entropy))
        statistics = gradient(batch, torch.arange(50), coefficients)
        assert statistics[2] == pytest.approx(float((expected + choices.sum(1)).mean().detach()), rel=1e-5)


def gradient_of(name, coefficients):
    network, flat, batch = make(*SPACES[name], rows=50)
    ClosedFormGradient(network)(batch, torch.arange(50), coefficients)
    return flat.grad


def test_the_loss_of_a_preset_is_that_of_stable_baselines3():
    """Written down anew after its documentation: mean of the clipped surrogate, and half of the squared error."""
    network, _, batch = make(*SPACES["hybrid"], rows=64)
    batch.log_probs += 0.3 * torch.randn(64, generator=torch.Generator().manual_seed(9))
    batch.advantages = batch.advantages * 7.0 + 3.0
    config = Config(game="g", preset="sb3").policy
    coefficients = anneal(0.5, config)
    assert coefficients == Coefficients(
        3e-4, 0.2, 0.0, 0.5, clip_vloss=False, normalize_minibatch=True, sum_entropy=True
    )
    outputs = network(batch.observations)
    advantages = (batch.advantages - batch.advantages.mean()) / (batch.advantages.std() + 1e-8)
    ratio = torch.exp(joint_log_probs(outputs, network.log_variance, batch)[0] - batch.log_probs)
    policy = -torch.min(advantages * ratio, advantages * torch.clamp(ratio, 0.8, 1.2)).mean()
    expected = policy + 0.5 * torch.nn.functional.mse_loss(batch.returns, outputs.value)
    torch.testing.assert_close(ppo_loss(network, batch, coefficients)[0], expected)


def test_a_minibatch_of_one_row_is_not_divided_by_its_deviation():
    network, flat, batch = make(*SPACES["discrete"], rows=1)
    coefficients = replace(SAME, normalize_minibatch=True)
    for gradient in (ClosedFormGradient(network), partial(autograd_gradient, network)):
        assert np.isfinite(gradient(batch, torch.arange(1), coefficients)).all() and flat.grad.isfinite().all()


@pytest.mark.parametrize("autograd", [False, True])
def test_adam_divides_by_no_less_than_its_epsilon(autograd):
    steps = []
    for adam_eps in (1e-8, 1.0):
        network, flat, _ = make(*SPACES["hybrid"], rows=1)
        learner = Learner("x", network, branches=["a", "b"], gaussians=["x", "y"], autograd=autograd, adam_eps=adam_eps)
        before = learner.weights.detach().clone()
        flat.grad.fill_(0.5)
        learner.step(0.1)
        steps.append(float((before - learner.weights.detach()).mean()))
    assert steps == pytest.approx([0.1, 0.1 * 0.5 / 1.5], rel=1e-4)


@pytest.mark.parametrize("autograd", [False, True])
def test_weight_decay_is_that_of_adamw(autograd):
    network, flat, _ = make(*SPACES["hybrid"], rows=1)
    learner = Learner("x", network, branches=["a", "b"], gaussians=["x", "y"], autograd=autograd)
    theirs = learner.weights.detach().clone().requires_grad_()
    optimizer = torch.optim.AdamW([theirs], lr=0.1, weight_decay=0.3)
    for size in (0.5, -0.2):
        flat.grad.fill_(size)
        theirs.grad = flat.grad.clone()
        learner.step(0.1, 0.3)
        optimizer.step()
    torch.testing.assert_close(learner.weights.detach(), theirs.detach())


def compare_gradients(name, seed, activation, threads=1, coefficients=SAME):
    network, flat, batch = make(*SPACES[name], rows=200, seed=seed, activation=activation)
    if name == CONDITIONAL:
        parts = len(batch.discrete[0]) + len(batch.continuous[0])
        batch.counts = torch.rand(200, parts, generator=torch.Generator().manual_seed(seed)) < 0.6
        batch.log_probs = acted_log_probs(network, batch, 64)
    batch.log_probs += 0.3 * torch.randn(200, generator=torch.Generator().manual_seed(9))
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
    assert astuple(anneal(0.0, config))[:3] == pytest.approx((3e-4, 0.2, 0.05))
    assert astuple(anneal(0.5, config))[1:3] == pytest.approx((0.15, (0.05 + 1e-5) / 2))
    assert astuple(anneal(1.0, config))[:3] == pytest.approx((1e-10, 0.1, 1e-5))


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
        statistics = update(
            learner, batch, Coefficients(1e-9, 0.2, 0.05), epochs=1, minibatch_size=32, max_grad_norm=longest
        )
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
    alike = torch.full((1000,), 0.1) + torch.arange(1000) % 2 * 1e-8  # rounding errors
    assert explained_variance(torch.zeros(1000), alike) == 0.0


def update(
    learner,
    batch,
    coefficients=Coefficients(1e-3, 0.2, 0.05),  # noqa: B008
    **settings,
):
    return ppo_update(learner, batch, coefficients, PolicyConfig(**settings), np.random.default_rng(0))


def test_the_network_begins_as_the_original_does():
    network = Network(132, ActionSpace(2, (11, 3)), Towers([300, 300]), 0)
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
