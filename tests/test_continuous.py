"""Distributions of continuous actions agree with torch.distributions, with their own integrals and with autograd."""

import math

import numpy as np
import pytest
import torch
from torch.distributions import AffineTransform, Normal, TanhTransform, TransformedDistribution

from joybridge.config.errors import ConfigError
from joybridge.layouts import CLIP
from joybridge.layouts.layout import GAUSSIAN, GSDE
from joybridge.ppo.continuous import (
    Distribution,
    entropies_of_each,
    load_distributions,
    log_probs_of_each,
    noise_holds,
    sample_each,
    softplus,
)
from joybridge.ppo.continuous.beta import Beta
from joybridge.ppo.continuous.gaussian import Gaussian
from joybridge.ppo.continuous.squashed import Squashed
from tests.support.own_layouts import Laplace

ALL: list[Distribution] = [Gaussian(), Squashed(), Beta(), Laplace()]
ROWS = 40


def given(distribution: Distribution) -> tuple[torch.Tensor, torch.Tensor]:
    """Return outputs of a network and free parameters, in 64 bits."""
    generator = torch.Generator().manual_seed(2)
    outputs = 1.5 * torch.randn(distribution.outputs, ROWS, generator=generator, dtype=torch.float64)
    return outputs, torch.full((distribution.parameters,), -0.6, dtype=torch.float64)


def concentrations(outputs: torch.Tensor) -> torch.Tensor:
    return 1.0 + torch.nn.functional.softplus(outputs)


def truth(
    distribution: Distribution, outputs: torch.Tensor, parameters: torch.Tensor
) -> torch.distributions.Distribution:
    """Return the same distribution as torch has it."""
    if isinstance(distribution, Beta):
        return TransformedDistribution(
            torch.distributions.Beta(*concentrations(outputs)), [AffineTransform(-CLIP, 2 * CLIP)]
        )
    normal = Normal(outputs[0], torch.exp(0.5 * parameters))
    if isinstance(distribution, Gaussian):
        return normal
    return TransformedDistribution(normal, [TanhTransform(), AffineTransform(0.0, CLIP)])


@pytest.mark.parametrize("distribution", ALL[:3], ids=lambda each: type(each).__name__)
def test_log_probs_and_entropies_are_those_of_torch(distribution):
    outputs, parameters = given(distribution)
    samples = distribution.sample(outputs, parameters, torch.linspace(-2.5, 2.5, ROWS, dtype=torch.float64))
    same = truth(distribution, outputs, parameters)
    torch.testing.assert_close(distribution.log_prob(outputs, parameters, samples), same.log_prob(samples))
    entropy = distribution.entropy(outputs, parameters)
    if isinstance(distribution, Beta):
        torch.testing.assert_close(entropy, torch.distributions.Beta(*concentrations(outputs)).entropy() + math.log(6))
    elif isinstance(distribution, Gaussian):
        torch.testing.assert_close(entropy, same.entropy())


@pytest.mark.parametrize("distribution", ALL, ids=lambda each: type(each).__name__)
def test_densities_integrate_to_1_to_the_entropy_and_to_the_share_of_samples_below_one(distribution):
    outputs, parameters = given(distribution)
    bounded = isinstance(distribution, Beta | Squashed)
    edges = torch.linspace(-CLIP if bounded else -30, CLIP if bounded else 30, 20_001, dtype=torch.float64)
    width, middles = edges[1] - edges[0], (edges[1:] + edges[:-1]) / 2
    for row in range(0, ROWS, 8):
        wide = outputs[:, row : row + 1].expand(-1, len(middles))
        log_p = distribution.log_prob(wide, parameters, middles)
        p = log_p.exp()
        assert float(p.sum() * width) == pytest.approx(1.0, abs=1e-3)
        entropy = distribution.entropy(outputs[:, row : row + 1], parameters)
        assert float(-(p * log_p).sum() * width) == pytest.approx(float(entropy), abs=0.01)
        below = torch.cumsum(p, 0) * width
        for noise in (-2.0, -1.0, 0.0, 1.0, 2.0):
            sample = distribution.sample(
                outputs[:, row : row + 1], parameters, torch.tensor([noise], dtype=torch.float64)
            )
            share = np.interp(sample.item(), edges[1:], below)
            assert share == pytest.approx(0.5 * (1 + math.erf(noise / math.sqrt(2))), abs=3e-3)


