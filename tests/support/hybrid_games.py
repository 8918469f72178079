"""Games of the hybrid suite, as tests put and play them."""

import math

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.games.hybrid_suite import soccer
from joybridge.games.hybrid_suite.goal import Goal
from joybridge.games.hybrid_suite.hard_move import HardMove

NEAR = 6e-7  # half a unit of the scenarios' last digit


def new_game(game, arenas=1, seed=5, noise=None, first_arena=0, **options):
    chosen = {option.name: option.default_choice for option in game.options} | options
    return game(chosen, {} if noise is None else {"noise": noise}, arenas, first_arena, seed)


def decide(game, choice, **axes):
    """Let the first arena decide; return its reward and its outcome. The episode is left as it ended."""
    device = type(game).describe(game_options(game)).behaviors[0].device
    values = np.zeros((1, len(device.axes)), np.float32)
    for index, axis in enumerate(device.axes):
        values[0, index] = axes.pop(axis.name, 0.0)
    assert not axes
    rewards = np.zeros(1)
    game.decide(ActArrays(values, np.array([np.atleast_1d(choice)], np.int32)), rewards)
    return float(rewards[0]), int(game.fields["outcome"][0])


def game_options(game):
    options = {option.name: option.default_choice for option in game.options}
    if isinstance(game, HardMove):
        options |= {"actuators": str(int(math.log2(len(game.motions)))), "choice": "joint"}
    return options


def put(game, **fields):
    for name, value in fields.items():
        game.fields[name] = value


def body(game, name):
    return game.fields[name][0]


def close(values, expected, tolerance=NEAR):
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=tolerance)


def kick_off(y, game=Goal, **options):
    game = new_game(game, noise=0.0, **options)
    soccer.place(game.arenas[0], y)
    return game


def state(game, *bodies):
    return [float(game.fields[each][0][field]) for each in bodies for field in ("x", "y", "vx", "vy")]
