"""Draw 48 generated levels of Shooting Birds and 48 of Beastly Rivals: docs/levels-GAME.webp.

python -m tools.contact_sheet

The levels are the first ones of the training set. What moves is where a few seconds without an action have left it.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_games

ROWS, COLUMNS = 8, 6
WIDTH = 240  # of one level, pixels
DECISIONS = {"shooting_birds": 150, "beastly_rivals": 5}
FOLDER = Path(__file__).parents[1] / "docs"


def draw_levels(name: str) -> Image.Image:
    """Return a sheet of the first levels of a game."""
    game_class: Any = load_games()[name]
    levels = ROWS * COLUMNS
    options = choose_options(game_class.options, {"levels": "generated", "locomotion": "axes"}, name)
    game = game_class(options, {}, levels, 0, 0)
    game.show_levels(np.arange(levels))
    still = ActArrays(np.zeros((levels, 2), np.float32), np.zeros((levels, 2), np.int32))
    for _ in range(DECISIONS[name]):
        game.step([still])
    pictures = [Image.fromarray(game.draw(level)) for level in range(levels)]
    height = round(WIDTH * pictures[0].height / pictures[0].width)
    sheet = Image.new("RGB", (COLUMNS * WIDTH, ROWS * height))
    for level, picture in enumerate(pictures):
        row, column = divmod(level, COLUMNS)
        sheet.paste(picture.resize((WIDTH, height), Image.Resampling.LANCZOS), (column * WIDTH, row * height))
    return sheet


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m tools.contact_sheet", description=__doc__.splitlines()[0]).parse_args()
    for name in DECISIONS:
        draw_levels(name).save(FOLDER / f"levels-{name}.webp", quality=80, method=6)
