"""What happens at the ends of frames: the program is given input, and the server is told what is to be seen."""

import json
import signal
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pygame

from joybridge.adapters.pygame_programs.inside.hands import BUTTONS, KEYS
from joybridge.adapters.pygame_programs.inside.numbers import Numbers
from joybridge.adapters.pygame_programs.inside.pictures import crop, hash_of, scale
from joybridge.adapters.pygame_programs.inside.scan import end_texts, hash_of_sources, scan
from joybridge.adapters.pygame_programs.inside.stage import Stage
from joybridge.adapters.pygame_programs.inside.stem import fork, leave
from joybridge.adapters.pygame_programs.inside.watching import Watch
from joybridge.adapters.pygame_programs.wire import (
    ACT,
    BRANCH,
    DONE,
    DRAW,
    FAULT,
    FIRST,
    KEEP,
    PICTURE,
    REPLAY,
    STEP,
    STEP_HEADER,
    STICK_BUTTONS,
    TICKS,
    WATCHED,
    as_json,
)
from joybridge.contract.tensors import Array
from joybridge.simulator.sight import gray
from joybridge.simulator.workers.link import Link

SPEED = 0.04  # of a pointer that is moved: widths of the display per frame, at most


class Player:
    """The program as the server sees it: first a stem, from which players are forked."""

    stage: Stage  # which calls on_frame
    root: Path | None = None  # see Program; none before it is found

    def __init__(self, link: Link) -> None:
        """link: of the first process."""
        self.link = link
        self.playing = False
        self._form: Mapping[str, Any] = {}
        self._frames_left = 0  # of the decision
        self._asked = False  # the server, for a decision that has not come yet
        self._acts: list[bytes] = []  # that are still to be replayed
        self._place = np.zeros(2)  # of the pointer, as parts of the display
        self._speed = np.zeros(2)  # the same, per frame
        self._seen = b""  # the last observation
        self._watch: Watch | None = None
        self._numbers = Numbers()  # which sees texts up to the first frame, and then if the program is watched
        self._hashes = bytearray()  # of the frames of the decision, if they are wanted
        self._kept_size: tuple[int, int] | None = None  # of pictures of the frames but the last, if they are wanted
        self._kept: list[bytes] = []

    def enter(self, stage: Stage) -> None:
        """Play on a stage."""
        self.stage = stage
        stage.texts.readers.append(self._numbers)

    def on_frame(self) -> None:
        """End a frame, and say whether the next one is drawn."""
        self._go_on()
        if self.playing and self._form["skip_drawing"]:
            self.stage.display.draw(self._frames_left <= 1 or self._kept_size is not None)

    def _go_on(self) -> None:
        """Go on with the decision, or answer and wait for the next one."""
        self.stage.texts.end_frame()
        if not self.playing:
            if self.stage.frames.ready:
                self._become_stem(FIRST, as_json(self._first_look()))
            return
        self._frames_left -= 1
        if self._form["hashes"]:
            self._hashes += hash_of(self.stage.display.pixels())
        self.stage.score.after_frame()
        if self._kept_size and self._frames_left > 0:
            self._kept.append(scale(self.stage.display.pixels(), *self._kept_size).tobytes())
        if self.stage.score.over:
            self.end()
        elif self._asked:
            if not self._listen(self.stage.clock.patience()):
                self._move()
        elif self._frames_left > 0:
            self._move()
        elif self._acts:
            self._act(self._acts.pop(0))
        else:
            self._answer(over=False)

    def end(self) -> None:
        """Tell the server that the program has ended, and with it the episode."""
        if not self.playing:
            refused = self.stage.fences.refused
            why = f"; before that, {refused}" if refused else ""
            self.fail(f"the program ended before it had drawn a frame and asked for input{why}")
        sys.modules["__main__"] = self.stage.score.program  # which runpy takes back when the program ends
        self._acts.clear()
        if self._asked:
            self._listen(None)  # the server takes no answer before it has sent what it was asked for
        self._answer(over=True)

    def fail(self, text: str, traceback: str = "") -> NoReturn:
        """Tell the server why the program cannot go on, and end with the link."""
        signal.setitimer(signal.ITIMER_REAL, 0)
        with self.stage.fences.trusting():
            try:
                self.link.send(FAULT, as_json({"text": text, "traceback": traceback}))
                while self.link.receive()[0] == WATCHED:
                    self.link.send(DONE, as_json(self._watched()))
            except (OSError, EOFError):
                pass
            leave(self.stage.folders, self.stage.fences)

    def _watched(self) -> Any:
        """Return the numbers of the keys that the program reads, or what its texts have shown."""
        if self._watch:
            return self._watch.read()
        return {
            "numbers": self._numbers.found(),
            "texts": self._numbers.seen(),
            "missed": self.stage.score.missed(),
        }

    def _first_look(self) -> dict[str, Any]:
        if len(threads := threading.enumerate()) > 1:
            names = ", ".join(thread.name for thread in threads[1:])
            self.fail(f"the program has started threads ({names}), which no copy of it would have")
        if self.root is None:
            self.fail("importing its package already runs the program, which cannot be looked up; name its FILE")
        controls, stick = scan(self.root)._asdict(), self.stage.joysticks.plugged
        return {
            "size": self.stage.size(),
            **self.stage.score.look(),
            "numbers": KEYS,
            **controls,
            "joystick": stick,
            "end_texts": end_texts(self.root),
            "sources": hash_of_sources(self.root),
        }

    def _become_stem(self, kind: bytes, message: bytes) -> None:
        """Stand still, and go on as a player in each fork."""
        signal.setitimer(signal.ITIMER_REAL, 0)
        self.link.send(kind, message)
        stage = self.stage
        self.link, told = stage.wait_for_episode(self.link)
        if not self.playing:
            self.playing, self._form = True, told["form"]
            stage.begin(told["seed"])
            self._watch = Watch(stage.hands) if self._form["watch"] == "keys" else None
            if self._form["watch"] != "texts":
                stage.texts.readers.remove(self._numbers)
            self._place = np.full(2, 0.5)
        self._answer(over=False)

    def _answer(self, *, over: bool) -> None:
        """Tell the server what is to be seen, and wait for the next decision, in a window no longer than it spares."""
        signal.setitimer(signal.ITIMER_REAL, 0)
        score = self.stage.score
        if pygame.display.get_surface() is not None or not self._seen:  # else the program has closed its display
            self._seen = self._observe()
        numbers = np.array([*score.take(), *score.metrics()], np.float32)
        header = STEP_HEADER.pack(over, self.stage.clock.now)
        self.link.send(STEP, header + numbers.tobytes() + self._seen + self._hashes)
        self._hashes.clear()
        self._asked = True
        self._listen(None if over else self.stage.clock.patience())

    def _listen(self, seconds: float | None) -> bool:
        """Do what the server says, up to the next decision; return False if none comes in so many seconds."""
        begin = self.stage.clock.now
        try:
            while self._asked:
                if seconds is not None and not self.link.waits(seconds):
                    return False
                self._do(*self.link.receive())
        except (OSError, EOFError):
            leave(self.stage.folders, self.stage.fences)
        finally:
            self.stage.clock.borrowed += self.stage.clock.now - begin
        return True

    def _do(self, kind: bytes, message: bytes) -> None:
        """Do what the server says."""
        if kind == ACT:
            self._act(message)
        elif kind == REPLAY:
            size = self._form["act_bytes"]
            self._acts = [message[at : at + size] for at in range(0, len(message), size)]
            self._act(self._acts.pop(0))
        elif kind == DRAW:
            self.link.send(PICTURE, scale(self.stage.display.pixels(), *json.loads(message)).tobytes())
        elif kind == KEEP:
            self._kept_size = tuple(json.loads(message))
        elif kind == TICKS:
            self.link.send(PICTURE, b"".join(self._kept))
            self._kept_size, self._kept = None, []
        elif kind == WATCHED:
            self.link.send(DONE, as_json(self._watched()))
        elif kind == BRANCH:
            own = fork(self.stage.folders, self.stage.fences, json.loads(message))
            if own is not None:
                self.link.close()
                self.link = own
                self._become_stem(DONE, b"")

    def _act(self, act: bytes) -> None:
        """Begin a decision: let the hands do what it says."""
        form, hands = self._form, self.stage.hands
        signal.setitimer(signal.ITIMER_REAL, form["seconds"])
        self._asked = False
        while self._frames_left <= 0:  # below 0 after a decision that came late: the next one is on schedule again
            self._frames_left += form["interval"]
        if form["pointer"]:
            axes = np.frombuffer(act, np.float32, 2) * (0.5, -0.5)
            if form["pointer"] == "position":
                self._place, self._speed = axes + 0.5, np.zeros(2)
            else:
                self._speed = axes * 2 * SPEED
            self._move()
        axes = 2 * bool(form["pointer"])
        if form["stick"]:
            x, y = np.frombuffer(act, np.float32, 2, 4 * axes).tolist()
            self.stage.joysticks.move(x, -y)
            axes += 2
        choices = iter(np.frombuffer(act, np.int32, offset=4 * axes).tolist())
        hands.press_buttons([BUTTONS[name] for name in form["buttons"] if next(choices)])
        keys = [key for key in form["keys"] if next(choices)]
        if self._watch is None:
            hands.press_keys(keys)
        else:
            self._watch.press()
        if form["stick"]:
            self.stage.joysticks.press([button for button in range(STICK_BUTTONS) if next(choices)])
        if form["wheel"] and (ticks := (0, 1, -1)[next(choices)]):
            hands.turn_wheel(ticks)

    def _move(self) -> None:
        """Move the pointer for a frame."""
        if not self._form["pointer"]:
            return
        width, height = self.stage.size()
        wanted = self._place + self._speed * (1.0, width / height)  # the same number of pixels in both directions
        self._place, last = np.clip(wanted, 0.0, 1.0), np.array([width - 1, height - 1])
        goal = self._place * last
        if self.stage.hands.captured:  # then the program is told of the whole way, and a part of a pixel is kept
            beyond, goal = wanted != self._place, wanted * last
            self._place = self._place + beyond * np.modf(goal)[0] / np.maximum(last, 1)
        self.stage.hands.move(float(goal[0]), float(goal[1]))

    def _observe(self) -> bytes:
        """Return the sensors, one after the other."""
        form, pixels = self._form, self.stage.display.pixels()
        pictures: list[Array] = []
        if form["screen"]:
            pictures.append(scale(pixels, *form["screen"]))
        if form["fovea"]:
            pictures.append(crop(pixels, self.stage.hands.position, form["fovea"]))
        parts = [(gray(picture) if form["gray"] else picture).tobytes() for picture in pictures]
        return b"".join([*parts, self.stage.score.state().tobytes()])
