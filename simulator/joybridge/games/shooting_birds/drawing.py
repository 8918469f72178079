"""Pictures of Shooting Birds: the arena, with a line above it that shows gun and score.

Trees and barns are drawn exactly where their colliders are, and everything is drawn from back to front by its depth:
what hides a bird in the picture also hides it from the gun.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import pygame

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.levels import (
    BARN,
    BARN_BOXES,
    BARN_DEPTH,
    BUSH_CROWN,
    SLOWEST,
    TREE,
    TREE_CROWN,
    TREE_DEPTH,
    TREE_TRUNK,
    Obstacles,
    Placement,
)
from joybridge.games.shooting_birds.rules import EPISODE_TICKS, GENERATED, MAGAZINE, TICK, WALL_X, WALL_Y
from joybridge.games.shooting_birds.sensing import BIRD_RADIUS, front
from joybridge.simulator.render import FINE, Box, Color, Frame, block, disc, ellipse, fade, fit, picture, shape, write

HORIZON = -8.2
SKY_TOP, SKY_LOW, SUN, CLOUD = (74, 150, 214), (221, 240, 246), (255, 246, 205), (255, 255, 255, 150)
FAR_HILLS, NEAR_HILLS = (160, 197, 190), (138, 188, 136)
MEADOW_FAR, MEADOW_NEAR, GRASS = (150, 196, 92), (84, 140, 58), (70, 122, 50)
FLOWERS = ((255, 255, 255), (255, 226, 110), (240, 150, 190))
BARK, BARK_LIGHT, BARK_DARK = (112, 76, 48), (140, 98, 64), (84, 56, 36)
LEAVES_DARK, LEAVES, LEAVES_LIGHT = (44, 102, 52), (64, 132, 62), (94, 162, 76)
LIGHT = np.array([-0.6, -0.8])  # direction from which it comes, on the canvas (y down)
BOARDS, BOARDS_DARK, TRIM = (178, 58, 46), (146, 44, 38), (244, 236, 220)
ROOF, ROOF_DARK, BRICKS, MORTAR = (88, 84, 94), (66, 62, 72), (150, 92, 76), (118, 70, 58)
STONE, STONE_DARK, DARK, DUSK = (158, 152, 144), (126, 120, 114), (44, 32, 34), (84, 62, 52)
CLEAR = (0, 0, 0, 0)

CHIMNEY, LEFT, RIGHT, ABOVE, BELOW, FOOT, BEAM, *POSTS = BARN_BOXES
WINDOW: Box = (ABOVE[0], BELOW[3], ABOVE[2], ABOVE[1])  # the opening between the four walls
DOORS: Box = (FOOT[0], FOOT[3], FOOT[2], BEAM[1])  # the openings between the posts
TRIM_WIDTH, ROOF_HEIGHT = 0.3, 1.3

# Birds by size, large to small: plumage, belly, wing. The colors differ from each other and from the background.
PLUMAGE: tuple[tuple[Color, Color, Color], ...] = (
    ((48, 92, 190), (190, 216, 250), (30, 62, 140)),
    ((250, 172, 40), (255, 234, 170), (214, 122, 20)),
    ((240, 76, 158), (255, 208, 232), (186, 36, 116)),
)
OUTLINE, BEAK, WHITE, BLACK = (36, 30, 44), (255, 140, 50), (255, 255, 255), (20, 20, 26)
# A bird that flies to +x, in units of the radius of its collider.
BODY, BELLY = ellipse(0.0, 0.0, 0.98, 0.84), ellipse(0.12, -0.3, 0.7, 0.46)
TAIL = ((-0.75, 0.3), (-1.4, 0.55), (-1.25, 0.2), (-1.45, 0.0), (-0.8, -0.15))
WING = ((0.3, 0.0), (0.2, 0.5), (-0.1, 0.95), (-0.5, 1.2), (-0.95, 1.2), (-0.8, 0.85), (-0.9, 0.6), (-0.4, -0.1))
BILL = ((0.82, 0.4), (1.45, 0.12), (0.86, -0.1))
EYE, PUPIL = ellipse(0.5, 0.3, 0.25, 0.25, 12), ellipse(0.57, 0.3, 0.13, 0.13, 8)
FLAPS = (9.0, 13.0, 19.0)  # of the wings by size, rad/s

PANEL, BRASS, COPPER, EMPTY = (24, 28, 40), (226, 184, 84), (190, 104, 62), (70, 76, 92)
TEXT, ALERT, AIMED = (240, 240, 235), (255, 110, 90), (255, 50, 40)


class Scene(NamedTuple):
    """What stands in a level, and how many screens wide it is."""

    placements: tuple[Placement, ...]
    screens: int


def draw(arena: np.record, obstacles: Obstacles, scene: Scene, width: int, height: int) -> Array:
    """Return a picture, uint8 [height, width, 3], of one arena, a record of dtype ARENA, among obstacles of a scene."""
    canvas = pygame.Surface((width * FINE, height * FINE), depth=32)
    screen = fit(*canvas.get_size(), WALL_X, WALL_Y)
    world = screen.placed(-arena.camera, 0.0)
    moved = world.origin[0] - screen.origin[0] * scene.screens
    layers: list[tuple[float, Callable[[], object]]] = [
        (depth, partial(canvas.blit, layer, (x + moved, y)))
        for depth, layer, (x, y) in scenery(scene, _number(arena), width, height)
    ]
    birds = arena.birds.view(np.recarray)
    layers += [(bird.z, partial(_bird, canvas, world, bird, arena.clock * TICK)) for bird in birds]
    for _, paint in sorted(layers, key=itemgetter(0), reverse=True):
        paint()
    _scoreboard(canvas, arena)
    aimed = front(arena, obstacles) >= 0
    _crosshair(canvas, world.placed(arena.x, arena.y), aimed)
    return picture(canvas)


def _number(arena: np.record) -> int:
    """Return the number of the arena's level: as people count them, and for what decorates it."""
    return int(arena.number if arena.fixed_level == GENERATED else arena.level)


