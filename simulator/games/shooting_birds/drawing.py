"""Pictures of Shooting Birds for people: the arena as the shooter sees it, under a line with gun and score.

Trees and barns are painted exactly where their colliders are, and everything is painted from the back to
the front by its depth, so a bird can be hit where, and only where, it can be seen.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from operator import itemgetter

import numpy as np
import pygame

from joybridge.tensors import Array
from simulator.games.shooting_birds.levels import (
    BARN_BOXES, BARN_DEPTH, OBSTACLES, PLACEMENTS, TREE_CROWN, TREE_DEPTH, TREE_TRUNK,
)  # fmt: skip
from simulator.games.shooting_birds.rules import EPISODE_TICKS, MAGAZINE, SLOWEST, TICK, WALL_X, WALL_Y
from simulator.games.shooting_birds.sensing import BIRD_RADIUS, front
from simulator.render import FINE, Colour, Frame, ellipse, fade, fit, picture, shape, write

HORIZON = -8.2
SKY_TOP, SKY_LOW, SUN, SUN_GLOW, CLOUD = (74, 150, 214), (221, 240, 246), (255, 246, 205), (255, 240, 190), (255, 255, 255)
FAR_HILLS, NEAR_HILLS = (160, 197, 190), (138, 188, 136)
MEADOW_FAR, MEADOW_NEAR, GRASS = (150, 196, 92), (84, 140, 58), (70, 122, 50)
FLOWERS = ((255, 255, 255), (255, 226, 110), (240, 150, 190))
BARK, BARK_LIGHT, BARK_DARK = (112, 76, 48), (140, 98, 64), (84, 56, 36)
LEAVES_DARK, LEAVES, LEAVES_LIGHT = (44, 102, 52), (64, 132, 62), (94, 162, 76)
BOARDS, BOARDS_DARK, TRIM, TRIM_DARK = (178, 58, 46), (146, 44, 38), (244, 236, 220), (200, 186, 164)
ROOF, ROOF_DARK, BRICKS, MORTAR = (88, 84, 94), (66, 62, 72), (150, 92, 76), (118, 70, 58)
STONE, STONE_DARK, INTERIOR = (158, 152, 144), (126, 120, 114), (52, 34, 28)
CLEAR = (0, 0, 0, 0)

Box = tuple[float, float, float, float]
WINDOW: Box = (BARN_BOXES[3][0], BARN_BOXES[4][3], BARN_BOXES[3][2], BARN_BOXES[3][1])  # the hole between four walls

# Birds by size, large to small: plumage, belly, wing. No two alike, and unlike all that they fly in front of.
PLUMAGE: tuple[tuple[Colour, Colour, Colour], ...] = (
    ((48, 92, 190), (190, 216, 250), (30, 62, 140)),
    ((250, 172, 40), (255, 234, 170), (214, 122, 20)),
    ((222, 54, 140), (255, 196, 226), (160, 28, 98)),
)
OUTLINE, BEAK, WHITE, BLACK = (36, 30, 44), (255, 140, 50), (255, 255, 255), (20, 20, 26)
# A bird flies to +x in a frame whose unit is the radius of its collider.
BODY, BELLY = ellipse(0.0, 0.0, 0.98, 0.84), ellipse(0.12, -0.3, 0.7, 0.46)
TAIL = ((-0.75, 0.3), (-1.4, 0.55), (-1.25, 0.2), (-1.45, 0.0), (-0.8, -0.15))
BILL = ((0.82, 0.4), (1.45, 0.12), (0.86, -0.1))
EYE, PUPIL = ellipse(0.5, 0.3, 0.25, 0.25, 12), ellipse(0.57, 0.3, 0.13, 0.13, 8)
FLAPS = (10.0, 14.0, 20.0)  # rad/s by size: the smaller, the faster

PANEL, BRASS, COPPER, EMPTY = (24, 28, 40), (226, 184, 84), (190, 104, 62), (70, 76, 92)
TEXT, ALERT, AIMED = (240, 240, 235), (255, 110, 90), (255, 50, 40)


def draw(arena: np.record, width: int, height: int) -> Array:
    """Return a picture, uint8 [height, width, 3], of one arena, a record of dtype ARENA."""
    canvas = pygame.Surface((width * FINE, height * FINE), depth=32)
    world = fit(*canvas.get_size(), WALL_X, WALL_Y)
    layers: list[tuple[float, Callable[[], object]]] = [
        (depth, partial(canvas.blit, layer, place)) for depth, layer, place in scenery(int(arena.level), width, height)
    ]
    layers += [(bird.z, partial(_bird, canvas, world, bird, arena.clock * TICK)) for bird in arena.birds.view(np.recarray)]
    for _, paint in sorted(layers, key=itemgetter(0), reverse=True):
        paint()
    _scoreboard(canvas, arena)
    _crosshair(canvas, world.placed(arena.x, arena.y), aimed=front(arena, OBSTACLES) >= 0)
    return picture(canvas)


@lru_cache(maxsize=32)
def scenery(level: int, width: int, height: int) -> list[tuple[float, pygame.Surface, tuple[int, int]]]:
    """Return what stands still in a level: the depth of each layer, its fine canvas, and where that goes (px)."""
    size = (width * FINE, height * FINE)
    world = fit(*size, WALL_X, WALL_Y)
    back = pygame.Surface(size, depth=32)
    trees, barns = pygame.Surface(size, pygame.SRCALPHA), pygame.Surface(size, pygame.SRCALPHA)
    _landscape(back, world, np.random.default_rng(level))
    for placement in PLACEMENTS[level]:
        frame = world.placed(placement.x, placement.y, placement.scale_x, placement.scale_y)
        if placement.template == "tree":
            _tree(trees, frame)
        else:
            _inside(back, frame)
            _barn(barns, frame)
    layers = [(np.inf, back), (TREE_DEPTH, trees), (BARN_DEPTH, barns)]
    used = [layer.get_bounding_rect() for _, layer in layers]
    return [(depth, layer.subsurface(box), box.topleft) for (depth, layer), box in zip(layers, used, strict=True)]


def _landscape(canvas: pygame.Surface, world: Frame, random: np.random.Generator) -> None:
    """Paint sky, sun, clouds, two ranges of hills and a meadow."""
    width, height = canvas.get_size()
    ground = int(world.points([(0.0, HORIZON)])[0, 1])
    fade(canvas, pygame.Rect(0, 0, width, ground), SKY_TOP, SKY_LOW)
    veil = pygame.Surface(canvas.get_size(), pygame.SRCALPHA)
    for radius, alpha in ((3.4, 26), (2.5, 44), (1.8, 80), (1.3, 255)):
        glow = pygame.Surface(canvas.get_size(), pygame.SRCALPHA)
        shape(glow, world, ellipse(-2.0, 6.6, radius, radius, 48), (*SUN, alpha))
        canvas.blit(glow, (0, 0))
    for x in np.arange(-17.0, 20.0, 8.5):
        x, y, scale = x + random.uniform(-2.0, 2.0), random.uniform(2.0, 9.0), random.uniform(0.6, 1.2)
        for dx, dy, radius in ((-1.3, 0.0, 0.7), (-0.4, 0.35, 1.0), (0.7, 0.15, 0.8), (1.5, 0.0, 0.5)):
            shape(veil, world.placed(x, y, scale, scale), ellipse(dx, dy, 1.3 * radius, 0.6 * radius), CLOUD)
    veil.set_alpha(150)
    canvas.blit(veil, (0, 0))
    x = np.linspace(-40.0, 40.0, 161)
    for colour, base, swing, wave in ((FAR_HILLS, -5.2, 1.3, 0.23), (NEAR_HILLS, -6.9, 0.9, 0.34)):
        ridge = base + swing * np.sin(wave * x + random.uniform(0.0, 6.0)) + 0.3 * swing * np.sin(2.7 * wave * x)
        shape(canvas, world, [(-40.0, HORIZON), *zip(x, ridge, strict=True), (40.0, HORIZON)], colour)
    fade(canvas, pygame.Rect(0, ground, width, height - ground), MEADOW_FAR, MEADOW_NEAR)
    for depth in np.sqrt(np.linspace(0.02, 1.0, 150)):  # tufts and flowers, larger towards the viewer
        tuft = world.placed(random.uniform(-25.0, 25.0), HORIZON - 4.0 * depth, 0.5 * depth, 0.5 * depth)
        if random.uniform() < 0.7:
            shape(canvas, tuft, [(-0.4, 0.6), (-0.1, 0.0), (0.1, 0.0), (0.45, 0.7), (0.05, 0.2), (0.0, 0.9)], GRASS)
        else:
            shape(canvas, tuft, ellipse(0.0, 0.0, 0.25, 0.25, 10), FLOWERS[random.integers(len(FLOWERS))])


def _tree(layer: pygame.Surface, frame: Frame) -> None:
    """Paint a tree: a trunk with streaks of bark, and a crown lit from the upper left."""
    _, bottom, right, top = TREE_TRUNK
    layer.fill(BARK, frame.box(*TREE_TRUNK))
    layer.fill(BARK_DARK, frame.box(right - 0.7, bottom, right, top))
    for x, low, long in ((-1.0, -13.5, 4.0), (-0.5, -8.0, 3.0), (-0.1, -12.0, 3.5), (-0.9, -6.5, 4.0), (0.2, -6.0, 3.5)):
        layer.fill(BARK_LIGHT, frame.box(x, low, x + 0.16, low + long))
    # Each disc in its full size first, the light from the upper left on top; all within the discs.
    for colour, share, shift in ((LEAVES_DARK, 1.0, 0.0), (LEAVES, 0.84, 0.12), (LEAVES_LIGHT, 0.5, 0.26)):
        for x, y, radius in TREE_CROWN:
            centre = frame.points([(x, y)])[0] + frame.length(radius) * shift * np.array([-0.7, -1.0])
            pygame.draw.circle(layer, colour, centre.tolist(), frame.length(radius * share))


def _inside(back: pygame.Surface, frame: Frame) -> None:
    """Darken what is seen through a barn's window and doors. Birds fly in front of that."""
    foot, beam = BARN_BOXES[5], BARN_BOXES[6]
    for box in (WINDOW, (foot[0], foot[3], foot[2], beam[1])):
        dark = pygame.Surface(frame.box(*box).size, pygame.SRCALPHA)
        dark.fill((*INTERIOR, 205))
        back.blit(dark, frame.box(*box))


