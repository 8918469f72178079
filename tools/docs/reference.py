"""The reference of commands, of configuration keys and of the installed configurations, as Markdown."""

import io
import os
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from unittest import mock

from joybridge.cli import commands as all_commands
from joybridge.cli import main
from joybridge.config.keys import all_keys
from joybridge.config.wrong_keys import FORMS, OTHER_NAMES

CONFIGS = Path(__file__).parents[2] / "configs"
WIDTH = "96"  # columns of the help of a command


def key_table() -> str:
    """Return a table of every key of a configuration."""
    rows = ((f"`{key.name}`", f"`{key.default}`", key.kind, key.meaning) for key in all_keys())
    return _table(("key", "default", "type and range", "meaning"), rows)


def forms() -> str:
    """Return a table of the keys that hold values by name, as they are written on a command line."""
    return _table(("key", "on a command line"), ((f"`{key}`", f"`{form}`") for key, form in FORMS.items()))


def other_names() -> str:
    """Return a table of the names of other libraries for keys."""
    names: dict[str, list[str]] = {}
    for name, key in OTHER_NAMES.items():
        names.setdefault(key, []).append(f"`{name}`")
    return _table(("elsewhere", "key"), ((", ".join(found), f"`{key}`") for key, found in names.items()))


def configurations() -> str:
    """Return every installed configuration, as it is written."""
    paths = sorted(CONFIGS.rglob("*.yaml"))
    texts = {path.relative_to(CONFIGS).with_suffix(""): path.read_text(encoding="utf-8") for path in paths}
    return "\n".join(f"## {name}\n\n```yaml\n{text}```\n" for name, text in texts.items())


def commands() -> str:
    """Return the help of every command."""
    return "\n".join(line for name in all_commands() for line in _command(name))


def _command(name: str) -> Iterator[str]:
    command, text = all_commands()[name], io.StringIO()
    with mock.patch.dict(os.environ, COLUMNS=WIDTH), redirect_stdout(text), suppress(SystemExit):
        main([name, "--help"])
    needs = f" It needs `pip install 'joybridge[{command.extra}]'`." if command.extra else ""
    yield f"## {name}\n\n{command.help.capitalize()}.{needs}\n\n```text\n{text.getvalue()}```\n"


def _table(heads: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, ("---",) * len(heads), *rows))
