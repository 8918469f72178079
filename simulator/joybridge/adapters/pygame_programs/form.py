"""What of a program an agent sees and controls: sensors, axes and branches, under given options."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from joybridge.adapters.pygame_programs.settings import PygameSettings
from joybridge.adapters.pygame_programs.wire import STICK_BUTTONS
from joybridge.adapters.settings import AdapterError
from joybridge.contract.limits import MAX_PIXELS
from joybridge.simulator import axis, behavior, branch, button, channel, image, option, sensor
from joybridge.v1 import bridge_pb2 as pb

MAX_KEYS = 32  # that are buttons
CODES = {  # of keys as browsers call them, by pygame's names; letters, digits and F1 to F12 have the same
    "RETURN": "enter", "ESCAPE": "Escape", "LSHIFT": "shift", "RSHIFT": "ShiftRight", "LCTRL": "ctrl",
    "RCTRL": "ControlRight", "LALT": "alt", "RALT": "AltRight", "BACKSPACE": "Backspace", "SPACE": "space",
    "TAB": "tab", "LEFT": "left", "RIGHT": "right", "UP": "up", "DOWN": "down", "COMMA": "Comma", "PERIOD": "Period",
    "MINUS": "Minus", "EQUALS": "Equal", "SLASH": "Slash", "SEMICOLON": "Semicolon", "DELETE": "Delete",
}  # fmt: skip
LEFT_RIGHT = ("left", "middle", "right")  # buttons of a mouse


class Look(NamedTuple):
    """What the first look at the program has shown."""

    width: int  # of the display, in pixels
    height: int
    keys: dict[str, int]  # pygame's numbers by their names
    pointer: bool
    buttons: list[str]
    wheel: bool
    stick: bool  # of a joystick
    read: list[str]  # keys that it was seen to read
    channels: list[str]
    states: int  # numbers of the hook's sensor
    metrics: list[str]

    def picture(self, limit: int = MAX_PIXELS) -> tuple[int, int]:
        """Return the width and the height of pictures: those of the display, halved until none is above a limit."""
        width, height = self.width, self.height
        while max(width, height) > limit:
            width, height = width // 2, height // 2
        return width, height


def make_look(settings: PygameSettings, shown: Mapping[str, Any], read: Sequence[str] = ()) -> Look:
    """Return the look at a program, with what the settings say instead. Raises AdapterError.

    read: keys that it was seen to read.
    """
    numbers: Mapping[str, int] = shown["numbers"]
    found = sorted({*shown["keys"], *read})  # more than MAX_KEYS are seen where a program compares with all there are
    keys: Sequence[str] = settings.names.get("keys", found if len(found) <= MAX_KEYS else shown["keys"])
    if unknown := [key for key in keys if key not in numbers]:
        raise AdapterError(f"got the key {unknown[0]!r}, expected a name of pygame without K_, as in LEFT, SPACE or a")
    if len(keys) > MAX_KEYS:
        raise AdapterError(
            f"the program reads {len(keys)} keys, more than {MAX_KEYS}; choose with keys=LEFT,RIGHT,SPACE"
        )
    pointer = settings.flags.get("mouse", bool(shown["pointer"] or not (keys or shown["joystick"])))
    buttons = settings.names.get("buttons", (shown["buttons"] or ["left"]) if pointer else [])
    if unknown := [name for name in buttons if name not in LEFT_RIGHT]:
        raise AdapterError(f"got the button {unknown[0]!r}, expected {', '.join(LEFT_RIGHT)}")
    wheel = settings.flags.get("wheel", bool(shown["wheel"]))
    if not (pointer or buttons or keys or wheel or shown["joystick"]):
        raise AdapterError("nothing is left to control; set keys=, mouse=true or buttons=left")
    width, height = shown["size"]
    chosen = {key: numbers[key] for key in keys}
    return Look(
        width,
        height,
        chosen,
        pointer,
        list(buttons),
        wheel,
        shown["joystick"],
        list(read),
        shown["channels"],
        shown["state"],
        shown["metrics"],
    )


def options_of(look: Look) -> list[pb.Option]:
    """Return the options of a program."""
    intervals = ["4", "1", "2", "8", "12", "16"]
    options = [option("decision_interval", intervals, description="Frames of the program per decision.")]
    sizes = ["64", "48", "84", "128", *(["none"] if look.states else [])]
    options += [
        option("screen", sizes, description="The sensor `screen` has as many pixels as a square with this side."),
        option("colors", ["rgb", "gray"], description="Of the pictures that are sensors."),
    ]
    if look.pointer:
        options += [
            option("pointer", ["position", "velocity"], description="What the two axes of the pointer set."),
            option("fovea", ["none", "32", "64"], description="The sensor `fovea`: pixels around the pointer."),
        ]
    return options


class Form(NamedTuple):
    """Sensors, axes and branches under some options."""

    interval: int  # frames per decision
    pointer: str  # "position", "velocity", or "" for none
    screen: list[int]  # height and width of the sensor, empty for none
    fovea: int  # side of the sensor, 0 for none
    gray: bool
    look: Look

    @property
    def channels(self) -> int:
        """Return the number of colors."""
        return 1 if self.gray else 3

    @property
    def act_bytes(self) -> int:
        """Return the size of an act: float32 axes and int32 choices."""
        return 4 * (len(self.axes()) + len(self.branches()))

    def sensors(self) -> list[pb.Sensor]:
        """Return the sensors, in the order in which the program's process sends them."""
        sensors = []
        if self.screen:
            height, width = self.screen
            sensors.append(image("screen", height, width, "The whole display.", channels=self.channels))
        if self.fovea:
            text = "The pixels around the pointer; black outside of the display."
            sensors.append(image("fovea", self.fovea, self.fovea, text, channels=self.channels, centered=True))
        if self.look.states:
            sensors.append(sensor("state", [self.look.states], description="What the hook returns."))
        return sensors

    def axes(self) -> list[pb.Axis]:
        """Return the axes."""
        sticks = (
            [
                axis("stick_x", description="Of the joystick; positive is right.", way="right"),
                axis("stick_y", description="Of the joystick; positive is up.", way="up"),
            ]
            if self.look.stick
            else []
        )
        if not self.pointer:
            return sticks
        stem = "pointer" if self.pointer == "position" else "pointer_velocity"
        text = "Of the pointer: -1 is the {}, 1 the {} of the display."
        if self.pointer == "velocity":
            text = "Of the pointer, in 4 % of the display's width per frame; positive is {1}."
        return [
            axis(f"{stem}_x", description=text.format("left edge", "right edge"), kind=self.pointer, way="right"),
            axis(f"{stem}_y", description=text.format("lower edge", "upper edge"), kind=self.pointer, way="up"),
            *sticks,
        ]

    def branches(self) -> list[pb.Branch]:
        """Return the branches: buttons of the mouse, keys, buttons of the joystick, and the wheel."""
        look = self.look
        branches = [
            button(f"mouse_{name}", f"The {name} button of the mouse.", key=f"mouse {name}") for name in look.buttons
        ]
        branches += [button(f"key_{name}", f"pygame.K_{name}", key=_key(name)) for name in look.keys]
        if look.stick:
            branches += [button(f"joy_{n}", f"Button {n} of the joystick.") for n in range(STICK_BUTTONS)]
        if look.wheel:
            branches.append(branch("wheel", ["none", "up", "down"], "The wheel of the mouse."))
        return branches

    def player(self) -> pb.Behavior:
        """Return the behavior of the agent that plays."""
        return behavior(
            "player",
            sensors=self.sensors(),
            axes=self.axes(),
            branches=self.branches(),
            channels=[channel(name) for name in self.look.channels],
            metrics=self.look.metrics,
        )

    def inside(
        self, seconds: float, *, hashes: bool = False, watch: str = "", skip_drawing: bool = False
    ) -> dict[str, Any]:
        """Return what the program's process needs to know. seconds: for a decision.

        hashes: of frames are wanted. watch: "keys" are pressed to find out which of them the program reads, "texts" are
        searched for numbers. skip_drawing: only the last frame of a decision is drawn, unless all are wanted.
        """
        return {
            "interval": self.interval,
            "pointer": self.pointer,
            "screen": self.screen,
            "fovea": self.fovea,
            "gray": self.gray,
            "buttons": self.look.buttons,
            "keys": list(self.look.keys.values()),
            "wheel": self.look.wheel,
            "stick": self.look.stick,
            "seconds": seconds,
            "hashes": hashes,
            "watch": watch,
            "skip_drawing": skip_drawing and not hashes,
            "act_bytes": self.act_bytes,
        }


def make_form(look: Look, options: Mapping[str, str]) -> Form:
    """Return the form of a program under its options."""
    side = options["screen"]
    screen: list[int] = []
    if side != "none":
        ratio = math.sqrt(look.height / look.width)
        screen = [max(1, round(int(side) * ratio)), max(1, round(int(side) / ratio))]
    fovea = options.get("fovea", "none")
    return Form(
        int(options["decision_interval"]),
        options.get("pointer", ""),
        screen,
        0 if fovea == "none" else int(fovea),
        options["colors"] == "gray",
        look,
    )


def _key(name: str) -> str:
    """Return the key of a browser for one of pygame's, as `button` takes it; "" where none is known."""
    plain = len(name) == 1 or (name[:1] == "F" and name[1:].isdecimal())
    return name if plain else CODES.get(name.upper(), "")
