"""A sheet of pictures, each with lines of text and scales on its right. Drawn with Pillow."""

from pathlib import Path
from typing import NamedTuple

from PIL import Image, ImageDraw, ImageFont

from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array

COLUMNS = 3  # of pictures
PICTURE, PANEL, LINE, MARGIN = 320, 190, 20, 8  # px: width of a picture, width and height of a line, space around both
BACKGROUND, INK, FAINT, ACCENT = "#ffffff", "#202020", "#b8b8b8", "#d05020"


class Line(NamedTuple):
    """A line of text, with a scale below it unless `share` is None."""

    text: str
    share: float | None = None  # where the marker of the scale is, from 0 (left) to 1 (right)


class Tile(NamedTuple):
    """A picture and what stands beside it."""

    picture: Array  # uint8 [height, width, 3]
    lines: list[Line]


def write_sheet(tiles: list[Tile], output: Path) -> None:
    """Write tiles to a picture file, from left to right and top to bottom. Raises ConfigError if that is impossible."""
    drawn = [_draw(tile) for tile in tiles]
    columns = min(COLUMNS, len(drawn))
    width, height = max(tile.width for tile in drawn), max(tile.height for tile in drawn)
    sheet = Image.new("RGB", (columns * width, -(-len(drawn) // columns) * height), BACKGROUND)
    for index, tile in enumerate(drawn):
        sheet.paste(tile, (index % columns * width, index // columns * height))
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        sheet.save(output)
    except (OSError, ValueError) as error:  # ValueError: an ending that stands for no format
        raise ConfigError(f"cannot write {output}: {error}; choose a path that ends in .png") from error


def _draw(tile: Tile) -> Image.Image:
    picture = Image.fromarray(tile.picture)
    picture = picture.resize((PICTURE, max(1, round(picture.height * PICTURE / picture.width))))
    height = max(picture.height, LINE * len(tile.lines)) + 2 * MARGIN
    drawn = Image.new("RGB", (PICTURE + PANEL + 3 * MARGIN, height), BACKGROUND)
    drawn.paste(picture, (MARGIN, MARGIN))
    draw, font, left = ImageDraw.Draw(drawn), ImageFont.load_default(size=12), PICTURE + 2 * MARGIN
    for row, (text, share) in enumerate(tile.lines):
        top = MARGIN + row * LINE
        draw.text((left, top), text, INK, font)
        if share is not None:
            foot, middle, marker = top + LINE - 3, left + PANEL / 2, left + share * PANEL
            draw.line([(left, foot), (left + PANEL, foot)], FAINT)
            draw.line([(middle, foot - 2), (middle, foot + 2)], FAINT)
            draw.ellipse([marker - 3, foot - 3, marker + 3, foot + 3], ACCENT)
    return drawn