@lru_cache(maxsize=14)
def scenery(scene: Scene, number: int, width: int, height: int) -> list[tuple[float, pygame.Surface, tuple[int, int]]]:
    """Return the still layers of a level: for each its depth, its canvas, and the position of that (px)."""
    size = (width * FINE * scene.screens, height * FINE)
    world = fit(*size, WALL_X * scene.screens, WALL_Y)
    back = pygame.Surface(size, depth=32)
    far, near = pygame.Surface(size, pygame.SRCALPHA), pygame.Surface(size, pygame.SRCALPHA)
    _landscape(back, world, scene.screens, np.random.default_rng(number))
    for placement in scene.placements:
        frame = world.placed(placement.x, placement.y, placement.scale_x, placement.scale_y)
        layer = near if placement.depth == BARN_DEPTH else far
        if placement.template == BARN:
            _inside(back, frame)
            _barn(layer, frame)
        elif placement.template == TREE:
            _trunk(layer, frame)
            _leaves(layer, frame, TREE_CROWN)
        else:
            _leaves(layer, frame, BUSH_CROWN)
    layers = [(np.inf, back), (TREE_DEPTH, far), (BARN_DEPTH, near)]
    used = [layer.get_bounding_rect() for _, layer in layers]
    return [(depth, layer.subsurface(box), box.topleft) for (depth, layer), box in zip(layers, used, strict=True)]


def _landscape(canvas: pygame.Surface, world: Frame, screens: int, random: np.random.Generator) -> None:
    """Paint sky, sun, clouds, two ranges of hills and a meadow."""
    width, height = canvas.get_size()
    ground = int(world.points([(0.0, HORIZON)])[0, 1])
    fade(canvas, pygame.Rect(0, 0, width, ground), SKY_TOP, SKY_LOW)
    veil = pygame.Surface((width, height), pygame.SRCALPHA)
    for radius, alpha in ((3.4, 26), (2.5, 70), (1.8, 140), (1.3, 255)):
        shape(veil, world, ellipse(-2.0, 6.6, radius, radius, 48), (*SUN, alpha))
    canvas.blit(veil, (0, 0))
    veil.fill(CLEAR)
    for x in np.linspace(-17.0, 17.0, 5) if screens == 1 else np.linspace(-55.0, 55.0, 5 * screens):
        scale = random.uniform(0.6, 1.2)
        cloud = world.placed(x + random.uniform(-2.0, 2.0), random.uniform(2.0, 9.0), scale, scale)
        for dx, dy, radius in ((-1.3, 0.0, 0.7), (-0.4, 0.35, 1.0), (0.7, 0.15, 0.8), (1.5, 0.0, 0.5)):
            shape(veil, cloud, ellipse(dx, dy, 1.3 * radius, 0.6 * radius), CLOUD)
    canvas.blit(veil, (0, 0))
    edge = 40.0 * screens
    along = np.linspace(-edge, edge, 160 * screens + 1)
    for color, base, swing, wave in ((FAR_HILLS, -5.2, 1.3, 0.23), (NEAR_HILLS, -6.9, 0.9, 0.34)):
        phase = random.uniform(0.0, 2 * np.pi)
        ridge = base + swing * (np.sin(wave * along + phase) + 0.3 * np.sin(2.7 * wave * along))
        shape(canvas, world, [(-edge, HORIZON), *zip(along, ridge, strict=True), (edge, HORIZON)], color)
    fade(canvas, pygame.Rect(0, ground, width, height - ground), MEADOW_FAR, MEADOW_NEAR)
    for depth in np.sqrt(np.linspace(0.02, 1.0, 150 * screens)):  # tufts and flowers, larger if nearer
        tuft = world.placed(random.uniform(-25.0, 25.0) * screens, HORIZON - 4.0 * depth, 0.5 * depth, 0.5 * depth)
        if random.uniform() < 0.7:
            shape(canvas, tuft, [(-0.4, 0.6), (-0.1, 0.0), (0.1, 0.0), (0.45, 0.7), (0.05, 0.2), (0.0, 0.9)], GRASS)
        else:
            shape(canvas, tuft, ellipse(0.0, 0.0, 0.25, 0.25, 10), FLOWERS[random.integers(len(FLOWERS))])


