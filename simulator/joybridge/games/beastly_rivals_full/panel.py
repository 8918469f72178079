"""The panel beside the pitch: time and phase of the match, the beast, the ball's charge, and a line per player."""

from collections.abc import Sequence

import numpy as np
import pygame

from joybridge.games.beastly_rivals_full.beast import SPEED_LIMIT
from joybridge.games.beastly_rivals_full.state import DEAD, HUNT, MAX_CHARGE, PLAYER_SPEED, START, TICK, Rules
from joybridge.games.painting import (
    AMBER,
    BAR,
    BLINK,
    BLOOD,
    DIM,
    FAINT,
    GROOVE,
    INK,
    PALE,
    PANEL,
    PANEL_EDGE,
    WHITE,
    bar,
    mix,
)
from joybridge.simulator.render import FINE, Color, write

FIRST_LINE, LINE = 55.0, 5.6  # of the players, likewise


def panel(canvas: pygame.Surface, edge: int, arena: np.record, rules: Rules, colors: Sequence[Color]) -> None:
    """Paint the panel from the pixel column `edge` on. colors: of the players."""
    unit = canvas.get_height() / 100
    canvas.fill(PANEL, (edge, 0, canvas.get_width() - edge, canvas.get_height()))
    canvas.fill(PANEL_EDGE, (edge, 0, FINE, canvas.get_height()))
    left, seconds = edge + 2.5 * unit, arena.tick * TICK
    write(canvas, "BEASTLY", 6.6 * unit, BLOOD, left, 6 * unit)
    write(canvas, "RIVALS", 6.6 * unit, WHITE, left, 11 * unit)
    write(canvas, f"{int(seconds // 60)}:{seconds % 60:04.1f}", 8 * unit, WHITE, left, 19 * unit)
    write(canvas, _phase(arena), 3.4 * unit, DIM, left, 24.5 * unit)
    anger = min(arena.beast["speed"] / SPEED_LIMIT, 1.0)
    write(canvas, "beast", 3.4 * unit, DIM, left, 31 * unit)
    right = left + BAR * unit
    write(canvas, f"{arena.beast['speed']:.0f}", 4.6 * unit, mix(PALE, BLOOD, anger), right, 31 * unit, align=1.0)
    bar(canvas, left, 33.5 * unit, unit, anger, BLOOD)
    canvas.fill(WHITE, (left + BAR * unit * PLAYER_SPEED / SPEED_LIMIT, 32.7 * unit, FINE, 3.4 * unit))
    charge = min(arena.charge / MAX_CHARGE, 1.0)
    write(canvas, "charge", 3.4 * unit, DIM, left, 41 * unit)
    write(canvas, f"{arena.charge:.1f}", 4.6 * unit, mix(PALE, AMBER, charge), right, 41 * unit, align=1.0)
    bar(canvas, left, 43.5 * unit, unit, charge, AMBER)
    write(canvas, "lives", 2.9 * unit, FAINT, left + 4 * unit, 50.5 * unit)
    write(canvas, "kills", 2.9 * unit, FAINT, right, 50.5 * unit, align=1.0)
    for j in range(rules.players):
        _line(canvas, left, (FIRST_LINE + LINE * j) * unit, arena, j, colors[j])


def _phase(arena: np.record) -> str:
    """Return what the match is about now."""
    if arena.phase in (START, DEAD):
        return f"next ball in {(arena.phase_tick - arena.tick) * TICK:.1f} s"
    if arena.phase == HUNT:
        return "the ball flies" if arena.ball["flying"] else "hunt"
    return "over"


def _line(canvas: pygame.Surface, left: float, y: float, arena: np.record, j: int, color: Color) -> None:
    """Paint the line of a player: its color, its lives or its place, its blink, its kills."""
    player, unit = arena.players[j], canvas.get_height() / 100
    if arena.target == j:
        box = (left - 1.3 * unit, y - 0.46 * LINE * unit, (BAR + 2.6) * unit, 0.92 * LINE * unit)
        pygame.draw.rect(canvas, mix(PANEL, BLOOD, 0.45), box, border_radius=round(unit))
    dot = (left + 1.2 * unit, y)
    pygame.draw.circle(canvas, color if player["alive"] else mix(PANEL, color, 0.35), dot, 1.4 * unit)
    if arena.carrier == j:
        pygame.draw.circle(canvas, INK, dot, 1.0 * unit)
        pygame.draw.circle(canvas, WHITE, dot, 0.75 * unit)
    if player["out"]:
        write(canvas, f"out, place {player['place']:g}", 3.2 * unit, FAINT, left + 4 * unit, y)
    else:
        for life in range(int(player["lives"]) + bool(player["alive"])):
            pygame.draw.circle(canvas, BLOOD, (left + (4.8 + 1.7 * life) * unit, y), 0.65 * unit)
        ready = arena.tick >= player["blink_ready"]
        pygame.draw.circle(canvas, BLINK if ready else GROOVE, (left + 23.2 * unit, y), 0.8 * unit)
    write(
        canvas, f"{player['kills']}", 4.2 * unit, PALE if not player["out"] else FAINT, left + BAR * unit, y, align=1.0
    )
