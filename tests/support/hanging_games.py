"""Games that take too long, or raise what is not an error, in the part that the option `how` names."""

import asyncio
import signal
import sys
import time

import numpy as np

from joybridge.simulator import Game, behavior, button, option, sensor, spec, transition
from tests.support.games import Batch

FOREVER = 3600.0
HANGING = "hanging from now on"  # printed by a step that will not return
RAISED = {
    "cancelled": asyncio.CancelledError,
    "generator exit": GeneratorExit,
    "interrupt": KeyboardInterrupt,
    "exit": SystemExit,
}
HOW = option("how", ["none", "describe", "loop", "sleep", "draw", "stderr", *RAISED])


class Hangs(Game):
    name = "hangs"
    description = "Never return."
    options = (HOW, option("armed", ["no", "yes"]))  # "no": loading the game describes it under every single option

    @classmethod
    def describe(cls, options):
        if options == {"how": "describe", "armed": "yes"}:
            time.sleep(FOREVER)
        return spec(
            cls, [behavior("player", sensors=[sensor("light", [1])], branches=[button("press")])], picture=(2, 2)
        )

    def reset(self):
        return transition({"light": [0.0]})

    def step(self, action):
        match self.option["how"]:
            case "loop":
                print(HANGING, flush=True)
                while True:
                    pass
            case "sleep":
                print(HANGING, flush=True)
                time.sleep(FOREVER)
            case "stderr":
                sys.stderr.close()
            case how if how in RAISED:
                raise RAISED[how]
        return transition({"light": [0.0]})

    def draw(self):
        if self.option["how"] == "draw":
            time.sleep(FOREVER)
        return np.zeros((2, 2, 3), np.uint8)


class HangsAtOnce(Batch):
    """The same for a game over all arenas at once."""

    name = "hangs_at_once"
    description = "Never return, in all arenas at once."
    options = (HOW,)

    def __init__(self, options, parameters, arenas, first_arena, seed):
        self.how, self.arenas = options["how"], arenas

    def step(self, acts):
        if self.how == "sleep":
            time.sleep(FOREVER)
        if self.how in RAISED:
            raise RAISED[self.how]
        return self.observe()


class HangsTheLoop(HangsAtOnce):
    """A game that wrongly declares that its steps always end. The first step is played in the thread, as always."""

    name = "hangs_the_loop"
    in_event_loop = True
    steps = 0

    def step(self, acts):
        self.steps += 1
        if self.steps == 2:
            if hasattr(signal, "pthread_sigmask"):  # as where a signal comes just before a system call
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
            print(HANGING, flush=True)
            time.sleep(FOREVER)
        return self.observe()


PLACES = [f"{game.__module__}:{game.__name__}" for game in (Hangs, HangsAtOnce, HangsTheLoop)]