def _trunk(layer: pygame.Surface, frame: Frame) -> None:
    """Paint the trunk of a tree, with streaks of bark."""
    _, bottom, right, top = TREE_TRUNK
    block(layer, frame, TREE_TRUNK, BARK)
    block(layer, frame, (right - 0.7, bottom, right, top), BARK_DARK)
    for x, y in ((-1.0, -13.5), (-0.5, -8.0), (-0.1, -12.0), (-0.9, -6.5), (0.2, -6.0)):
        block(layer, frame, (x, y, x + 0.16, y + 3.5), BARK_LIGHT)


def _leaves(layer: pygame.Surface, frame: Frame, crown: tuple[tuple[float, float, float], ...]) -> None:
    """Paint the leaves of a tree or a bush, discs lit from the upper left."""
    # Each disc in full size first, then smaller and lighter ones with a rim of leaves inside it.
    for color, share, shift in ((LEAVES_DARK, 1.0, 0.0), (LEAVES, 0.76, 0.09), (LEAVES_LIGHT, 0.42, 0.24)):
        for x, y, radius in crown:
            unit = frame.length(radius)
            center = frame.points([(x, y)])[0] + shift * unit * LIGHT
            disc(layer, center, share * unit, color)
            for leaf in center + unit * ellipse(0.0, 0.0, share, share, 13) if shift else ():
                disc(layer, leaf, 0.14 * unit, color)


def _inside(back: pygame.Surface, frame: Frame) -> None:
    """Paint the dark inside of a barn, visible through window and doors. Birds fly in front of it."""
    for box in (WINDOW, DOORS):
        fade(back, frame.box(*box), DARK, DUSK)


def _barn(layer: pygame.Surface, frame: Frame) -> None:
    """Paint a barn: boards, white trim, a roof, stones at the foot. Gaps between its boxes stay open."""
    eaves = ABOVE[3] - ROOF_HEIGHT
    for wall in (LEFT, RIGHT, ABOVE, BELOW, *POSTS):
        block(layer, frame, wall, BOARDS)
        for x in np.arange(np.ceil(wall[0] / 0.72) * 0.72, wall[2] - 0.06, 0.72):
            block(layer, frame, (x, wall[1], x + 0.06, wall[3]), BOARDS_DARK)
    for left, bottom, right, _ in (LEFT, RIGHT):
        panel, width = frame.box(left, bottom, right, eaves), round(frame.length(TRIM_WIDTH))
        layer.set_clip(panel)  # the ends of a thick line would stick out
        pygame.draw.line(layer, TRIM, panel.topleft, panel.bottomright, width)
        pygame.draw.line(layer, TRIM, panel.bottomleft, panel.topright, width)
        pygame.draw.rect(layer, TRIM, panel, width)
    layer.set_clip(None)
    left, bottom, right, top = WINDOW
    block(layer, frame, (left - TRIM_WIDTH, bottom - TRIM_WIDTH, right + TRIM_WIDTH, top + TRIM_WIDTH), TRIM)
    block(layer, frame, WINDOW, CLEAR)
    for left, bottom, right, top in POSTS:
        block(layer, frame, (left, bottom, left + 0.2, top), TRIM)
        block(layer, frame, (right - 0.2, bottom, right, top), TRIM)
    _courses(layer, frame, (LEFT[0], eaves, RIGHT[2], RIGHT[3]), 4, 0.9, ROOF, ROOF_DARK)
    _courses(layer, frame, CHIMNEY, 5, 0.75, BRICKS, MORTAR)
    _courses(layer, frame, FOOT, 2, 1.6, STONE, STONE_DARK)
    _courses(layer, frame, BEAM, 2, 5.5, BARK, BARK_DARK)


