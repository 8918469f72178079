"""Servers that break rules of seeds and arenas."""

import numpy as np

from tests.support.broken_servers.gauntlet import DRAWS, Gauntlet
from tests.support.broken_servers.serving import broken


@broken(
    "different_seeds_give_different_episodes", "high_bits_of_a_seed_are_used", "largest_seeds_give_different_episodes"
)
class IgnoresTheSeed(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else 7, parameters)


@broken("high_bits_of_a_seed_are_used")
class HalfASeed(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else seed % 2**32, parameters)


@broken("largest_seeds_give_different_episodes")
class SeedIsADouble(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(None if seed is None else int(float(seed)), parameters)


@broken(
    "arena_does_not_depend_on_the_number_of_arenas",
    "first_arena_selects_the_arena_numbers",
    "arena_numbers_may_exceed_32_bits",
)
class SeedsDependOnTheArenas(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed, self.first_arena + arena, self.arenas, self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("first_arena_selects_the_arena_numbers")
class IgnoresFirstArena(Gauntlet):
    def __init__(self, options, parameters, arenas, first_arena, seed):
        super().__init__(options, parameters, arenas, 0, seed)


@broken("seed_and_arena_are_two_numbers")
class SeedPlusArena(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed + self.first_arena + int(arena), self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("arena_numbers_do_not_wrap_around")
class ArenasOf32Bits(Gauntlet):
    def draws(self, arena):
        self.counts[arena, DRAWS] += 1
        key = [self.seed, (self.first_arena + arena) % 2**32, self.counts[arena, DRAWS]]
        return np.random.default_rng(key).normal(size=2)


@broken("reset_without_seed_begins_different_episodes")
class ResetsToTheBeginning(Gauntlet):
    def reset(self, seed, parameters):
        super().reset(self.seed if seed is None else seed, parameters)
