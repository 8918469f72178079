"""What a frame of a pygame program costs: CPU time of its process, medians over windows, with their spread.

python -m tools.bench_pygame

CPU time is measured, as other work on the machine then matters less than for time by the clock. Linux only.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from statistics import median

from joybridge.adapters.pygame_programs.form import make_form, make_look, options_of
from joybridge.adapters.pygame_programs.players import Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.settings import read_pygame_settings
from joybridge.contract.spec import choose_options

WINDOWS = 7
FRAMES = 560  # of a window, at most: aliens ends soon
WARM_FRAMES = 16
EMPTY = """import pygame

pygame.init()
screen = pygame.display.set_mode((1280, 720))
clock = pygame.time.Clock()
while True:
    for event in pygame.event.get():
        if event.type == pygame.KEYDOWN and event.key == pygame.K_LEFT:
            raise SystemExit
    held = pygame.key.get_pressed()
    pygame.display.flip()
    clock.tick(60)
"""
HOOK = "def state(program):\n    return [0.0]\n"  # without it a program cannot be served without a picture


def main() -> int:
    """Print the figures."""
    argparse.ArgumentParser(prog="python -m tools.bench_pygame", description=__doc__.splitlines()[0]).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        empty, hook = Path(folder, "empty.py"), Path(folder, "hook.py")
        empty.write_text(EMPTY)
        hook.write_text(HOOK)
        programs = {"empty, 1280 x 720": str(empty), "pygame.examples.aliens": "pygame.examples.aliens"}
        for name, program in programs.items():
            for screen, interval in (("none", "8"), ("64", "1")):
                options = {"screen": screen, "decision_interval": interval, "colors": "gray"}
                picture = "no picture" if screen == "none" else "a gray picture of 64 each frame"
                figures = frame_microseconds(f"{program} hook={hook} keys=LEFT mouse=false", options)
                print(json.dumps({f"{name}, {picture}, µs per frame": figures}, ensure_ascii=False), flush=True)
    return 0


def frame_microseconds(text: str, options: Mapping[str, str]) -> dict[str, float]:
    """Return the CPU time of a frame of a program without input, in µs."""
    settings = read_pygame_settings(text)
    processes = ProgramProcesses(settings)
    try:
        look = make_look(settings, processes.start())
        form = make_form(look, choose_options(options_of(look), options, settings.name))
        players = Players(processes, form, form.inside(settings.number("seconds")), 1)
        windows = []
        for seed in range(WINDOWS):
            players.begin([0], [seed])
            process = next(path for path in Path("/proc").iterdir() if _began_in(path, processes.folder))
            before, frames = 0.0, 0
            for number, _ in enumerate(players.play(0, [bytes(form.act_bytes)] * (FRAMES // form.interval))):
                if number * form.interval < WARM_FRAMES:
                    before = _cpu_seconds(process)
                else:
                    frames += form.interval
            windows.append((_cpu_seconds(process) - before) / frames * 1e6)
        players.end([0])
    finally:
        processes.end()
    return {"median": round(median(windows), 1), "low": round(min(windows), 1), "high": round(max(windows), 1)}


def _began_in(path: Path, folder: Path) -> bool:
    """Return whether a process is the player of a program with this folder: the newest has its own, by its number."""
    try:
        own = (path / "fd" / "100").readlink()
    except OSError:
        return False
    return own.parent == folder and own == max(folder.glob("[1-9]*"), key=lambda each: int(each.name))


def _cpu_seconds(process: Path) -> float:
    return int((process / "schedstat").read_text().split()[0]) / 1e9


if __name__ == "__main__":
    sys.exit(main())
