"""Everything that surrounds the program."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.chance import Chance
from joybridge.adapters.pygame_programs.inside.clock import VirtualClock
from joybridge.adapters.pygame_programs.inside.display import Display
from joybridge.adapters.pygame_programs.inside.fences import Fences
from joybridge.adapters.pygame_programs.inside.frames import Frames
from joybridge.adapters.pygame_programs.inside.hands import Hands
from joybridge.adapters.pygame_programs.inside.rewards import Texts
from joybridge.adapters.pygame_programs.inside.score import Score
from joybridge.adapters.pygame_programs.inside.sounds import Sounds
from joybridge.adapters.pygame_programs.inside.stem import Folders


class Stage:
    """The surroundings of the program, made in an order in which each may use what was made before."""

    def __init__(self, settings: Mapping[str, Any], folders: Folders, on_frame: Callable[[], None]) -> None:
        """Put everything in the place of the real things."""
        self.folders = folders
        pygame.sysfont.initsysfonts()  # it starts a process the first time
        self.clock = VirtualClock()
        self.frames = Frames(self.clock, settings["fps"], on_frame)
        self.hands = Hands(self.clock, self.frames)
        self.display = Display()
        self.sounds = Sounds(self.clock)
        self.texts = Texts()
        self.chance = Chance()
        self.fences = Fences(str(folders.base))
        self._settings = settings

    def keep_score(self) -> None:
        """Begin to look at what is paid. Raises ValueError for a wrong reward, end or hook."""
        rewards, done, hook = (self._settings[name] for name in ("rewards", "done", "hook"))
        self.score = Score(self.texts, self.sounds, rewards, done, hook)

    def size(self) -> tuple[int, int]:
        """Return the width and the height of the display."""
        height, width = self.display.pixels().shape
        return width, height


def own_folder(base: Path) -> Folders:
    """Return the folders of the first process, which has entered its own."""
    folders = Folders(base)
    for name in ("home", "work", "tmp"):
        (folders.own / name).mkdir(parents=True)
    return folders
