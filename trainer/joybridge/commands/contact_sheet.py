"""A sheet of pictures, each with text and scales on its right, and what agents see below. Drawn with Pillow."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from PIL import Image, ImageDraw, ImageFont

from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array

COLUMNS = 3  # of pictures
PICTURE, PANEL, LINE, MARGIN = 320, 190, 20, 8  # px: width of a picture, width and height of a line, space around both
IMAGE = 160  # px: the longer side of an image, at most, unless it is larger
BACKGROUND, INK, FAINT, ACCENT = "#ffffff", "#202020", "#b8b8b8", "#d05020"


class Line(NamedTuple):
    """A line of text, with a scale below it unless `share` is None."""

    text: str
    share: float | None = None  # where the marker of the scale is, from 0 (left) to 1 (right)


class Tile(NamedTuple):
    """A picture and what stands beside it."""

    picture: Array  # uint8 [height, width, 3]
    lines: list[Line]
    images: Sequence[Array] = ()  # that agents observe, uint8 [height, width] or [height, width, 1 or 3]


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
    foot = max(picture.height, LINE * len(tile.lines)) + 2 * MARGIN
    images = [_enlarge(image) for image in tile.images]
    width = max(PICTURE + PANEL + 3 * MARGIN, sum(image.width + MARGIN for image in images) + MARGIN)
    height = foot + max((image.height + MARGIN for image in images), default=0)
    drawn = Image.new("RGB", (width, height), BACKGROUND)
    drawn.paste(picture, (MARGIN, MARGIN))
    across = MARGIN
    for image in images:
        drawn.paste(image, (across, foot))
        across += image.width + MARGIN
    draw, font, left = ImageDraw.Draw(drawn), ImageFont.load_default(size=12), PICTURE + 2 * MARGIN
    for row, (text, share) in enumerate(tile.lines):
        top = MARGIN + row * LINE
        draw.text((left, top), text, INK, font)
        if share is not None:
            base, middle, marker = top + LINE - 3, left + PANEL / 2, left + share * PANEL
            draw.line([(left, base), (left + PANEL, base)], FAINT)
            draw.line([(middle, base - 2), (middle, base + 2)], FAINT)
            draw.ellipse([marker - 3, base - 3, marker + 3, base + 3], ACCENT)
    return drawn


def _enlarge(image: Array) -> Image.Image:
    """Return an image whose pixels are squares."""
    height, width = image.shape[:2]
    scale = max(1, IMAGE // max(height, width))
    pixels = Image.fromarray(image.reshape(height, width) if image.size == height * width else image)
    return pixels.resize((width * scale, height * scale), Image.Resampling.NEAREST)
