"""How birds fly: the option `birds`. Straight as in the paper's game, or so that they are hard to foresee.

A jinking bird takes a new direction at random moments. A dodging one flees from the crosshair: it notices it within the
reaction radius and, after the reaction delay, dashes away from where it was. A blinking one is suddenly elsewhere.
Turning takes time: the direction of flight changes by the turn rate.
"""

import math

import numpy as np

from joybridge.simulator import option, parameter
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import integer, uniform
from joybridge.simulator.trigonometry import cosine, sine

HABITS = ["straight", "jinking", "dodging", "blinking", "mixed"]
STRAIGHT, JINKING, DODGING, BLINKING, MIXED = range(len(HABITS))

BIRDS_OPTION = option(
    "birds",
    HABITS,
    description="how birds fly. straight: across the field, as in the paper's game; jinking: with sudden turns; "
    "dodging: away from the crosshair; blinking: with blinks to places nearby; mixed: each bird in one of these ways",
)

PARAMETERS = [
    parameter("turn_rate", 0.0, 50.0, 20.0, "of jinking and dodging birds, rad/s"),
    parameter("reaction_radius", 0.0, 14.0, 7.0, "how far from a dodging bird it notices the crosshair, units"),
    parameter(
        "reaction_delay", 0.0, 1.0, 0.06, "time in which a dodging bird goes on after it noticed the crosshair, s"
    ),
    parameter("blink_period", 0.1, 10.0, 1.0, "mean time between two blinks of a blinking bird, s"),
]

# What a bird remembers. A straight one leaves all of it at zero.
MEMORY = [
    ("habit", "i8"),
    ("speed", "f8"),
    ("bound", "f8"),  # units/s; -1 or 1: the side that it flies to
    ("aim_x", "f8"),
    ("aim_y", "f8"),  # a vector in the direction that it turns to
    ("timer", "i8"),  # ticks: until the next jink or blink; of a dodging bird, see `_dodge`
]

TICK = 0.02  # s
JINK_ANGLE = np.pi * 0.4  # to both sides of the way across the field
JINK_SHORTEST, JINK_LONGEST = 0.15, 0.6  # s
DASH, DASH_TICKS = 4.0, 20  # factor on the speed of a bird that flees, and how long it does
BLINK_REACH = 4.0  # units, in both directions
LOWEST, HIGHEST = -9.4, 9.4  # where birds turn back
BLINK_X, BLINK_Y = 19.0, 8.4  # a blink does not pass them

BEGIN_DRAWS, STEER_DRAWS = 1, 3  # random numbers that a new bird takes, and one bird in a tick, at most


@compiled
def begin(bird, streams, i, habit):
    """Give a new bird, whose place and velocity are set, a habit: one of HABITS by its index."""
    if habit == STRAIGHT:
        return
    bird.habit = integer(streams, i, MIXED) if habit == MIXED else habit
    bird.speed, bird.bound = abs(bird.vx), 1.0 if bird.vx > 0.0 else -1.0
    bird.aim_x, bird.aim_y, bird.timer = bird.bound, 0.0, 0


@compiled
def steer(arena, streams, i, beyond):
    """Set the velocity of every bird, and let those blink whose time it is. beyond: units beside the middle screen."""
    time = arena.clock * TICK
    turn = arena.turn_rate * TICK
    turn_cosine, turn_sine = cosine(turn), sine(turn)
    for bird in arena.birds:
        if bird.wait > 0:
            continue
        if bird.habit == JINKING or bird.habit == DODGING:
            if bird.habit == JINKING:
                _jink(bird, streams, i)
            else:
                _dodge(bird, arena)
            if bird.habit == JINKING or bird.timer <= 0:
                _turn(bird, turn, turn_cosine, turn_sine)
        else:
            bird.vy = sine(2.0 * time + bird.phase)
            if bird.habit == BLINKING:
                _blink(bird, streams, i, arena.blink_period, BLINK_X + beyond)


@compiled
def _jink(bird, streams, i):
    """Aim at a new direction when the timer has run out."""
    bird.timer -= 1
    if bird.timer <= 0:
        angle = uniform(streams, i, -JINK_ANGLE, JINK_ANGLE)
        bird.aim_x, bird.aim_y = bird.bound * cosine(angle), sine(angle)
        bird.timer = int(uniform(streams, i, JINK_SHORTEST, JINK_LONGEST) / TICK + 0.5)


@compiled
def _dodge(bird, arena):
    """Notice the crosshair, and flee from where it was noticed.

    timer: 0: calm; positive: ticks until the bird reacts; negative: ticks for which it still flees.
    """
    if bird.timer == 0:
        dx, dy = bird.x - arena.x, bird.y - arena.y
        square = dx * dx + dy * dy
        if 0.0 < square <= arena.reaction_radius * arena.reaction_radius:
            bird.aim_x, bird.aim_y = dx, dy
            bird.timer = int(arena.reaction_delay / TICK + 0.5) + 1
    if bird.timer > 0:
        bird.timer -= 1
        if bird.timer == 0:
            bird.timer = -DASH_TICKS
    elif bird.timer < 0:
        bird.timer += 1
        if bird.timer == 0:
            bird.aim_x, bird.aim_y = bird.bound, 0.0


@compiled
def _turn(bird, turn, turn_cosine, turn_sine):
    """Turn the velocity of a bird towards its aim by at most `turn`, rad, and turn back at the edge of the sky."""
    if bird.speed == 0.0:
        return
    if (bird.y > HIGHEST and bird.aim_y > 0.0) or (bird.y < LOWEST and bird.aim_y < 0.0):
        bird.aim_y = -bird.aim_y
    ahead = bird.vx * bird.aim_x + bird.vy * bird.aim_y
    aside = bird.vx * bird.aim_y - bird.vy * bird.aim_x  # positive: the aim is to the left
    length = math.sqrt(ahead * ahead + aside * aside)
    if turn >= np.pi or ahead >= turn_cosine * length:
        vx, vy = bird.aim_x, bird.aim_y
    else:
        s = turn_sine if aside >= 0.0 else -turn_sine
        vx, vy = bird.vx * turn_cosine - bird.vy * s, bird.vx * s + bird.vy * turn_cosine
    if (bird.y > HIGHEST and vy > 0.0) or (bird.y < LOWEST and vy < 0.0):
        vy = -vy
    wanted = bird.speed * (DASH if bird.habit == DODGING and bird.timer < 0 else 1.0)
    per_unit = wanted / math.sqrt(vx * vx + vy * vy)
    bird.vx, bird.vy = vx * per_unit, vy * per_unit


@compiled
def _blink(bird, streams, i, period, reach):
    """Put a bird at a place nearby when the timer has run out."""
    bird.timer -= 1
    if bird.timer > 0:
        return
    if bird.timer == 0:
        x = bird.x + uniform(streams, i, -BLINK_REACH, BLINK_REACH)
        y = bird.y + uniform(streams, i, -BLINK_REACH, BLINK_REACH)
        bird.x, bird.y = min(max(x, -reach), reach), min(max(y, -BLINK_Y), BLINK_Y)
    bird.timer = max(int(uniform(streams, i, 0.5, 1.5) * period / TICK + 0.5), 1)
