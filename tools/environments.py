"""An environment with axes and buttons that is in no registry: Mars Rover of the planning competition of 2023."""

from typing import Any

import gymnasium

NAME = "MarsRover-v0"


def make() -> Any:
    """Return two rovers with a power along two axes and a button to harvest each. It needs pyRDDLGym."""
    import pyRDDLGym  # type: ignore[import-not-found]

    return pyRDDLGym.make("MarsRover_ippc2023", "1")


gymnasium.register(NAME, entry_point=make)
