"""Rules that are interpreted, which coverage and a debugger can see, give the bytes of compiled ones."""

from importlib import import_module

import pytest

from tests.support.measured import interpreted

PLAYED = [
    "beastly_rivals_full_game",
    "beastly_rivals_game",
    "generated_levels",
    "generated_pitches",
    "hybrid_suite",
    "shooting_birds_bits",
]


@pytest.mark.parametrize("played", PLAYED)
def test_interpreted_rules_give_the_bytes_of_compiled_ones(played):
    module = f"tests.test_{played}"
    assert interpreted("tests.support.digest", module).split()[-1] == import_module(module).digest_of_a_short_run()
