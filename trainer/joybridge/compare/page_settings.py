"""What a comparison compares: in which keys its variants differ, what all share, and what the runs were made with."""

import json
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from joybridge.compare.made_with import MadeWith
from joybridge.compare.page_parts import escaped, table
from joybridge.compare.variants import FREE, Variant
from joybridge.config.config import Config
from joybridge.config.differences import flat

FOUND = "# The best of "  # how a configuration begins that a search has written
# Keys that say what is trained, how long and how it is watched, not how.
NO_SETTINGS = {
    *("game", "options", "layout", "seed", "total_timesteps", "log_interval", "evaluate_during", "best_metric"),
    *("pipeline_groups", "preset", "games"),
}


def own_settings(config: Config) -> dict[str, Any]:
    """Return how a configuration learns: its values that differ from those of its preset, or from the defaults."""
    usual, own = (flat(each.model_dump()) for each in (Config(game=config.game, preset=config.preset), config))
    return {
        key: value
        for key, value in own.items()
        if key.partition(".")[0] not in NO_SETTINGS and (key not in usual or usual[key] != value)
    }


def settings_block(variants: Sequence[Variant], paths: Sequence[Path], note: str = "") -> str:
    """Return the keys in which variants differ, where searches found their values, and what all share, as Markdown.

    paths: of the configurations. note: what else differs. "": nothing but what the names of the variants say.
    """
    settings_of = {variant.label: flat(variant.config.model_dump()) for variant in variants}
    keys = dict.fromkeys(key for values in settings_of.values() for key in values)
    settings = [key for key in keys if key.partition(".")[0] not in FREE]  # the others are not what is compared
    differing = [key for key in settings if len({_text(values, key) for values in settings_of.values()}) > 1]
    found = [f"- {escaped(f'{path}')}: {escaped(text)}" for path in paths if (text := _found(path))]
    differs = [note] if note else []
    if found or differing not in ([], ["layout"]):
        rows = [[f"`{key}`", *(escaped(_text(values, key)) for values in settings_of.values())] for key in differing]
        differs += [table(["key", *map(escaped, settings_of)], rows), *(["\n".join(found)] if found else [])]
    blocks = ["## What differs", *differs] if differs else []
    config = variants[0].config
    shared = {key: value for key, value in own_settings(config).items() if key in settings and key not in differing}
    if shared:
        usual = f"the preset `{config.preset}`" if config.preset else "the defaults"
        texts = (f"`{key}: {json.dumps(value, ensure_ascii=False)}`" for key, value in shared.items())
        blocks += ["## What all share", f"Settings that differ from {usual}: {', '.join(texts)}."]
    return "\n\n".join(blocks)


def _text(values: Mapping[str, Any], key: str) -> str:
    """Return the value of a key as it is written; "": a configuration does not have it."""
    return json.dumps(values[key], ensure_ascii=False).strip('"') if key in values else ""


def _found(path: Path) -> str:
    """Return what a search has written about itself at the beginning of its best configuration; "": none has."""
    with path.open(encoding="utf-8") as file:
        first = next(islice(file, 1), "")
    return first.removeprefix("# ").strip() if first.startswith(FOUND) else ""


def made_with_block(noted: Sequence[MadeWith], played: MadeWith | None) -> str:
    """Return the section of the page as Markdown, "" if nothing is known. played: what a test was made with."""
    lines = [f"- {_with_words(each)}" for each in noted]
    lines += [f"- the test: {_with_words(played)}"] if played else []
    return "\n".join(["## Made with", "", *lines]) if lines else ""


def _with_words(each: MadeWith) -> str:
    words = [f"{name} {found}" for name, found in each.versions.items()]
    words += [f"{name} (files {mark})" for name, mark in each.sources.items()]
    return escaped("; ".join([", ".join(words), *([f"on {each.machine}"] if each.machine else [])]))
