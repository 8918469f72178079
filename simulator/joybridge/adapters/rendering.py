"""Whether the pictures of an environment fit the contract. `render` in the mode "rgb_array" returns them."""

import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from joybridge.contract.limits import MAX_PIXELS
from joybridge.contract.tensors import Array

log = logging.getLogger("simulator")


def choose_rendering(
    make: Callable[..., Any], arguments: Mapping[str, Any]
) -> tuple[dict[str, Any], tuple[int, int] | None]:
    """Return the arguments for making an environment, and (width, height) of its pictures; None: it has none.

    It is made without a mode if it can be drawn so all the same; see `draw`. An environment that has the mode
    "rgb_array" but whose pictures cannot be sent is served without them; a warning says why.
    """
    for driver in ("SDL_VIDEODRIVER", "SDL_AUDIODRIVER"):  # pygame needs neither a display nor a sound card
        os.environ.setdefault(driver, "dummy")
    arguments = dict(arguments)
    with making(make, arguments) as env:
        modes = env.metadata.get("render_modes") or ()
    if "rgb_array" not in modes:
        return arguments, None
    drawing = arguments | {"render_mode": "rgb_array"}
    try:
        picture = _first_picture(make, drawing)
    except Exception as error:
        log.warning("the environment is served without pictures: %s: %s", type(error).__name__, error)
        return arguments, None
    with suppress(Exception):
        if np.array_equal(picture, _first_picture(make, arguments)):
            drawing = arguments
    return drawing, (picture.shape[1], picture.shape[0])


def draw(env: Any) -> Array:
    """Return the picture of an environment, which has the mode "rgb_array" meanwhile.

    With a mode, some do more in each step: LunarLander takes three times as long for its sparks.
    """
    bare = env.unwrapped
    if getattr(bare, "render_mode", "rgb_array") == "rgb_array":
        return np.array(env.render())
    mode, bare.render_mode = bare.render_mode, "rgb_array"
    try:
        return np.array(env.render())
    finally:
        bare.render_mode = mode


def close(env: Any) -> None:
    """Close an environment. Those that draw with pygame would end it for all other arenas, so nobody ends it here."""
    pygame: Any = sys.modules.get("pygame")
    if pygame is not None:
        pygame.quit = pygame.display.quit = lambda: None
    try:
        env.close()
    except Exception:
        log.warning("an environment failed to close", exc_info=True)


@contextmanager
def making(make: Callable[..., Any], arguments: Mapping[str, Any]) -> Iterator[Any]:
    """Yield an environment, and close it at the end."""
    env = make(**arguments)
    try:
        yield env
    finally:
        close(env)


def _first_picture(make: Callable[..., Any], arguments: Mapping[str, Any]) -> Array:
    with making(make, arguments) as env:
        env.reset(seed=0)
        picture = draw(env)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or max(picture.shape) > MAX_PIXELS:
        came = f"{picture.dtype} {list(picture.shape)}"
        raise ValueError(f"render returned {came}, expected uint8 [height, width, 3] of at most {MAX_PIXELS} pixels")
    return picture


def tick_seconds(env: Any) -> float:
    """Return the time between two pictures of an environment, in seconds; 0 if it does not say."""
    rate = env.metadata.get("render_fps") or 0
    return 1.0 / rate if rate > 0 else 0.0
