"""A game in which each arena does what its action says: nothing, raise, end the process, or never return."""

import os
import time

from joybridge.simulator import Game, behavior, branch, sensor, spec, transition

NOTHING, RAISE, EXIT, HANG = range(4)
STATUS = 7  # with which the process ends


class Doomed(Game):
    name = "doomed"
    description = "Do as told."

    @classmethod
    def describe(cls, options):
        fates = branch("fate", ["nothing", "raise", "exit", "hang"])
        return spec(cls, [behavior("player", sensors=[sensor("light", [1])], branches=[fates])])

    def reset(self):
        return transition({"light": [self.rng.random()]})

    def step(self, action):
        match action["fate"]:
            case 1:
                raise ValueError("as told")
            case 2:
                os._exit(STATUS)
            case 3:
                time.sleep(3600)
        return transition({"light": [self.rng.random()]})
