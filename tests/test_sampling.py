"""Under any layout, also of another package, samples are allowed, their log-probabilities right, and rows alone."""

import re

import numpy as np
import pytest
import torch

from joybridge.layouts import list_roles
from joybridge.ppo.distributions import fill_masks
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.fast.kernels import Noise, draw_noise
from joybridge.ppo.loss import Batch, autograd_gradient, joint_log_probs
from joybridge.ppo.networks import Network, Towers, flatten_parameters
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.sampling import sample_actions
from joybridge.ppo.schedule import Coefficients
from tests.test_layouts_learn import SPEC

LANES = 64
NAMES = [
    "hybrid",
    "bucket-5",
    "bucket-6-mu",
    "joint-3",
    "ordinal-5",
    "threshold-0.0",
    "multiagent",
    "beta",
    "squashed",
    "gsde-4",
    "compass-8",
    "laplace",
    "beta, y=squashed, a=threshold-0.0",
    "hybrid, x=ordinal-4, y=laplace",
    "gsde-1, y=beta",
]


pytestmark = pytest.mark.usefixtures("other_package")


def networks(name: str):
    """Yield a network with large random weights for each policy of a layout, and the layout."""
    for role in list_roles(name, SPEC):
        network = Network(5, role.layout.space, Towers([16]), seed=1)
        with torch.no_grad():
            network.actor.head.weight *= 10.0
            network.log_variance.add_(0.3)
            network.mean_bias.sub_(0.2)
        yield network, role.layout


draw = torch.inference_mode()(sample_actions)


def made(name: str, masked: bool):
    """Yield what is sampled by each policy of a layout."""
    rng = np.random.default_rng(3)
    device_masks = [rng.random((LANES, len(branch.choices))) < 0.6 for branch in SPEC.behaviors[0].device.branches]
    for mask in device_masks:
        mask[:, 0] = True
    for network, layout in networks(name):
        space = layout.space
        masks = np.zeros((LANES, len(space.branches), space.widest), np.float32)
        allowed = layout.masks(device_masks) if masked else [np.ones((LANES, size), bool) for size in space.branches]
        fill_masks(allowed, masks)
        noise = draw_noise(rng, (LANES, len(network.noise_holds)), (LANES, len(space.branches)))
        observations = Observations(torch.from_numpy(rng.normal(size=(LANES, 5)).astype(np.float32)))
        with torch.no_grad():
            outputs, values, _ = network.heads(observations)
        action = draw(network, outputs, masks, noise, deterministic=False)
        batch = Batch(
            observations,
            torch.from_numpy(action.continuous),
            torch.from_numpy(action.discrete),
            torch.from_numpy(masks),
            torch.from_numpy(action.log_probs),
            values,
            torch.ones(LANES),
            values + 1.0,
        )
        yield network, outputs, masks, allowed, noise, action, batch


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("masked", [False, True])
def test_samples_are_allowed_and_their_log_probabilities_are_those_of_the_loss(name, masked):
    for network, _, _, allowed, _, action, batch in made(name, masked):
        for column, mask in enumerate(allowed):
            assert mask[np.arange(LANES), action.discrete[:, column]].all()
        assert np.isfinite(action.continuous).all() and np.isfinite(action.log_probs).all()
        outputs = network(batch.observations)
        log_probs, entropy, entropies = joint_log_probs(outputs, network.log_variance, batch, network.distributions)
        torch.testing.assert_close(log_probs, batch.log_probs, atol=2e-5, rtol=1e-5)
        assert entropy.isfinite() and entropies.isfinite().all()


@pytest.mark.parametrize("name", NAMES)
def test_a_row_is_sampled_alike_alone_and_among_others(name):
    for network, outputs, masks, _, noise, action, _ in made(name, masked=True):
        for size in (1, 7, 33):
            parts = []
            for begin in range(0, LANES, size):
                rows = slice(begin, begin + size)
                part = Noise(*(array[rows] for array in noise))
                parts.append(draw(network, outputs[rows], masks[rows], part, deterministic=False))
            for whole, pieces in zip(action, zip(*parts, strict=True), strict=True):
                assert whole.tobytes() == np.concatenate(pieces).tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_deterministic_play_ignores_the_noise_and_takes_allowed_choices(name):
    for network, outputs, masks, allowed, noise, _, _ in made(name, masked=True):
        first = draw(network, outputs, masks, noise, deterministic=True)
        other = Noise(noise.normal + 1, np.zeros_like(noise.uniform))
        second = draw(network, outputs, masks, other, deterministic=True)
        np.testing.assert_array_equal(first.discrete, second.discrete)
        np.testing.assert_array_equal(first.continuous, second.continuous)
        for column, mask in enumerate(allowed):
            assert mask[np.arange(LANES), first.discrete[:, column]].all()


@pytest.mark.parametrize("name", [name for name in NAMES if not re.search("beta|squash|laplace|gsde", name)])
def test_the_gradient_in_closed_form_is_that_of_autograd(name):
    coefficients, every = Coefficients(1e-3, 0.2, 0.05), torch.arange(LANES)
    for network, *_, batch in made(name, masked=True):
        flat = flatten_parameters(network)
        batch.log_probs = batch.log_probs + 0.3 * torch.randn(LANES, generator=torch.Generator().manual_seed(9))
        reference = autograd_gradient(network, batch, every, coefficients)
        assert flat.grad is not None
        gradient = flat.grad.clone()
        statistics = ClosedFormGradient(network)(batch, every, coefficients)
        np.testing.assert_allclose(statistics, reference, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(flat.grad, gradient, atol=1e-6, rtol=1e-5)
