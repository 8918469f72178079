"""The growth of memory is told from noise."""

import numpy as np
import pytest

from tools.soak import LIMIT, slope


@pytest.mark.promise("F8")
def test_growth_is_found_and_noise_is_not():
    hours = np.linspace(1.0, 3.0, 240)
    noise = np.random.default_rng(0).normal(0.0, 3.0, len(hours))
    growth, half = slope(hours.tolist(), (200.0 + 10.0 * hours + noise).tolist())
    assert abs(growth - 10.0) < half and growth - half > LIMIT
    growth, half = slope(hours.tolist(), (200.0 + noise).tolist())
    assert abs(growth) < half and growth - half < LIMIT
