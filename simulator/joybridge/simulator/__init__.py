"""What authors of games import. The simulator itself (server and sessions) is in the other modules.

    A game       Game, TimeStep, Action, Array
    A timestep   transition, waiting, termination, truncation
    A spec       spec, behavior, sensor, image, axis, branch, button, channel, metric, option, parameter, GameSpec
    For speed    BatchedGame, ActArrays, StepArrays, quiet_step, check_range, draw_parameters, GameError

A whole game is in the docstring of `joybridge.simulator.game`; `joybridge new` writes one to start from. Helpers for
pictures are in `joybridge.simulator.render`, which needs pygame.
"""

import os

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import BatchedGame, GameError, check_range, quiet_step
from joybridge.simulator.distributions import draw_parameters
from joybridge.simulator.game import Action, Game, TimeStep, termination, transition, truncation, waiting
from joybridge.simulator.spec_parts import (
    axis,
    behavior,
    branch,
    button,
    channel,
    image,
    metric,
    option,
    parameter,
    sensor,
    spec,
)
from joybridge.v1.bridge_pb2 import GameSpec

__all__ = [
    "ActArrays",
    "Action",
    "Array",
    "BatchedGame",
    "Game",
    "GameError",
    "GameSpec",
    "StepArrays",
    "TimeStep",
    "axis",
    "behavior",
    "branch",
    "button",
    "channel",
    "check_range",
    "draw_parameters",
    "image",
    "metric",
    "option",
    "parameter",
    "quiet_step",
    "sensor",
    "spec",
    "termination",
    "transition",
    "truncation",
    "waiting",
]

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # keep pygame's banner out of the server's output
