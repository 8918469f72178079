"""Options that say what the agents of the two large games observe: numbers, images, or both.

One place says which images there are: `views`. Each game brings its field, its colors and its painter.
"""

from collections.abc import Mapping

from joybridge.games.pictures import View
from joybridge.simulator import image, option
from joybridge.v1 import bridge_pb2 as pb

STATE = "state"
WIDE_REACH = 16.0  # units from the pointer to the edge of the wide image

OBSERVATIONS = {
    STATE: (STATE,),
    "screen": ("screen",),
    "fovea": ("fovea",),
    "fovea+wide": ("fovea", "wide"),
    "screen+fovea": ("screen", "fovea"),
    "all": (STATE, "screen", "fovea", "wide"),
}

SIGHT_OPTIONS = [
    option(
        "observation",
        list(OBSERVATIONS),
        description="what agents observe. state: numbers; screen: an image of the whole field; fovea: one of a small "
        "square around the pointer; wide: one of a large square around it; all: everything. The heading of the "
        "locomotion steer, which no image shows, is always a number",
    ),
    option(
        "screen_size",
        ["32", "48", "64", "84", "96", "128"],
        default="64",
        description="width of the image screen in pixels",
    ),
    option(
        "fovea_size", ["24", "32", "48"], default="32", description="width and height of the images around the pointer"
    ),
    option("fovea_reach", ["4", "8", "16"], description="units from the pointer to the edge of the image fovea"),
    option("color", ["gray", "rgb"], description="of images"),
    option("cursor", ["drawn", "hidden"], description="whether the image screen shows the pointer, as a thin circle"),
    option(
        "positions",
        ["exact", "rounded"],
        description="where images show things. exact: shades tell a place within a pixel; rounded: in whole pixels",
    ),
]

_DESCRIPTIONS = {
    "screen": "the whole field",
    "fovea": "a small square around the pointer",
    "wide": "a large square around the pointer",
}


def sees_state(options: Mapping[str, str]) -> bool:
    """Return whether agents observe numbers."""
    return STATE in OBSERVATIONS[options["observation"]]


def views(options: Mapping[str, str], half_width: float, half_height: float) -> dict[str, View]:
    """Return the images that agents observe, by the names of their sensors.

    half_width, half_height: of the field, in units.
    """
    width, size = int(options["screen_size"]), int(options["fovea_size"])
    channels = 3 if options["color"] == "rgb" else 1
    unit, rounded = 2 * half_width / width, options["positions"] == "rounded"
    every = {
        "screen": View(round(2 * half_height / unit), width, unit, channels, centered=False, rounded=rounded),
        "fovea": View(size, size, 2 * float(options["fovea_reach"]) / size, channels, centered=True, rounded=rounded),
        "wide": View(size, size, 2 * WIDE_REACH / size, channels, centered=True, rounded=rounded),
    }
    return {name: every[name] for name in OBSERVATIONS[options["observation"]] if name in every}


def image_sensor(name: str, view: View) -> pb.Sensor:
    """Return the sensor of a view."""
    description = f"{_DESCRIPTIONS[name]}, {view.unit:.3g} units per pixel"
    return image(name, view.height, view.width, description, channels=view.channels, centered=view.centered)
