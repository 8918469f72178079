"""What the server and the processes of a program say to each other, over links of `simulator/workers`.

Each process connects to the server's door, a Unix socket, and says which number it was given: the number of the fork
that was asked for, or 0 for the process that was started.
"""

import json
import re
import socket
import struct
from typing import Any

from joybridge.simulator.workers.link import Link

# To a stem: JSON. To a player: an act as float32 axes and int32 choices; JSON for DRAW, KEEP and BRANCH; REPLAY: many
# acts; WATCHED and TICKS: nothing. KEEP comes before an act: pictures of the frames but the last, which TICKS asks for.
FORK, ACT, DRAW, BRANCH, REPLAY, WATCHED, KEEP, TICKS = b"K", b"A", b"D", b"B", b"R", b"W", b"E", b"L"
HELLO, FIRST, STEP, PICTURE, DONE, FAULT = b"H", b"1", b"T", b"P", b"N", b"F"  # from them

STEP_HEADER = struct.Struct("<Bq")  # whether the episode is over, and the virtual time in nanoseconds
OWN_FOLDER_DESCRIPTOR = 100  # of the folder of a process, in the process
OWN_FOLDER = f"/proc/self/fd/{OWN_FOLDER_DESCRIPTOR}"  # its path, the same in all of them
ENDING = {"ESCAPE", "q", "F4", "F10", "F11", "F12", "PRINT", "PRINTSCREEN"}  # keys that end or change the program
STICK_BUTTONS = 4  # of a joystick
STACKS = "stacks"  # the name of a file there, to which processes write where they stand when a frame takes too long
DOOR = "door"  # the name of the socket in the folder of a program


def knock(folder: str, number: int) -> Link:
    """Connect to the door in a folder, and say which process this is."""
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(f"{folder}/{DOOR}")
    link = Link(connection)
    link.send(HELLO, as_json(number))
    return link


def as_json(value: Any) -> bytes:
    """Return a message in JSON."""
    return json.dumps(value).encode()


def nth_text(source: str) -> tuple[int, str]:
    """Return which text of a frame a reward is meant for, and the pattern: 0, if it is any text that matches."""
    found = re.fullmatch(r"text([1-9]\d*):(.+)", source)
    return (int(found[1]), found[2]) if found else (0, source)
