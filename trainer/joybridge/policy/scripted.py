"""A script of the game's author in seats: the simulator plays it, so nothing is computed here."""

import numpy as np

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class Script:
    """A script that plays agents of one behavior, as a player in seats of a table."""

    rng: np.random.Generator

    def __init__(self, name: str, behavior: int, number: int) -> None:
        """behavior: its index in the spec. number: of the script among those of the behavior, from 1 on."""
        self.name, self.behavior, self.number, self.seed = name, behavior, number, 0

    def seat(self, lanes: int) -> "Script":
        """Return what plays in so many lanes."""
        return self

    def begin(self, step: StepArrays) -> None:
        """Take the first observations: a script sees the game itself."""

    def act(self, step: StepArrays, act: ActArrays, held: Array) -> None:
        """Hand some lanes, by their numbers, to the script."""
        if act.scripts is None:
            act.scripts = np.zeros(len(act.choices), np.int32)
        act.scripts[held] = self.number

    def store(self, step: StepArrays, held: Array) -> None:
        """Take what followed; nothing is remembered."""

    def state(self, held: Array | None = None) -> dict[str, Array]:
        """Return nothing: what a script does depends on the state of its arena alone."""
        return {}

    def load(self, state: dict[str, Array], held: Array | None = None) -> None:
        """Take back what `state` returned."""


def find_scripts(spec: pb.GameSpec, name: str) -> list[Script]:
    """Return a script for all behaviors of a game. Raises ConfigError unless each of them has it."""
    found = []
    for index, behavior in enumerate(spec.behaviors):
        known = [script.name for script in behavior.scripts]
        if name not in known:
            has = f"has {', '.join(known)}" if known else "has none"
            raise ConfigError(f"script:{name}: {spec.name} has no such script for {behavior.name}, which {has}")
        found.append(Script(name, index, known.index(name) + 1))
    return found
