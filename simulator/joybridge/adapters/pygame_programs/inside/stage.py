"""Everything that surrounds the program."""

import json
import os
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.chance import Chance
from joybridge.adapters.pygame_programs.inside.clock import Clock, RealClock, VirtualClock
from joybridge.adapters.pygame_programs.inside.display import Display
from joybridge.adapters.pygame_programs.inside.fences import Fences
from joybridge.adapters.pygame_programs.inside.frames import Frames
from joybridge.adapters.pygame_programs.inside.hands import Hands
from joybridge.adapters.pygame_programs.inside.joystick import Joysticks
from joybridge.adapters.pygame_programs.inside.rewards import Texts
from joybridge.adapters.pygame_programs.inside.score import Score
from joybridge.adapters.pygame_programs.inside.sounds import Sounds
from joybridge.adapters.pygame_programs.inside.stem import Folders, leave, serve
from joybridge.simulator.workers.link import Link


class Stage:
    """The surroundings of the program, made in an order in which each may use what was made before."""

    def __init__(self, settings: Mapping[str, Any], folders: Folders, on_frame: Callable[[], None]) -> None:
        """Put everything in the place of the real things; for a program in its own window, only mouse and keys."""
        self.folders, self._settings = folders, settings
        window = settings["window"]
        pygame.sysfont.initsysfonts()  # it starts a process the first time
        self.clock: Clock = RealClock() if window else VirtualClock()
        self.frames = Frames(self.clock, settings["fps"], on_frame, window=window)
        self.hands = Hands(self.clock, self.frames)
        self.joysticks = Joysticks(self.frames)
        self.display = Display(window=window)
        self.texts = Texts()
        self.played: Counter[str] = Counter()  # sounds, by the name of the file
        self._chance: Chance | None = None
        if window:
            _be_silent_without_a_sound_card()
        if isinstance(self.clock, VirtualClock):
            Sounds(self.clock, self.played)
            self._chance = Chance()
        self.fences = Fences(str(folders.base))

    def raise_fences(self) -> None:
        """Begin to refuse what a program may not do, unless it is in its own window."""
        if not self._settings["window"]:
            self.fences.raise_up(self._settings["memory"])

    def wait_for_episode(self, link: Link) -> tuple[Link, dict[str, Any]]:
        """Return in the process that plays, with its link and what it was told. Each episode is a fork of this process.

        A program in its own window plays one episode itself.
        """
        if not self._settings["window"]:
            return serve(link, self.folders, self.fences)
        try:
            return link, json.loads(link.receive()[1])
        except (EOFError, OSError):
            leave(self.folders, self.fences)

    def begin(self, seed: int) -> None:
        """Begin an episode with a seed."""
        if self._chance is not None:
            self._chance.begin(seed)
        self.score.begin()

    def keep_score(self) -> None:
        """Begin to look at what is paid. Raises ValueError for a wrong reward, end or hook."""
        rewards, done, hook = (self._settings[name] for name in ("rewards", "done", "hook"))
        self.score = Score(self.texts, self.played, rewards, done, hook)

    def size(self) -> tuple[int, int]:
        """Return the width and the height of the display."""
        height, width = self.display.pixels().shape
        return width, height


def _be_silent_without_a_sound_card() -> None:
    """Let a program that plays sounds run where there is nothing to play them on."""
    spoken, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)  # the library of the sound card complains there, in sixty lines
    try:
        pygame.mixer.init()
    except pygame.error:
        os.environ["SDL_AUDIODRIVER"] = "dummy"
    finally:
        os.dup2(spoken, 2)
        os.close(spoken)
        os.close(nowhere)
    pygame.mixer.quit()


def own_folder(base: Path) -> Folders:
    """Return the folders of the first process, which has entered its own."""
    folders = Folders(base)
    for name in ("home", "work", "tmp"):
        (folders.own / name).mkdir(parents=True)
    return folders
