"""What pages have in common: HTML from Markdown with its pictures in it, tables, numbers, pictures for two themes."""

import base64
import csv
import html
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from markdown_it import MarkdownIt

from joybridge.compare.estimators import Estimate
from joybridge.compare.pictures import picture
from joybridge.config.files import write_atomically

PICTURES = "pictures"  # folder beside the page
TEMPLATE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; --ink: #1f2328; --paper: #ffffff; --line: #d1d9e0; --code: #f6f8fa; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e6edf3; --paper: #0d1117; --line: #3d444d; --code: #151b23; }}
}}
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
  color: var(--ink); background: var(--paper); }}
img {{ max-width: 100%; }}
table {{ display: block; overflow-x: auto; border-collapse: collapse; margin: 1rem 0; font-size: 0.9em; }}
th, td {{ border: 1px solid var(--line); padding: 0.3rem 0.6rem; text-align: left; }}
code, pre {{ background: var(--code); padding: 0.1rem 0.3rem; }}
pre {{ overflow-x: auto; padding: 0.6rem; }}
</style>
{body}
</html>
"""


def page_html(text: str, folder: Path) -> str:
    """Return the page as one HTML file with the pictures of the folder in it. text: Markdown."""
    body = MarkdownIt("commonmark").enable("table").render(text)
    for path in sorted((folder / PICTURES).glob("*.png")):
        data = base64.b64encode(path.read_bytes()).decode()
        body = body.replace(f'"{PICTURES}/{path.name}"', f'"data:image/png;base64,{data}"')
    return TEMPLATE.format(title=text.partition("\n")[0].removeprefix("# "), body=body)


def write_files(files: Mapping[str, str], folder: Path, mark: str = "") -> list[Path]:
    """Write the texts of files into a folder, by name, each with a mark at the end of its name. Raises StorageError.

    Return their paths.
    """
    paths = [folder / name.replace(".", f"{mark}.") for name in files]
    for path, content in zip(paths, files.values(), strict=True):
        write_atomically(path, content.encode())
    return paths


def picture_block(name: str, caption: str) -> str:
    """Return a picture that follows the theme of the reader."""
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{PICTURES}/{picture(name, "dark")}">'
        f'<img src="{PICTURES}/{picture(name, "light")}" alt="{caption}"></picture>\n\n{caption}.'
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (heads, ["---"] * len(heads), *rows))


def escaped(text: str) -> str:
    """Return a text that means nothing to Markdown and HTML."""
    escaped = html.escape(text, quote=False)
    return "".join(f"\\{character}" if character in "\\`*_[]|~" else character for character in escaped)


def csv_text(lines: Iterable[Sequence[object]]) -> str:
    """Return lines of cells as CSV; the first has the names of the columns."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def number_text(value: float) -> str:
    """Return a number with four digits."""
    return f"{value:.4g}" if abs(value) < 10_000 else f"{value:,.0f}"


def interval_text(estimate: Estimate, known: bool) -> str:
    """Return an estimate with its interval, if that is known."""
    value, low, high = map(number_text, estimate)
    return f"{value} [{low}, {high}]" if known else value
