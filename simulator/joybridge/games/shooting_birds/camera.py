"""A field that is three screens wide, and a camera that shows one screen of it: the option `camera`.

There are three devices for one purpose: to push the crosshair against the border of the screen, an axis of its own, or
a button that holds the field while the crosshair drags it. Whatever moves the camera, the crosshair stays where it is
on the screen. Birds enter anywhere outside the screen, so they must be looked for.
"""

import numpy as np

from joybridge.games.shooting_birds.sensing import ABSENT, RAY_LENGTH, RAY_X, RAY_Y, RAYS
from joybridge.simulator import axis, button, metric, option, sensor
from joybridge.simulator.compiled import compiled

CAMERAS = ["fixed", "edge", "axis", "drag"]
FIXED, EDGE, AXIS, DRAG = range(len(CAMERAS))

SCREENS = 3
SCREEN_WIDTH = 38.0  # units, between the walls
MAX_CAMERA_X = SCREEN_WIDTH * (SCREENS - 1) / 2  # from the field's middle to the camera
HALF_X, HALF_Y = 19.0, 11.5  # from the camera to the borders of the screen
SCROLL_SPEED = 40.0  # units/s
PUSH_BEGIN, PUSH_FULL = 15.0, 17.7  # from the middle of the screen: where `edge` begins to scroll, and is fastest
TICK = 0.02  # s

OPTIONS = [
    option(
        "camera",
        CAMERAS,
        description="fixed: one screen, as in the paper's game; otherwise the field is three screens wide, and the "
        "view is moved by the crosshair at the border of the screen (edge), by an axis of its own (axis), or by the "
        "crosshair while a button is held (drag)",
    ),
    option("camera_position", ["shown", "hidden"], description="whether a sensor tells where the camera is"),
    option("hints", ["off", "on"], description="whether a sensor tells how many birds are beside the screen"),
]
SCROLL = axis("scroll", description="speed of the camera to the right, as a fraction of its top speed", kind="velocity")
GRAB = button("grab", "hold the field, so that the crosshair drags it along")
POSITION = sensor("camera", [1], -1.0, 1.0, "the camera's place: -1 leftmost, 1 rightmost", elements=["x"])
HINTS = sensor(
    "hints", [2], 0.0, 1.0, "shares of the birds beyond the borders of the screen", elements=["left", "right"]
)
METRIC = metric("empty_screen", "fraction of the time without a bird on the screen")


@compiled
def scroll(arena, camera):
    """Move the camera by one tick, and the crosshair with it, as the device `camera` says; see `CAMERAS`.

    arena.scroll: what the action says, the value of the axis, or 1 while the button is held.
    """
    if camera == EDGE:
        place = arena.x - arena.camera
        push = min(max((abs(place) - PUSH_BEGIN) / (PUSH_FULL - PUSH_BEGIN), 0.0), 1.0)
        shift = (push if place > 0.0 else -push) * SCROLL_SPEED * TICK
    elif camera == AXIS:
        shift = arena.scroll * SCROLL_SPEED * TICK
    else:
        shift = -arena.scroll * arena.vx * TICK  # the point of the field under the crosshair stays under it
    place = min(max(arena.camera + shift, -MAX_CAMERA_X), MAX_CAMERA_X)
    arena.x += place - arena.camera
    arena.camera = place


@compiled
def enter(arena, chance):
    """Return where a bird enters, anywhere outside the screen, for a chance in [0, 1)."""
    left = MAX_CAMERA_X + arena.camera  # width of the field to the left of the screen
    place = chance * 2.0 * MAX_CAMERA_X
    return place - MAX_CAMERA_X - HALF_X if place < left else place - left + arena.camera + HALF_X


@compiled
def count_birds(arena):
    """Return how many birds are to the left of the screen, on it, and to its right. Those that wait do not count."""
    left, seen, right = 0, 0, 0
    for bird in arena.birds:
        if bird.wait == 0:
            place = bird.x - arena.camera
            left += place < -HALF_X
            right += place > HALF_X
            seen += -HALF_X <= place <= HALF_X
    return left, seen, right


@compiled
def write_position(arenas, world, position):
    """Write where the camera of every arena is into `position` [arenas, 1]."""
    for i in range(len(arenas)):
        position[i, 0] = arenas[i].camera / MAX_CAMERA_X


@compiled
def write_hints(arenas, world, hints):
    """Write which shares of the birds of every arena are beside the screen into `hints` [arenas, 2]."""
    for i in range(len(arenas)):
        left, _, right = count_birds(arenas[i])
        hints[i, 0], hints[i, 1] = left / len(arenas[i].birds), right / len(arenas[i].birds)


@compiled
def end_rays_at_border(arena, rays):
    """Let `rays` [12, 3] report nothing that lies beyond the border of the screen."""
    place = arena.x - arena.camera
    for k in range(RAYS):
        border = np.inf
        if RAY_X[k] != 0.0:
            border = ((HALF_X if RAY_X[k] > 0.0 else -HALF_X) - place) / RAY_X[k]
        if RAY_Y[k] != 0.0:
            border = min(border, ((HALF_Y if RAY_Y[k] > 0.0 else -HALF_Y) - arena.y) / RAY_Y[k])
        if rays[k, 0] * RAY_LENGTH > border:
            rays[k, 0] = rays[k, 1] = ABSENT
        if rays[k, 2] * RAY_LENGTH > border:
            rays[k, 2] = ABSENT
