"""How smoothly `joybridge play` shows a game, in a Chromium without a window.

python -m tools.bench_viewer [GAME ...] [--seconds SECONDS]

A scripted pointer plays each game through the page. Printed are the pace, and the time from an event of the pointer to
the picture that shows its effect: at the pace of the game, where it includes the wait for the next decision; and, if a
decision has one picture, of decisions that are played at once, with the key for a single one, where it does not.
"""

import argparse
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Sequence

import numpy as np

from joybridge.client.client import describe
from joybridge.contract.tensors import Array
from joybridge.viewer.arena import Settings
from joybridge.viewer.page_session import PageGame, welcome
from joybridge.viewer.simulator import Simulator
from joybridge.viewer.web import open_website
from tests.support.chromium import Tab, chromium

GAMES = ("shooting_birds", "beastly_rivals")
MOVE_SECONDS = 0.016  # between two events of the pointer: those of a frame of the browser are one
PART_SECONDS = 2.0  # that are left out if an episode ends in them
TIMEOUT = 10.0  # s for an answer of the simulator
SINGLE = 100  # decisions that are played at once
TURN = "Number(document.querySelector('#decision').textContent.split(' ')[1] ?? -1)"
SHOWN = "document.querySelector('#curtain').classList.contains('shown')"
TITLE = "document.querySelector('#curtain-title').textContent"
# Notes when a picture is on the canvas, when the pointer has moved before it, and when the key has been pressed.
NOTES = """
window.shown = []; window.single = [];
let pressed = null;
const draw = CanvasRenderingContext2D.prototype.drawImage;
CanvasRenderingContext2D.prototype.drawImage = function (...all) {
  draw.apply(this, all);
  shown.push(performance.now());
  if (pressed !== null) single.push(performance.now() - pressed);
  pressed = null;
};
addEventListener("keydown", (event) => { if (event.code === "Period") pressed = event.timeStamp; }, true);
"""


def bench(tab: Tab, url: str, ticks: int, seconds: float) -> None:
    """Play a game through its page and print the figures. ticks: per decision."""
    tab.call("Page.addScriptToEvaluateOnNewDocument", source=NOTES)
    tab.size(1280, 900)
    tab.go(url)
    tab.wait(f"{TITLE}.startsWith('Click or press Enter')")
    places = itertools.cycle([(x, 300 - x // 8) for x in [*range(400, 560, 4), *range(560, 400, -4)]])
    state = f"[{TURN}, performance.now(), shown.length]"
    parts: list[Array] = []  # of episodes: turns, milliseconds, pictures
    while sum(part[1] for part in parts) < 1000 * seconds:
        if tab.value(SHOWN):
            tab.key("Enter", "Enter")
            tab.wait(f"!({SHOWN})")
        begin, end = tab.value(state), time.monotonic() + PART_SECONDS
        while time.monotonic() < end:
            tab.mouse("mouseMoved", *next(places))
            time.sleep(MOVE_SECONDS)
        if not tab.value(SHOWN):  # else an episode has ended
            parts.append(np.subtract(tab.value(state), begin))
    time.sleep(0.6)  # the page refreshes its figures twice a second
    latency = [tab.text(f"#{name}") for name in ("latency", "latency95")]
    total = np.sum(parts, axis=0)
    turns, pictures = 1000 * total[[0, 2]] / total[1]
    print(f"  {turns * ticks:.1f} ticks/s, {turns:.1f} decisions/s, {pictures:.1f} pictures/s")
    print(f"  from an event to its picture {latency[0]} ms (median), 95 % below {latency[1]} ms")
    if ticks == 1:  # else the next picture may still be of the decision before
        _play_singly(tab)
    assert tab.errors == [], tab.errors


def _play_singly(tab: Tab) -> None:
    """Play decisions with the key for a single one, and print how long their pictures take."""
    if not tab.value(SHOWN):
        tab.key("KeyP", "p")
        tab.wait(SHOWN)
    for number in range(1, SINGLE + 1):
        tab.key("Period", ".")
        tab.wait(f"single.length === {number}")
    single = np.percentile(tab.value("single"), [50, 95])
    print(
        f"  decisions that are played at once: {single[0]:.0f} ms (median), 95 % below {single[1]:.0f} ms", flush=True
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how smoothly `joybridge play` shows a game.")
    parser.add_argument("games", nargs="*", default=GAMES, metavar="GAME", help=f"default {' '.join(GAMES)}")
    parser.add_argument("--seconds", type=float, default=20.0, help="of play per game; default %(default)g")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, chromium(folder) as browser, Simulator(None, ()) as simulator:
        for game in options.games:
            spec = describe(simulator.reach(), game, {})

            with open_website(0, welcome(simulator, PageGame(game, TIMEOUT), Settings(1, {}, {}))) as url:
                print(f"{game}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
                tab = browser.tab()
                bench(tab, url, spec.decision_interval, options.seconds)
                tab.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
