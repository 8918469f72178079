"""Pitches of Beastly Rivals: the paper's disc, and those that are made from a number.

A generated pitch is the disc without what lies behind up to four straight edges, with up to five round pillars that
block character and beast, and a slow sphere of another size and speed. Every pitch is playable by construction: it is
convex, its center is free, and between any two pillars, and between a pillar and an edge, the character gets through.
"""

import math
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.level_sets import open_level_streams
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import integer, uniform
from joybridge.simulator.trigonometry import cosine, sine

PITCH_RADIUS = 7.5
BOUNDARY_RADIUS = 7.125  # of the sphere around the pitch's center that limits cursor and slow sphere
SPHERE_RADIUS, SPHERE_SPEED = 3.0, 0.75

MAX_EDGES, MAX_PILLARS, TRIES = 4, 5, 4
NEAREST_EDGE, FARTHEST_EDGE = 4.2, 6.3  # distance from the center
THINNEST, THICKEST = 0.35, 0.9  # radius of a pillar
PASSAGE = 0.9  # free between pillars and edges; the character is 0.5625 wide
CLEARING = 1.5  # radius around the center, where the beast begins, without a pillar

RAYS, RAY_LENGTH = 12, 7.0
_C = math.sqrt(3.0) / 2.0  # counter-clockwise from +x in steps of 30 degrees, exact
RAY_X = np.array([1.0, _C, 0.5, 0.0, -0.5, -_C, -1.0, -_C, -0.5, 0.0, 0.5, _C])
RAY_Z = np.array([0.0, 0.5, _C, 1.0, _C, 0.5, 0.0, -0.5, -_C, -1.0, -_C, -0.5])


class Pitches(NamedTuple):
    """Pitches, one per row. Edges and pillars beyond their counts are unused."""

    edges: Array  # float64 [pitches, MAX_EDGES, 3]: x, z of the unit vector across the edge, its distance from (0, 0)
    edge_counts: Array  # int64 [pitches]
    pillars: Array  # float64 [pitches, MAX_PILLARS, 3]: x, z, radius
    pillar_counts: Array  # int64 [pitches]
    sphere: Array  # float64 [pitches, 2]: radius and speed of the slow sphere


def make_pitches(count: int) -> Pitches:
    """Return so many pitches like the paper's."""
    counts, sphere = np.zeros((2, count), np.int64), np.full((count, 2), (SPHERE_RADIUS, SPHERE_SPEED))
    return Pitches(np.zeros((count, MAX_EDGES, 3)), counts[0], np.zeros((count, MAX_PILLARS, 3)), counts[1], sphere)


def generate(numbers: Array, rows: Array, pitches: Pitches) -> None:
    """Make the pitches of some numbers, in place of those that were in the rows."""
    _generate(open_level_streams(numbers), rows, pitches)


@compiled
def _generate(streams, rows, pitches):
    for i in range(len(rows)):
        row = rows[i]
        edges, pillars = pitches.edges[row], pitches.pillars[row]
        pitches.edge_counts[row], pitches.pillar_counts[row] = integer(streams, i, MAX_EDGES + 1), 0
        for j in range(pitches.edge_counts[row]):
            angle = uniform(streams, i, 0.0, 2.0 * np.pi)
            edges[j, 0], edges[j, 1] = cosine(angle), sine(angle)
            edges[j, 2] = uniform(streams, i, NEAREST_EDGE, FARTHEST_EDGE)
        for _ in range(TRIES * integer(streams, i, MAX_PILLARS + 1)):
            angle, share = uniform(streams, i, 0.0, 2.0 * np.pi), uniform(streams, i, 0.0, 1.0)
            radius = uniform(streams, i, THINNEST, THICKEST)
            distance = BOUNDARY_RADIUS * math.sqrt(share)
            x, z, count = distance * cosine(angle), distance * sine(angle), pitches.pillar_counts[row]
            if count < MAX_PILLARS and _has_room(x, z, radius, row, pitches):
                pillars[count, 0], pillars[count, 1], pillars[count, 2] = x, z, radius
                pitches.pillar_counts[row] += 1
        pitches.sphere[row, 0] = uniform(streams, i, 1.5, 3.5)
        pitches.sphere[row, 1] = uniform(streams, i, 0.4, 0.8)


@compiled
def _has_room(x, z, radius, row, pitches):
    """Return whether a pillar leaves passages to all that stands on a pitch."""
    distance = math.sqrt(x * x + z * z)
    if distance + radius + PASSAGE > BOUNDARY_RADIUS or distance - radius < CLEARING:
        return False
    for j in range(pitches.edge_counts[row]):
        edge = pitches.edges[row, j]
        if edge[0] * x + edge[1] * z + radius + PASSAGE > edge[2]:
            return False
    for j in range(pitches.pillar_counts[row]):
        pillar = pitches.pillars[row, j]
        dx, dz, apart = pillar[0] - x, pillar[1] - z, pillar[2] + radius + PASSAGE
        if dx * dx + dz * dz < apart * apart:
            return False
    return True


@compiled
def hold_inside(body, across_x, across_z, distance):
    """Put a body that is beyond an edge back onto it. The velocity does not change."""
    beyond = across_x * body.x + across_z * body.z - distance
    if beyond > 0.0:
        body.x -= beyond * across_x
        body.z -= beyond * across_z


@compiled
def block(body, x, z, apart):
    """Push a body out of the disc of radius `apart` around (x, z). The velocity does not change."""
    dx, dz = body.x - x, body.z - z
    square = dx * dx + dz * dz
    if 0.0 < square < apart * apart:
        per_unit = apart / math.sqrt(square)
        body.x, body.z = x + dx * per_unit, z + dz * per_unit


@compiled
def cast_rays(x, z, row, pitches, rays):
    """Write how far it is from (x, z) to a pillar, and to the edge of the pitch, along twelve rays: `rays` [12, 2].

    Both are fractions of the rays' length; -1: nothing is that near.
    """
    edges, pillars = pitches.edges, pitches.pillars
    for k in range(RAYS):
        pillar_at, b = np.inf, x * RAY_X[k] + z * RAY_Z[k]
        inside = b * b + BOUNDARY_RADIUS * BOUNDARY_RADIUS - x * x - z * z
        edge_at = max(math.sqrt(max(inside, 0.0)) - b, 0.0)
        for j in range(pitches.edge_counts[row]):
            across_x, across_z = edges[row, j, 0], edges[row, j, 1]
            towards = across_x * RAY_X[k] + across_z * RAY_Z[k]
            if towards > 0.0:
                edge_at = min(edge_at, max((edges[row, j, 2] - across_x * x - across_z * z) / towards, 0.0))
        for j in range(pitches.pillar_counts[row]):
            dx, dz, radius = pillars[row, j, 0] - x, pillars[row, j, 1] - z, pillars[row, j, 2]
            along = dx * RAY_X[k] + dz * RAY_Z[k]
            square = along * along - dx * dx - dz * dz + radius * radius
            if along > 0.0 and square >= 0.0:
                pillar_at = min(pillar_at, max(along - math.sqrt(square), 0.0))
        rays[k, 0] = pillar_at / RAY_LENGTH if pillar_at <= RAY_LENGTH else -1.0
        rays[k, 1] = edge_at / RAY_LENGTH if edge_at <= RAY_LENGTH else -1.0