@pytest.mark.parametrize("distribution", ALL, ids=lambda each: type(each).__name__)
@pytest.mark.parametrize("size", [0.0, 30.0, -30.0])
def test_extreme_outputs_and_noise_give_finite_numbers_and_gradients(distribution, size):
    outputs = torch.full((distribution.outputs, 3), size, requires_grad=True)
    parameters = torch.full((distribution.parameters,), -4.0, requires_grad=True)
    with torch.no_grad():
        samples = distribution.sample(outputs.detach(), parameters, torch.tensor([-6.0, 0.0, 6.0]))
    total = distribution.log_prob(outputs, parameters, samples).sum() + distribution.entropy(outputs, parameters).sum()
    total.backward()
    assert samples.dtype == torch.float32 and total.isfinite()
    assert outputs.grad is not None and outputs.grad.isfinite().all()
    if distribution.parameters:
        assert parameters.grad is not None and parameters.grad.isfinite().all()


def test_several_actions_each_have_columns_and_parameters_of_their_own():
    distributions = ALL[1:]
    outputs, parameters = torch.randn(ROWS, 4, dtype=torch.float64), torch.tensor([-1.0, -0.3], dtype=torch.float64)
    noise = torch.randn(ROWS, 3, dtype=torch.float64)
    samples = sample_each(distributions, outputs, parameters, noise)
    log_probs = log_probs_of_each(distributions, outputs, parameters, samples)
    entropies = entropies_of_each(distributions, outputs, parameters)
    rows = outputs.t()
    parts = [(rows[:1], parameters[:1]), (rows[1:3], parameters[:0]), (rows[3:], parameters[1:])]
    alone = zip(distributions, parts, range(3), strict=True)
    each = [(d.sample(*part, noise[:, i]), d.log_prob(*part, samples[:, i]), d.entropy(*part)) for d, part, i in alone]
    torch.testing.assert_close(samples, torch.stack([one for one, _, _ in each], 1))
    torch.testing.assert_close(log_probs, sum(one for _, one, _ in each))
    torch.testing.assert_close(entropies, torch.stack([one for _, _, one in each]))
    assert np.abs(samples[:, :2].numpy()).max() <= CLIP


def test_gsde_is_a_gaussian_whose_noise_is_linear_in_the_features():
    gsde = load_distributions([f"{GSDE}-3"], 5)[0]
    outputs, parameters = torch.randn(6, ROWS, dtype=torch.float64), torch.randn(5, dtype=torch.float64)
    noise = torch.randn(5, 1, dtype=torch.float64).expand(5, ROWS)
    samples = gsde.sample(outputs, parameters, noise)
    linear = outputs[1:].t() @ (torch.exp(parameters) * noise[:, 0])
    torch.testing.assert_close(samples, outputs[0] + linear)
    deviation = (outputs[1:].square().t() @ torch.exp(2.0 * parameters)).sqrt()
    same = Normal(outputs[0], deviation)
    log_probs, entropies = gsde.log_prob(outputs, parameters, samples), gsde.entropy(outputs, parameters)
    torch.testing.assert_close(log_probs, same.log_prob(samples), atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(entropies, same.entropy(), atol=1e-4, rtol=1e-4)


def test_noise_is_kept_as_long_as_each_distribution_says():
    distributions = load_distributions([GAUSSIAN, f"{GSDE}-3"], 2)
    assert noise_holds(distributions).tolist() == [1, 3, 3]


@pytest.mark.parametrize("name", ["nowhere:Beta", "math:Beta", "os:environ", "joybridge.ppo.continuous.beta:Beta-2"])
def test_a_distribution_that_is_not_there_is_named(name):
    with pytest.raises(ConfigError, match=f"layout: the distribution '{name}' cannot be loaded: "):
        load_distributions([name], 4)


def test_softplus_has_the_gradient_of_torch_at_zero_too():
    x = torch.tensor([-30.0, -1.0, 0.0, 1.0, 30.0], requires_grad=True)
    (own,) = torch.autograd.grad(softplus(x).sum(), x)
    (theirs,) = torch.autograd.grad(torch.nn.functional.softplus(x).sum(), x)
    torch.testing.assert_close(own, theirs)
