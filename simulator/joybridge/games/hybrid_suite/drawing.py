"""Pictures of the suite: a run over platforms, a half field with a keeper, a particle, and an agent with a heading."""

import numpy as np
import numpy.typing as npt
import pygame

from joybridge.contract.tensors import Array
from joybridge.games.hybrid_suite import platform_rules as p
from joybridge.games.hybrid_suite import soccer as s
from joybridge.simulator.render import FINE, Color, Frame, block, disc, fade, fit, picture, shape, write

INK, PAPER, GRID = (44, 52, 66), (246, 244, 238), (224, 222, 214)
BLUE, RED, GREEN, AMBER, WHITE = (56, 118, 190), (206, 66, 58), (78, 160, 96), (238, 170, 52), (252, 252, 250)
SKY, HORIZON, EARTH, GRASS = (150, 198, 232), (234, 244, 246), (120, 92, 70), (112, 168, 90)
FIELD, FIELD_DARK = (92, 156, 86), (84, 146, 80)
VIEW = 1.3  # of the plane, units from the middle to an edge


def draw_platform(arena: np.record, width: int, height: int) -> Array:
    """Return a picture of Platform, uint8 [height, width, 3]: the player, the enemies, the goal, the way so far."""
    canvas = pygame.Surface((width * FINE, height * FINE))
    scale = canvas.get_width() / (p.END + 60.0)
    frame = Frame(np.array([30.0 * scale, 0.8 * canvas.get_height()]), np.diag([scale, -scale]))
    fade(canvas, canvas.get_rect(), SKY, HORIZON)
    for left, wide in zip(p.LEFT, p.WIDTHS, strict=True):
        block(canvas, frame, (left, -60.0, left + wide, p.TOP), EARTH)
        block(canvas, frame, (left, p.TOP - 8.0, left + wide, p.TOP), GRASS)
    flag = frame.placed(p.END - 4.0, p.TOP)
    block(canvas, flag, (0.0, 0.0, 4.0, 90.0), INK)
    shape(canvas, flag, [(0, 90), (-42, 77), (0, 64)], AMBER, INK)
    for x in arena.enemy_x:
        _figure(canvas, frame.placed(float(x), p.TOP), RED)
    _figure(canvas, frame.placed(float(arena.x), float(arena.y)), BLUE)
    write(canvas, f"{100 * arena.x / p.END:.0f} % of the way", 36, INK, 24, 34)
    write(canvas, f"decision {arena.decisions}", 36, INK, canvas.get_width() - 24, 34, align=1.0)
    return picture(canvas)


def _figure(canvas: pygame.Surface, frame: Frame, color: Color) -> None:
    """Paint a player or an enemy, whose lower left corner is at the frame's origin."""
    block(canvas, frame, (0.0, 0.0, p.PLAYER_WIDTH, p.PLAYER_HEIGHT), INK)
    block(canvas, frame, (2.0, 2.0, p.PLAYER_WIDTH - 2.0, p.PLAYER_HEIGHT - 2.0), color)
    for eye in (7.0, 14.0):
        disc(canvas, frame.points([(eye, 21.0)])[0], frame.length(2.6), WHITE)


