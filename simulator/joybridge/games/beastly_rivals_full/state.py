"""The state of one match: a record with its players, its beast and its ball. `Rules` has the choices of the options.

The ground is the plane x-z with the pitch's center at (0, 0). Only the ball has a height. Directions are unit vectors.
Ticks of the future are absolute; 0 stands for none.
"""

from typing import NamedTuple

import numpy as np

TICK = 0.02  # s
DECISION_TICKS = 6
MAX_DECISIONS = 6000  # of an episode
MAX_PLAYERS = 8
MAX_LIVES = 9
CHANNELS = 6  # of rewards, see rules.py

PLAYER_SPEED = 15.0  # units/s
PLAYER_RADIUS = 2.0
BLINK_COOLDOWN = 750  # ticks between two blinks
BOOST_TICKS = 105  # how long a power shot changes the beast
CHARGE_FROM = 375  # ticks with the ball until it charges
MAX_CHARGE = 14.8  # a ball with more is hardly faster
WIND_UP = 30  # ticks from the end of a passer's turn to its throw

START, HUNT, DEAD, OVER = range(4)  # phases of a match; `DEAD`: between a death and the next ball


class Rules(NamedTuple):
    """What the options choose. The first four flags are quirks of the original."""

    enter_only: bool  # the beast kills only when it enters a carrier, not one that it already stands in
    ignores_short_moves: bool  # a standing player ignores a goal nearer than 2.5
    weak_shots_slow: bool  # a power shot slows the beast if it was charged for less than about 11 s
    overshoots: bool  # the beast's speed and turning pass their limits by one tick's growth, again and again
    zero_sum: bool  # rewards are differences to the mean of the other players
    players: int
    lives: int  # deaths that a player survives
    start_ticks: int  # until the first ball
    dead_ticks: int  # after a death, then
    revive_ticks: int  # until the next ball


PLAYER = np.dtype(
    [
        ("x", "f8"), ("z", "f8"), ("vx", "f8"), ("vz", "f8"), ("fx", "f8"), ("fz", "f8"),  # f: where it looks
        ("goal_x", "f8"), ("goal_z", "f8"), ("path_x", "f8"), ("path_z", "f8"),  # commanded; where it walks
        ("pass_x", "f8"), ("pass_z", "f8"), ("blink_x", "f8"), ("blink_z", "f8"),
        ("pointer_x", "f8"), ("pointer_z", "f8"), ("pointer_vx", "f8"), ("pointer_vz", "f8"),
        ("heading", "f8"),  # rad; only the locomotion "steer" turns it
        ("earned", "f8", CHANNELS),  # rewards since the player's last decision
        ("place", "f8"),  # 1 for the winner, 0 while it is open; equal players share the mean of their places
        ("has_goal", "?"), ("walking", "?"), ("alive", "?"), ("out", "?"), ("touching", "?"),
        ("lives", "i8"), ("kills", "i8"), ("seat", "i8"),
        ("pass_to", "i8"),  # the rival to which the player turns, -1: none; (pass_x, pass_z) is where it was
        ("throw_tick", "i8"), ("throw_to", "i8"),
        ("blink_tick", "i8"), ("blink_ready", "i8"),  # landing of a blink; from when on the next one is possible
        ("deaths", "i8"), ("humiliations", "i8"), ("passes", "i8"), ("power_shots", "i8"), ("blinks", "i8"),
        ("clicks", "i8"), ("ticks_alive", "i8"), ("ticks_with_ball", "i8"), ("out_tick", "i8"),
    ]
)  # fmt: skip
BEAST = np.dtype(
    [
        ("x", "f8"),
        ("z", "f8"),
        ("fx", "f8"),
        ("fz", "f8"),  # its root: position and heading
        ("gx", "f8"),
        ("gz", "f8"),  # heading of the body
        ("speed", "f8"),
        ("turning", "f8"),  # units/s, degrees/s
        ("boost_tick", "i8"),
        ("saved_speed", "f8"),
        ("saved_turning", "f8"),  # the end of a boost, and what follows
    ]
)
BALL = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("z", "f8"),
        ("above", "f8"),  # how far above the receiver's hands it aims
        ("time", "f8"),
        ("rise", "f8"),  # s since the throw; s until it sinks fast
        ("speed", "f8"),
        ("flying", "?"),
    ]
)
ARENA = np.dtype(
    [
        ("players", PLAYER, MAX_PLAYERS),
        ("beast", BEAST),
        ("ball", BALL),
        ("carrier", "i8"),
        ("target", "i8"),
        ("last", "i8"),  # who has the ball, is hunted, threw last; -1: nobody
        ("hold", "i8"),
        ("charge", "f8"),  # ticks with the ball; what they are worth for a power shot
        ("phase", "i8"),
        ("phase_tick", "i8"),
        ("victim", "i8"),  # end of the phase; who is revived then, -1: nobody
        ("tick", "i8"),
        ("beast_speed", "f8"),
        ("beast_turning", "f8"),
        ("ball_speed", "f8"),  # parameters
    ]
)
