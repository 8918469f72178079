"""Levels of Shooting Birds that are made from a number: obstacles, flight lines, and a mixture of birds.

Every level is playable by construction. The screen is divided into columns with one obstacle each, which covers at most
`COVERED` of its column. So at every height at least a quarter of the screen is open sky, in a gap per column, and birds
of every size cross it. All obstacles stand on the meadow: large ones near to the viewer, where they also hide birds of
medium size, small ones far away.
"""

from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.level_sets import open_level_streams
from joybridge.games.shooting_birds.levels import (
    BARN,
    BARN_DEPTH,
    BOXES,
    BUSH,
    DISCS,
    FLIGHT,
    TREE,
    TREE_DEPTH,
    Obstacles,
    Placement,
    no_obstacles,
    place,
)
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import integer, uniform

MAX_COLUMNS, MAX_BARNS = 5, 2
SCREEN = 19.0  # half of the screen's width, units
COVERED = 0.75  # most of a column's width that its obstacle covers
LEFT = np.array([-5.31, -8.46, -2.91])  # of a template, with everything that belongs to it
RIGHT = np.array([5.25, 8.86, 2.91])
FOOT = np.array([-13.95, -10.04, -0.6])
SMALLEST, LARGEST = np.array([0.35, 0.4, 0.8]), np.array([1.3, 1.35, 1.5])  # scales by template
NEAR_BASE, FAR_BASE, MIDDLE_BASE = -12.4, -8.7, -10.4  # heights of the meadow: units
LOWEST_LINE, HIGHEST_LINE, LINE_HEIGHT = -8.0, 8.0, 0.8  # middle and least half height of flight lines

_DISCS_0, _DISCS_1, _DISCS_2 = DISCS
_BOXES_0, _BOXES_1, _BOXES_2 = BOXES
_place = compiled(place)


class Generated(NamedTuple):
    """Generated levels, one per row."""

    obstacles: Obstacles
    flights: Array  # records of dtype FLIGHT [levels]
    placements: Array  # float64 [levels, most, 6]: template, x, y, scale_x, scale_y, depth; from back to front
    counts: Array  # int64 [levels]: of placements
    screens: int  # 3: with more of the kind to the left and to the right of the screen in the middle

    def placed(self, row: int) -> tuple[Placement, ...]:
        """Return the obstacles of a level, for its drawing."""
        rows = self.placements[row, : self.counts[row]].tolist()
        return tuple(Placement(int(template), *rest) for template, *rest in rows)


def make_room(levels: int, screens: int = 1) -> Generated:
    """Return so many levels without anything in them."""
    columns = MAX_COLUMNS * screens
    obstacles = no_obstacles(levels, 5 * columns, 12 * MAX_BARNS * screens + columns)
    flights = np.zeros(levels, FLIGHT).view(np.recarray)
    return Generated(obstacles, flights, np.zeros((levels, columns, 6)), np.zeros(levels, np.int64), screens)


def generate(numbers: Array, levels: Generated) -> None:
    """Make the levels of some numbers, one per row, in place of those that were there."""
    _generate(open_level_streams(numbers), levels)


@compiled
def _generate(streams, levels):
    obstacles = levels.obstacles
    for i in range(len(levels.counts)):
        obstacles.disc_count[i] = obstacles.box_count[i] = levels.counts[i] = 0
        _fill_screen(streams, i, levels, 0.0)
        _release_birds(streams, i, levels.flights[i])
        if levels.screens == 3:
            _fill_screen(streams, i, levels, -2.0 * SCREEN)
            _fill_screen(streams, i, levels, 2.0 * SCREEN)
        for j in range(levels.counts[i]):
            template, placement = int(levels.placements[i, j, 0]), levels.placements[i, j, 1:]
            if template == TREE:
                _place(obstacles, i, _DISCS_0, _BOXES_0, placement)
            elif template == BARN:
                _place(obstacles, i, _DISCS_1, _BOXES_1, placement)
            else:
                _place(obstacles, i, _DISCS_2, _BOXES_2, placement)


@compiled
def _fill_screen(streams, i, levels, middle):
    """Divide the screen around x = middle into columns and put an obstacle into each."""
    columns, barns = 2 + integer(streams, i, MAX_COLUMNS - 1), 0
    shares = np.empty(columns)
    for j in range(columns):
        shares[j] = uniform(streams, i, 0.7, 1.5)
    total, left = shares.sum(), middle - SCREEN
    for j in range(columns):
        width = 2.0 * SCREEN * shares[j] / total
        chance = uniform(streams, i, 0.0, 1.0)
        template = TREE if chance < 0.5 else (BARN if chance < 0.8 and barns < MAX_BARNS else BUSH)
        barns += template == BARN
        fits = COVERED * width / (RIGHT[template] - LEFT[template])
        largest = min(LARGEST[template], fits)
        scale = uniform(streams, i, min(max(SMALLEST[template], 0.6 * largest), largest), largest)
        near = (scale - SMALLEST[template]) / (LARGEST[template] - SMALLEST[template])
        mirrored = uniform(streams, i, 0.0, 1.0) < 0.5
        low, high = (-RIGHT[template], -LEFT[template]) if mirrored else (LEFT[template], RIGHT[template])
        x = uniform(streams, i, left - scale * low, left + width - scale * high)
        shift = uniform(streams, i, -0.4, 0.4)
        base = min(max(FAR_BASE + near * (NEAR_BASE - FAR_BASE) + shift, NEAR_BASE), FAR_BASE)
        placement = levels.placements[i, levels.counts[i]]
        placement[0], placement[1], placement[2] = template, x, base - scale * FOOT[template]
        placement[3], placement[4] = -scale if mirrored else scale, scale
        placement[5] = BARN_DEPTH if base < MIDDLE_BASE else TREE_DEPTH
        levels.counts[i] += 1
        left += width


@compiled
def _release_birds(streams, i, flight):
    """Choose flight lines, the mixture of sizes, speeds, and how long the sky stays without a bird that is gone."""
    flight.line_count = 1 + integer(streams, i, 3)
    for j in range(flight.line_count):
        middle = uniform(streams, i, LOWEST_LINE, HIGHEST_LINE)
        half = uniform(streams, i, LINE_HEIGHT, 4.0)
        flight.lines[j, 0] = max(middle - half, LOWEST_LINE)
        flight.lines[j, 1] = min(middle + half, HIGHEST_LINE)
    large, medium, small = (
        uniform(streams, i, 0.2, 1.0),
        uniform(streams, i, 0.2, 1.0),
        uniform(streams, i, 0.2, 1.0),
    )
    total = large + medium + small
    flight.large, flight.medium = large / total, (large + medium) / total
    flight.slowest = uniform(streams, i, 1.0, 3.0)
    flight.fastest = flight.slowest + uniform(streams, i, 1.0, 5.0)
    flight.pause = uniform(streams, i, 0.0, 1.5)