def draw_goal(arena: np.record, width: int, height: int) -> Array:
    """Return a picture of Goal, uint8 [height, width, 3]: the half field from above, the goal on the right."""
    canvas = pygame.Surface((width * FINE, height * FINE))
    canvas.fill(FIELD)
    scale = canvas.get_height() / (2.0 * s.HALF_WIDTH + 2.0)
    frame = Frame(np.array([4.0 * scale, canvas.get_height() / 2]), np.diag([scale, -scale]))
    for stripe in range(-4, 28, 8):
        block(canvas, frame, (stripe, -20.0, stripe + 4.0, 20.0), FIELD_DARK)
    corners = [(0, -s.HALF_WIDTH), (s.LENGTH, -s.HALF_WIDTH), (s.LENGTH, s.HALF_WIDTH), (0, s.HALF_WIDTH)]
    pygame.draw.lines(canvas, WHITE, True, frame.points(corners).tolist(), 2 * FINE)
    area = [(s.LENGTH, -s.AREA_HALF), (s.KEEPER_X, -s.AREA_HALF), (s.KEEPER_X, s.AREA_HALF), (s.LENGTH, s.AREA_HALF)]
    pygame.draw.lines(canvas, WHITE, False, frame.points(area).tolist(), FINE)
    block(canvas, frame, (s.LENGTH, -s.GOAL_HALF, s.LENGTH + s.GOAL_DEPTH, s.GOAL_HALF), (206, 214, 222))
    for y in np.linspace(-s.GOAL_HALF, s.GOAL_HALF, 15):
        _line(canvas, frame, WHITE, [(s.LENGTH, y), (s.LENGTH + s.GOAL_DEPTH, y)], FINE)
    for body, color in ((arena.keeper, AMBER), (arena.player, BLUE)):
        disc(canvas, frame.points([(body.x, body.y)])[0], frame.length(s.PLAYER_RADIUS), INK)
        disc(canvas, frame.points([(body.x, body.y)])[0], frame.length(s.PLAYER_RADIUS - 0.12), color)
        nose = [(0.85, 0.0), (0.25, 0.35), (0.25, -0.35)]
        shape(canvas, frame.placed(body.x, body.y, turn=body.angle), nose, WHITE)
    ball = frame.points([(arena.ball.x, arena.ball.y)])[0]
    disc(canvas, ball, frame.length(s.BALL_RADIUS), INK)
    disc(canvas, ball, frame.length(s.BALL_RADIUS - 0.1), WHITE)
    write(canvas, f"decision {arena.decisions}", 36, WHITE, canvas.get_width() - 24, 40, align=1.0)
    return picture(canvas)


def draw_particle(arena: np.record, reach: float, width: int, height: int) -> Array:
    """Return a picture of Catch Point or Hard Move, uint8 [height, width, 3]: the particle, its way, the target."""
    canvas, frame = _plane(width, height)
    _target(canvas, frame.placed(arena.target_x, arena.target_y), reach)
    place, ahead = frame.placed(arena.x, arena.y), np.array([arena.vx, arena.vy])
    if ahead.any():
        _line(canvas, place, INK, [(0.0, 0.0), tuple(0.5 * ahead)], 6)
    disc(canvas, place.origin, frame.length(0.045), INK)
    disc(canvas, place.origin, frame.length(0.036), BLUE)
    misses = f", misses {arena.misses}" if arena.misses else ""
    write(canvas, f"decision {arena.decisions}{misses}", 36, INK, 24, 34)
    return picture(canvas)


def draw_moving(arena: np.record, reach: float, inertia: bool, width: int, height: int) -> Array:
    """Return a picture of Moving or Sliding, uint8 [height, width, 3]: the agent with its heading, and its course."""
    canvas, frame = _plane(width, height)
    _target(canvas, frame.placed(arena.target_x, arena.target_y), reach)
    if arena.speed > 0.0:
        way = [(0.0, 0.0), (0.12 + 0.25 * min(arena.speed, 3.0), 0.0)]
        _line(canvas, frame.placed(arena.x, arena.y, turn=arena.course), AMBER if inertia else INK, way, 8)
    agent = frame.placed(arena.x, arena.y, turn=arena.heading)
    shape(canvas, agent, [(0.09, 0.0), (-0.06, 0.055), (-0.035, 0.0), (-0.06, -0.055)], BLUE, INK)
    write(canvas, f"decision {arena.decisions}, speed {arena.speed:.1f}", 36, INK, 24, 34)
    return picture(canvas)


def _plane(width: int, height: int) -> tuple[pygame.Surface, Frame]:
    """Return a canvas with the square of side 2 around the origin, and its frame."""
    canvas = pygame.Surface((width * FINE, height * FINE))
    canvas.fill(GRID)
    frame = fit(canvas.get_width(), canvas.get_height(), VIEW, VIEW)
    block(canvas, frame, (-1.0, -1.0, 1.0, 1.0), PAPER)
    for line in np.linspace(-1.0, 1.0, 9):
        for ends in ([(line, -1.0), (line, 1.0)], [(-1.0, line), (1.0, line)]):
            _line(canvas, frame, GRID, ends, FINE)
    return canvas, frame


def _target(canvas: pygame.Surface, frame: Frame, radius: float) -> None:
    for share, color in ((1.0, GREEN), (0.86, WHITE), (0.4, GREEN)):
        disc(canvas, frame.origin, frame.length(share * radius), color)


def _line(canvas: pygame.Surface, frame: Frame, color: Color, points: npt.ArrayLike, width: int) -> None:
    """Draw a line between two points of a frame; its width is in px."""
    start, end = frame.points(points).tolist()
    pygame.draw.line(canvas, color, start, end, width)
