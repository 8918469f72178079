"""What a comparison compares: the keys in which its variants differ, and the searches that have found them."""

import json
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from joybridge.compare.page_parts import escaped, table
from joybridge.compare.variants import FREE, Variant
from joybridge.config.differences import flat

FOUND = "# The best of "  # how a configuration begins that a search has written


def settings_block(variants: Sequence[Variant], paths: Sequence[Path]) -> str:
    """Return the keys in which variants differ and where searches found their values, as Markdown.

    paths: of the configurations. "": they differ in nothing that their names do not say.
    """
    settings_of = {variant.label: flat(variant.config.model_dump()) for variant in variants}
    keys = dict.fromkeys(key for values in settings_of.values() for key in values)
    settings = [key for key in keys if key.partition(".")[0] not in FREE]  # the others are not what is compared
    differing = [key for key in settings if len({_text(values, key) for values in settings_of.values()}) > 1]
    found = [f"- {escaped(f'{path}')}: {escaped(text)}" for path in paths if (text := _found(path))]
    if not found and differing in ([], ["layout"]):
        return ""
    rows = [[f"`{key}`", *(escaped(_text(values, key)) for values in settings_of.values())] for key in differing]
    blocks = ["## What differs", table(["key", *map(escaped, settings_of)], rows)]
    return "\n\n".join([*blocks, "\n".join(found)] if found else blocks)


def _text(values: Mapping[str, Any], key: str) -> str:
    """Return the value of a key as it is written; "": a configuration does not have it."""
    return json.dumps(values[key], ensure_ascii=False).strip('"') if key in values else ""


def _found(path: Path) -> str:
    """Return what a search has written about itself at the beginning of its best configuration; "": none has."""
    with path.open(encoding="utf-8") as file:
        first = next(islice(file, 1), "")
    return first.removeprefix("# ").strip() if first.startswith(FOUND) else ""
