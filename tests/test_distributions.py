"""The branched hybrid distribution agrees with torch.distributions."""

import torch
from torch.distributions import Categorical, Normal

from trainer.distributions import (
    FORBIDDEN,
    branch_entropy,
    chosen_log_probs,
    gaussian_log_probs,
    sample_branches,
    sample_gaussians,
)

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
    log_probs, entropy = chosen_log_probs(log_p, choices), branch_entropy(log_p)
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


def test_sampled_branches_follow_their_probabilities_and_never_take_a_forbidden_choice():
    logits = padded(*[branch[:1] for branch in random_branches(1)]).repeat(200_000, 1, 1)
    logits[:, 0, 1] = FORBIDDEN
    uniform = torch.rand(200_000, 3, generator=torch.Generator().manual_seed(1))
    choices = sample_branches(torch.log_softmax(logits, -1), uniform)
    truth = torch.softmax(logits[0], -1)
    for branch, size in enumerate(SIZES):
        frequency = torch.bincount(choices[:, branch], minlength=5) / len(choices)
        torch.testing.assert_close(frequency, truth[branch], atol=0.005, rtol=0)
        assert frequency[size:].sum() == 0
    assert (choices[:, 0] != 1).all()


def test_the_extremes_of_the_uniform_numbers_stay_within_allowed_choices():
    log_p = torch.log_softmax(torch.tensor([[[FORBIDDEN, 0.3, 0.1, FORBIDDEN]]]), -1)
    assert sample_branches(log_p, torch.tensor([[0.0]])).item() == 1
    assert sample_branches(log_p, torch.tensor([[1.0 - 2**-24]])).item() == 2


def test_sampled_gaussians_have_the_mean_and_spread_asked_for():
    noise = torch.randn(100_000, 2, generator=torch.Generator().manual_seed(2))
    samples = sample_gaussians(torch.tensor([[1.0, -2.0]]).expand(100_000, 2), torch.tensor([0.0, -2.0]), noise)
    torch.testing.assert_close(samples.mean(0), torch.tensor([1.0, -2.0]), atol=0.02, rtol=0)
    torch.testing.assert_close(samples.std(0), torch.exp(torch.tensor([0.0, -1.0])), atol=0.02, rtol=0)