def _barn(layer: pygame.Surface, frame: Frame) -> None:
    """Paint a barn: boards, white trim and a roof, stone at the foot; between the boxes it stays open."""
    chimney, left, right, above, below, foot, beam, *posts = BARN_BOXES
    eaves = above[3] - 1.3
    for wall in (left, right, above, below, *posts):
        layer.fill(BOARDS, frame.box(*wall))
        for x in np.arange(np.ceil(wall[0] / 0.72) * 0.72, wall[2] - 0.06, 0.72):
            layer.fill(BOARDS_DARK, frame.box(x, wall[1], x + 0.06, wall[3]))
    for wall_left, bottom, wall_right, _ in (left, right):
        inner = (wall_left + 0.3, bottom + 0.35, wall_right - 0.3, eaves)
        layer.set_clip(frame.box(wall_left, bottom, wall_right, eaves))
        for (x0, y0), (x1, y1) in ((inner[:2], inner[2:]), (inner[:1] + inner[3:], inner[2:3] + inner[1:2])):
            ends = frame.points([(x0, y0), (x1, y1)]).tolist()
            pygame.draw.line(layer, TRIM, *ends, width=round(frame.length(0.3)))
        pygame.draw.rect(layer, TRIM, frame.box(wall_left, bottom, wall_right, eaves), round(frame.length(0.3)))
    layer.set_clip(None)
    x0, y0, x1, y1 = WINDOW
    layer.fill(TRIM, frame.box(x0 - 0.3, y0 - 0.3, x1 + 0.3, y1 + 0.3))
    layer.fill(CLEAR, frame.box(*WINDOW))
    for x0, y0, x1, y1 in posts:
        layer.fill(TRIM, frame.box(x0, y0, x0 + 0.2, y1))
        layer.fill(TRIM, frame.box(x1 - 0.2, y0, x1, y1))
    _courses(layer, frame, (left[0], eaves, right[2], right[3]), 4, 0.9, ROOF, ROOF_DARK)
    _courses(layer, frame, chimney, 5, 0.75, BRICKS, MORTAR)
    _courses(layer, frame, foot, 2, 1.6, STONE, STONE_DARK)
    layer.fill(TRIM, frame.box(*beam))
    layer.fill(TRIM_DARK, frame.box(beam[0], beam[1], beam[2], beam[1] + 0.25))