def _courses(
    layer: pygame.Surface, frame: Frame, box: Box, rows: int, length: float, fill: Color, joint: Color
) -> None:
    """Paint a box of bricks or similar parts of a length, in rows that are shifted by half a part."""
    left, bottom, right, top = box
    block(layer, frame, box, fill)
    layer.set_clip(frame.box(*box))
    high = (top - bottom) / rows
    for row in range(rows):
        y = bottom + row * high
        block(layer, frame, (left, y, right, y + 0.07), joint)
        for x in np.arange(left + (0.5 + row % 2 / 2) * length, right, length):
            block(layer, frame, (x, y, x + 0.07, y + high), joint)
    layer.set_clip(None)


def _bird(canvas: pygame.Surface, world: Frame, bird: np.record, time: float) -> None:
    """Paint a bird. The position of its wings depends on the time (s)."""
    size = bird.kind
    radius, (plumage, belly, feathers) = float(BIRD_RADIUS[size]), PLUMAGE[size]
    facing = math.copysign(1.0, bird.vx)
    climb = math.atan2(bird.vy, max(abs(bird.vx), SLOWEST))  # limits the angle
    frame = world.placed(bird.x, bird.y, facing * radius, radius, facing * climb)
    beat = 0.25 + 0.75 * math.sin(FLAPS[size] * time + bird.phase)
    for part, points, fill, edge in (
        (frame.placed(0.3, 0.3, 0.8, 0.9 * beat), WING, feathers, OUTLINE),  # the far one
        (frame, TAIL, feathers, OUTLINE),
        (frame, BILL, BEAK, OUTLINE),
        (frame, BODY, plumage, OUTLINE),
        (frame, BELLY, belly, None),
        (frame.placed(0.0, 0.1, 1.0, beat), WING, feathers, OUTLINE),
        (frame, EYE, WHITE, OUTLINE),
        (frame, PUPIL, BLACK, None),
    ):
        shape(canvas, part, points, fill, edge)


def _scoreboard(canvas: pygame.Surface, arena: np.record) -> None:
    """Paint the line above the arena: cartridges, hits and shots, level and time left."""
    width, height = canvas.get_size()
    unit = min(width / 160, height / 100)
    panel = pygame.Surface((width, round(5.5 * unit)), pygame.SRCALPHA)
    panel.fill((*PANEL, 225))
    canvas.blit(panel, (0, 0))
    for i in range(MAGAZINE):
        x = (1.6 + 2.0 * i) * unit
        full = i < arena.ammo
        tip = [(x, 2.2 * unit), (x + 0.6 * unit, 0.8 * unit), (x + 1.2 * unit, 2.2 * unit)]
        pygame.draw.polygon(canvas, COPPER if full else EMPTY, tip)
        canvas.fill(BRASS if full else EMPTY, (x, 2.2 * unit, 1.2 * unit, 2.4 * unit))
    accuracy, seconds = arena.hits / max(arena.shots, 1), (EPISODE_TICKS - arena.tick) * TICK
    line = partial(write, canvas, size=4.6 * unit, y=2.8 * unit)
    if arena.ammo == 0:
        line("reload!", color=ALERT, x=18.5 * unit)
    line(f"hits {arena.hits} / shots {arena.shots}    accuracy {accuracy:.0%}", color=TEXT, x=width / 2, align=0.5)
    line(f"level {_number(arena)}    {seconds:4.1f} s", color=TEXT, x=width - 1.6 * unit, align=1.0)


def _crosshair(canvas: pygame.Surface, frame: Frame, aimed: bool) -> None:
    """Paint the crosshair, red if a bird is in front. A dark rim makes it visible on any background."""
    thin = 0.13
    for color, rim in ((BLACK, thin / 2), (AIMED if aimed else WHITE, 0.0)):
        width = frame.length(thin + 2 * rim)
        disc(canvas, frame.origin, frame.length(0.9 + rim), color, width)
        disc(canvas, frame.origin, width, color)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            start, end = frame.points(np.outer((0.4 - rim, 1.4 + rim), (x, y)))
            pygame.draw.line(canvas, color, start.tolist(), end.tolist(), round(width))
