"""The ball: who holds it charges it, and a throw flies to its receiver, wherever that goes."""

import math

from joybridge.games.beastly_rivals_full.beast import boost
from joybridge.games.beastly_rivals_full.state import CHARGE_FROM, TICK
from joybridge.simulator.compiled import compiled

HANDS = 8.0  # height at which the ball is thrown and caught
ABOVE, SINKING, SINKING_FAST = 20.0, 5.0, 75.0  # how far above the hands it aims at first; how that sinks, units/s
RISE_SECONDS, RISE_DISTANCE = 0.4, 100.0  # the ball rises for so long on a way of such a length
SPEED, SPEED_LIMIT = 45.0, 200.0  # units/s; power shots are faster
SPEED_SHARE, RISE_DIVISOR = 0.3, 2.5  # factor on the speed per unit of charge; power shots rise for a shorter time
CATCH_DISTANCE = 0.05
CHARGE_RATE = 2.0  # per s


@compiled
def throw(arena, i, j, rules):
    """Throw the ball from player i to player j, with power if it has charged. -1: from the pitch's center."""
    ball, receiver = arena.ball, arena.players[j]
    ball.x = ball.z = 0.0
    if i >= 0:
        ball.x, ball.z = arena.players[i].x, arena.players[i].z
    dx, dz = receiver.x - ball.x, receiver.z - ball.z
    distance = math.sqrt(dx * dx + HANDS * HANDS + dz * dz)
    ball.y, ball.above, ball.time, ball.flying = HANDS, ABOVE, 0.0, True
    ball.speed, ball.rise = SPEED * arena.ball_speed, RISE_SECONDS * distance / RISE_DISTANCE
    if i >= 0:
        arena.players[i].passes += 1
        if arena.hold >= CHARGE_FROM:
            ball.speed = min(SPEED * max(1.0, SPEED_SHARE * arena.charge), SPEED_LIMIT) * arena.ball_speed
            ball.rise *= distance / (RISE_DIVISOR * ball.speed)
            boost(arena, rules)
            arena.players[i].power_shots += 1
    arena.target, arena.last = j, i
    drop(arena)


@compiled
def drop(arena):
    """Take the ball from its carrier. The charge is lost."""
    arena.carrier = -1
    arena.hold, arena.charge = 0, 0.0


@compiled
def charge(arena):
    """Charge the ball if it has been held for long enough."""
    if arena.carrier >= 0:
        arena.hold += 1
        if arena.hold >= CHARGE_FROM:
            arena.charge += CHARGE_RATE * TICK
        arena.players[arena.carrier].ticks_with_ball += 1


@compiled
def fly(arena):
    """Move a flying ball by one tick towards the beast's target, who is its receiver and catches it at its hands."""
    ball = arena.ball
    if not ball.flying:
        return
    receiver = arena.players[arena.target]
    ball.time += TICK
    if ball.time > ball.rise:
        ball.above = max(0.0, ball.above - SINKING_FAST * TICK)
    else:
        ball.above -= SINKING * TICK
    dx, dy, dz = receiver.x - ball.x, HANDS + ball.above - ball.y, receiver.z - ball.z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    share = min(1.0, ball.speed * TICK / distance) if distance > 0.0 else 0.0
    ball.x += dx * share
    ball.y += dy * share
    ball.z += dz * share
    dx, dy, dz = receiver.x - ball.x, HANDS - ball.y, receiver.z - ball.z
    if math.sqrt(dx * dx + dy * dy + dz * dz) < CATCH_DISTANCE:
        arena.carrier = arena.target
        arena.hold, arena.charge, ball.flying = 0, 0.0, False