def _courses(
    layer: pygame.Surface, frame: Frame, box: Box, rows: int, length: float, fill: Colour, joint: Colour
) -> None:
    """Paint a box of stones, bricks or shingles: rows of a length, each shifted by half of one."""
    left, bottom, right, top = box
    layer.fill(fill, frame.box(*box))
    layer.set_clip(frame.box(*box))
    high = (top - bottom) / rows
    for row in range(rows):
        y = bottom + row * high
        layer.fill(joint, frame.box(left, y, right, y + 0.07))
        for x in np.arange(left + (0.5 + row % 2 / 2) * length, right, length):
            layer.fill(joint, frame.box(x, y, x + 0.07, y + high))
    layer.set_clip(None)


def _bird(canvas: pygame.Surface, world: Frame, bird: np.record, time: float) -> None:
    """Paint a bird on its way; its wings beat with the time in s."""
    radius, (plumage, belly, feathers) = BIRD_RADIUS[bird.size], PLUMAGE[bird.size]
    facing = np.copysign(1.0, bird.vx)
    climb = np.arctan2(bird.vy, max(abs(bird.vx), SLOWEST))
    frame = world.placed(bird.x, bird.y, facing * radius, radius, facing * climb)
    beat = 0.3 + 0.8 * np.sin(FLAPS[bird.size] * time + bird.phase)
    for points, fill, edge in (
        (((0.3, 0.3), (-0.1, 0.3 + 0.9 * beat), (-0.5, 0.3 + beat), (-0.2, 0.2)), feathers, OUTLINE),  # the far wing
        (TAIL, feathers, OUTLINE),
        (BILL, BEAK, OUTLINE),
        (BODY, plumage, OUTLINE),
        (BELLY, belly, None),
        (((0.25, 0.1), (-0.25, 1.05 * beat), (-0.8, 1.1 * beat), (-0.75, 0.6 * beat), (-0.4, -0.1)), feathers, OUTLINE),
        (EYE, WHITE, OUTLINE),
        (PUPIL, BLACK, None),
    ):
        shape(canvas, frame, points, fill, edge)


