"""Scripts with the limits of a person play programs through the page of `joybridge play`, for demonstrations.

    python -m tools.person chimp demos/chimp --minutes 10

A script sees the picture in the page and nothing else, as it was 0.2 s before, and expects things to go on as they did.
It misses what it aims at, and needs a moment to get there. Needs Chromium.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from tests.support.chromium import Tab, chromium
from tools.person.limits import Hands
from tools.person.players import Keeper, Puncher, Returner, Shooter

Person = Puncher | Returner | Shooter | Keeper
PERSONS: dict[str, type[Person]] = {"chimp": Puncher, "pong-arcade": Returner, "aliens": Shooter, "xboing": Keeper}
SHOWN = "document.querySelector('#curtain').classList.contains('shown')"
READY = "document.querySelector('#curtain-title').textContent.startsWith('Click or press Enter')"
BOX = "(({ x, y, width, height }) => [x, y, width, height])(document.querySelector('#picture').getBoundingClientRect())"
SEEN = """(() => {
  const { width, height } = document.querySelector("#picture");
  const { data } = document.querySelector("#picture").getContext("2d").getImageData(0, 0, width, height);
  const scale = %s / width;
  %s
})()"""


def play(tab: Tab, url: str, seconds: float, person: Person) -> None:
    """Play for some time through the page."""
    tab.size(1280, 900)
    tab.go(url)
    tab.wait(READY)
    begin = last = time.monotonic()
    held: frozenset[str] = frozenset()
    for number in count():
        if number % 10 == 0 and tab.value(SHOWN):
            tab.key("Enter", "Enter")
            tab.wait(f"!({SHOWN})")
        now = time.monotonic()
        if now - begin > seconds:
            return
        person.see(now, tab.value(SEEN % (person.WIDTH, person.SEEN)) or [])
        hands = person.act(now, now - last)
        press(tab, person, held, hands)
        held, last = hands.pressed, now


def press(tab: Tab, person: Person, held: frozenset[str], hands: Hands) -> None:
    """Move the mouse and press what is not yet held, and release what no longer is."""
    if hands.pointer:
        left, top, width, _ = tab.value(BOX)
        x, y = (offset + part * width / person.WIDTH for offset, part in zip((left, top), hands.pointer, strict=True))
        tab.mouse("mouseMoved", x, y, "left" if "mouse" in held else "none", int("mouse" in held))
    for key in held ^ hands.pressed:
        down = key in hands.pressed
        if key == "mouse":
            tab.mouse("mousePressed" if down else "mouseReleased", x, y, "left", int(down))
        else:
            tab.key(key, " " if key == "Space" else key.removeprefix("Key").lower(), down=down, up=not down)


@contextmanager
def page(program: str, folder: Path) -> Iterator[str]:
    """Start the page that records a program of configs/pygame in a folder; yield its URL."""
    command = [sys.executable, "-m", "joybridge", "play", f"pygame/{program}", "--demos", str(folder)]
    with subprocess.Popen([*command, "--no-browser", "--port", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            url = next((line.split()[-1] for line in process.stdout if "http://" in line), "")
            if not url:
                sys.exit("error: joybridge play ended before its page was up: its error is above")
            yield url
        finally:
            process.terminate()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="A script with the limits of a person plays a program in a page.")
    parser.add_argument("program", choices=PERSONS, help="of configs/pygame: %(choices)s")
    parser.add_argument("demos", type=Path, help="the folder in which its play is recorded")
    parser.add_argument("--minutes", type=float, default=10.0, help="of play; default %(default)g")
    parser.add_argument("--seed", type=int, default=0, help="of its misses and rests; default %(default)s")
    options = parser.parse_args(arguments)
    with (
        tempfile.TemporaryDirectory() as folder,
        page(options.program, options.demos) as url,
        chromium(folder) as browser,
    ):
        play(browser.tab(), url, 60 * options.minutes, PERSONS[options.program](options.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
