"""The branched hybrid distribution agrees with torch.distributions."""

import numpy as np
import pytest
import torch
from torch.distributions import Categorical, Normal

from joybridge.layouts import ActionSpace
from joybridge.ppo.distributions import (
    FORBIDDEN,
    branch_entropies,
    chosen_log_probs,
    entropy_of_all,
    fill_masks,
    gaussian_log_probs,
)
from joybridge.ppo.fast.acting import empty_action
from joybridge.ppo.fast.kernels import NO_MASKS, Head, Noise, sample
from joybridge.ppo.networks import Network, Towers
from joybridge.ppo.observation_tensors import Observations

SIZES = (5, 3, 2)


def padded(*logits: torch.Tensor) -> torch.Tensor:
    """Return logits [lanes, branches, widest] of branches of different sizes."""
    widest = max(branch.shape[1] for branch in logits)
    return torch.stack(
        [torch.nn.functional.pad(branch, (0, widest - branch.shape[1]), value=FORBIDDEN) for branch in logits], 1
    )


def random_branches(lanes: int) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [torch.randn(lanes, size, generator=generator) * 2 for size in SIZES]


def test_branch_log_probs_and_entropies_are_those_of_independent_categoricals():
    branches = random_branches(64)
    choices = torch.stack([torch.arange(64) % size for size in SIZES], 1)
    log_p = torch.log_softmax(padded(*branches), -1)
    log_probs, entropy = chosen_log_probs(log_p, choices), branch_entropies(log_p).sum(-1)
    truth = [Categorical(logits=logits) for logits in branches]
    torch.testing.assert_close(log_probs, sum(d.log_prob(choices[:, i]) for i, d in enumerate(truth)))
    torch.testing.assert_close(entropy, sum(d.entropy() for d in truth))


def test_gaussian_log_probs_are_summed_and_their_entropy_is_the_mean_over_dimensions():
    mean, log_variance = torch.randn(32, 3), torch.tensor([0.0, -1.0, 0.7])
    samples = torch.randn(32, 3)
    truth = Normal(mean, torch.exp(0.5 * log_variance))
    log_probs, entropy = gaussian_log_probs(mean, log_variance, samples)
    torch.testing.assert_close(log_probs, truth.log_prob(samples).sum(-1))
    torch.testing.assert_close(entropy, truth.entropy()[0].mean())


def test_masks_add_nothing_to_what_is_allowed_and_to_branches_that_are_wider():
    masks = np.full((2, 2, 3), 7.0, np.float32)
    fill_masks([np.array([[True, False], [True, True]]), np.array([[True] * 3, [False, True, True]])], masks)
    assert masks.tolist() == [[[0, FORBIDDEN, 0], [0, 0, 0]], [[0, 0, 0], [FORBIDDEN, 0, 0]]]
    fill_masks(None, masks)
    assert not masks.any()


@pytest.mark.parametrize(
    ("entropies", "counts", "mean", "total"),
    [
        ([[1.0, 2.0], [3.0, 6.0]], None, 3.0, 6.0),
        ([[1.0, 2.0], [3.0, 6.0]], [[True, False], [True, True]], (1.0 + 4.5) / 2, (1.0 + 9.0) / 2),
        ([[1.0, 2.0]], [[True, False], [True, True], [False, False]], (1.0 + 1.5) / 3, (1.0 + 3.0) / 3),
        ([[1.0, 2.0, 4.0]], [[True, False, True]], 2.5, 5.0),
    ],
)
def test_entropies_of_actions_that_count_are_averaged_or_summed_in_each_row(entropies, counts, mean, total):
    given = None if counts is None else torch.tensor(counts)
    assert entropy_of_all(torch.tensor(entropies), given, summed=False).item() == pytest.approx(mean)
    assert entropy_of_all(torch.tensor(entropies), given, summed=True).item() == pytest.approx(total)


def sampled(outputs, uniform, normal, log_variance=(), sizes=SIZES, likeliest=False, masks=None):
    """Return the choices, continuous actions and log-probabilities that the compiled sampling gives."""
    head = Head(
        np.zeros(len(log_variance), np.float32),
        np.array(log_variance, np.float32),
        np.array(sizes, np.int64),
    )
    masks = NO_MASKS if masks is None else masks.numpy()
    noise = Noise(normal, uniform)
    action = empty_action(noise)
    sample(outputs.numpy(), head, masks, noise, likeliest, action)
    return torch.from_numpy(action.discrete), torch.from_numpy(action.continuous), torch.from_numpy(action.log_probs)


