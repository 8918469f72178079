"""A game whose one observation is as large as the contract allows: 64 MiB."""

import numpy as np

from joybridge.simulator import BatchedGame, behavior, button, quiet_step, sensor, spec

SHAPE = (16, 1024, 1024)


class Wide(BatchedGame):
    name = "wide"
    description = "See very much."

    @classmethod
    def describe(cls, options):
        return spec(
            cls, [behavior("player", sensors=[sensor("sight", SHAPE)], branches=[button("press")])], max_arenas=1
        )

    def __init__(self, options, parameters, arenas, first_arena, seed):
        self.sight = np.random.default_rng(seed).random((arenas, *SHAPE), np.float32)

    def reset(self, seed, parameters):
        pass

    def observe(self):
        return [quiet_step([self.sight], 1)]

    def step(self, acts):
        self.sight = self.sight[..., ::-1].copy()
        return self.observe()