def _scoreboard(canvas: pygame.Surface, arena: np.record) -> None:
    """Paint the line above the arena: cartridges, hits and shots, level and time left."""
    width, unit = canvas.get_width(), canvas.get_height() / 100
    panel = pygame.Surface((width, round(5.5 * unit)), pygame.SRCALPHA)
    panel.fill((*PANEL, 200))
    canvas.blit(panel, (0, 0))
    for i in range(MAGAZINE):
        x = (1.6 + 2.0 * i) * unit
        full = i < arena.ammo
        tip = [(x, 2.2 * unit), (x + 0.6 * unit, 0.8 * unit), (x + 1.2 * unit, 2.2 * unit)]
        pygame.draw.polygon(canvas, COPPER if full else EMPTY, tip)
        canvas.fill(BRASS if full else EMPTY, (x, 2.2 * unit, 1.2 * unit, 2.4 * unit))
    accuracy = arena.hits / max(arena.shots, 1)
    seconds = (EPISODE_TICKS - arena.tick) * TICK
    line = partial(write, canvas, size=4.6 * unit, y=2.8 * unit)
    if arena.ammo == 0:
        line("reload!", colour=ALERT, x=18.5 * unit)
    line(f"hits {arena.hits} / shots {arena.shots}    {accuracy:.0%}", colour=TEXT, x=width / 2, align=0.5)
    line(f"level {arena.level}    {seconds:4.1f} s", colour=TEXT, x=width - 1.6 * unit, align=1.0)


def _crosshair(canvas: pygame.Surface, frame: Frame, aimed: bool) -> None:
    """Paint ring, hairs and centre; red when a bird is in front. A dark rim shows them on any background."""
    for colour, width in ((BLACK, 0.26), (AIMED if aimed else WHITE, 0.13)):
        pixels = round(frame.length(width))
        rim = (width - 0.13) / 2
        centre = frame.origin.tolist()
        pygame.draw.circle(canvas, colour, centre, frame.length(0.9 + rim), pixels)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            ends = frame.points([((0.4 - rim) * x, (0.4 - rim) * y), ((1.4 + rim) * x, (1.4 + rim) * y)]).tolist()
            pygame.draw.line(canvas, colour, *ends, width=pixels)
        pygame.draw.circle(canvas, colour, centre, pixels)