def test_sampled_branches_follow_their_probabilities_and_never_take_a_forbidden_choice():
    lanes = 200_000
    logits = padded(*[branch[:1] for branch in random_branches(1)]).repeat(lanes, 1, 1)
    logits[:, 0, 1] = FORBIDDEN
    uniform = np.random.default_rng(1).random((lanes, 3), np.float32)
    choices, _, log_probs = sampled(logits.reshape(lanes, -1), uniform, np.zeros((lanes, 0), np.float32))
    truth = torch.softmax(logits[0], -1)
    for branch, size in enumerate(SIZES):
        frequency = torch.bincount(choices[:, branch], minlength=5) / len(choices)
        torch.testing.assert_close(frequency, truth[branch], atol=0.005, rtol=0)
        assert frequency[size:].sum() == 0
    assert (choices[:, 0] != 1).all()
    torch.testing.assert_close(log_probs, chosen_log_probs(torch.log_softmax(logits, -1), choices))


def test_masked_choices_are_never_sampled_and_the_log_probability_is_that_of_the_masked_distribution():
    lanes = 20_000
    rng = np.random.default_rng(4)
    logits = padded(*random_branches(lanes))
    allowed = [rng.random((lanes, size)) < 0.5 for size in SIZES]
    for branch in allowed:
        branch[np.arange(lanes), rng.integers(branch.shape[1], size=lanes)] = True  # one is always allowed
    masks = np.zeros((lanes, 3, 5), np.float32)
    fill_masks(allowed, masks)
    uniform, nothing = rng.random((lanes, 3), np.float32), np.zeros((lanes, 0), np.float32)
    choices, _, log_probs = sampled(logits.reshape(lanes, -1), uniform, nothing, masks=torch.from_numpy(masks))
    for column, mask in enumerate(allowed):
        assert mask[np.arange(lanes), choices[:, column]].all()
    masked = torch.log_softmax(logits + torch.from_numpy(masks), -1)
    torch.testing.assert_close(log_probs, chosen_log_probs(masked, choices))


@pytest.mark.parametrize(("uniform", "choice"), [(0.0, 1), (1.0 - 2**-24, 2)])
def test_the_extremes_of_the_uniform_numbers_stay_within_allowed_choices(uniform, choice):
    outputs = torch.tensor([[FORBIDDEN, 0.3, 0.1, FORBIDDEN]])
    noise = np.zeros((1, 0), np.float32)
    choices, _, _ = sampled(outputs, np.array([[uniform]], np.float32), noise, sizes=(4,))
    assert choices.item() == choice


def test_sampled_gaussians_have_the_mean_and_spread_asked_for_and_their_log_probability():
    lanes, log_variance = 100_000, (0.0, -2.0)
    mean = torch.tensor([[1.0, -2.0]]).repeat(lanes, 1)
    noise = np.random.default_rng(2).standard_normal((lanes, 2), np.float32)
    _, samples, log_probs = sampled(mean, np.zeros((lanes, 0), np.float32), noise, log_variance, sizes=())
    torch.testing.assert_close(samples.mean(0), torch.tensor([1.0, -2.0]), atol=0.02, rtol=0)
    torch.testing.assert_close(samples.std(0), torch.exp(torch.tensor([0.0, -1.0])), atol=0.02, rtol=0)
    torch.testing.assert_close(log_probs, gaussian_log_probs(mean, torch.tensor(log_variance), samples)[0])


def test_the_likeliest_action_is_the_largest_logit_and_the_mean():
    logits = padded(*random_branches(64))
    outputs = torch.cat([logits.reshape(64, -1), torch.randn(64, 2)], 1)
    uniform, normal = np.full((64, 3), 0.99, np.float32), np.ones((64, 2), np.float32)
    choices, samples, _ = sampled(outputs, uniform, normal, (0.0, 0.0), likeliest=True)
    assert (choices == logits.argmax(-1)).all() and (samples == outputs[:, -2:]).all()


def test_ordinal_log_probs_and_entropies_are_those_of_tang_and_agrawal():
    network = Network(6, ActionSpace(0, (5, 3), ordinal=(0,)), Towers([16], shared=True), seed=1)
    observations = torch.randn(64, 6, generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        network.actor.head.weight *= 30.0
        raw = network.actor.head(network.actor(observations)[0])
        logits = network(Observations(observations)).logits
    below, beyond = (torch.nn.functional.logsigmoid(sign * raw[:, :5]) for sign in (1, -1))
    ordinal = torch.stack([below[:, : j + 1].sum(1) + beyond[:, j + 1 :].sum(1) for j in range(5)], 1)
    truth = [Categorical(logits=ordinal), Categorical(logits=raw[:, 5:8])]
    choices = torch.stack([torch.arange(64) % size for size in (5, 3)], 1)
    log_p = torch.log_softmax(logits, -1)
    torch.testing.assert_close(
        chosen_log_probs(log_p, choices), sum(d.log_prob(choices[:, i]) for i, d in enumerate(truth))
    )
    torch.testing.assert_close(branch_entropies(log_p), torch.stack([d.entropy() for d in truth], 1))
    assert ordinal.std() > 1.0
