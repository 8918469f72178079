"""Programs written with pygame, as games in this process."""

from contextlib import closing

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_game
from tests.support.servers import ROOT

CATCHING = ROOT / "tests/support/pygame_programs/catch.py"
CATCH = f"{CATCHING} 'reward=Score: (\\d+)'"
HEAD = "import pygame\npygame.init()\nscreen = pygame.display.set_mode((64, 48))\nclock = pygame.time.Clock()\n"
LOOP = "while True:\n    events = pygame.event.get()\n    pygame.mouse.get_pos()\n"
SHOW = "    pygame.display.flip()\n    clock.tick(60)\n"


def opened(game, arenas=1, seed=0, **options):
    chosen = choose_options(game.options, options, game.name)
    return closing(game(chosen, {}, arenas, 0, seed))


def program(tmp_path, source, settings=""):
    """Return the game of a program with this source."""
    path = tmp_path / "program.py"
    path.write_text(source)
    return load_game(f"pygame:{path} {settings}")


def still(game):
    """Return an act in which nothing is pressed and the pointer stays in the middle."""
    device = game.describe(choose_options(game.options, {}, game.name)).behaviors[0].device
    return [ActArrays(np.zeros((1, len(device.axes)), np.float32), np.zeros((1, len(device.branches)), np.int32))]


def steps(game, count, **options):
    with opened(game, **options) as playing:
        return [playing.step(still(game))[0] for _ in range(count)]
