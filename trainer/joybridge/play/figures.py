"""Figures for papers: PDF and SVG, whose text is text, on white. The same figure gives the same bytes."""

import argparse
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from joybridge.config.files import write_atomically

if TYPE_CHECKING:  # the commands know their options without matplotlib
    from matplotlib.figure import Figure

FORMATS = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}  # and what would differ each time


def add_figures(command: argparse._ActionsContainer) -> None:
    """Add the option that asks for figures beside the pictures of a page."""
    command.add_argument(
        "--figures",
        choices=FORMATS,
        default="",
        help="write the pictures also as vector graphics for a paper, beside those of the page; needs matplotlib",
    )


def save_vector(figure: "Figure", path: Path) -> Path:
    """Write a figure in the format that its name ends with, one of FORMATS; return the path. Raises StorageError."""
    import matplotlib as mpl

    # Text stays text: TrueType fonts are embedded in a PDF, and an SVG names them.
    style: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "joybridge"}
    drawn, form = io.BytesIO(), path.suffix.removeprefix(".")
    with mpl.rc_context(style):
        figure.savefig(drawn, format=form, metadata=FORMATS[form])
    write_atomically(path, drawn.getvalue())
    return path
