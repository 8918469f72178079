"""What a page of the site takes from elsewhere.

A line of a page may stand for a part that is written only once:

    <!-- generated: keys -->            what a function of GENERATED returns
    <!-- generated: api MODULE … -->    the same, with arguments
"""

import posixpath
import re
from collections.abc import Callable
from pathlib import Path

from tools.docs import api, contract, errors, promises, reference

ROOT = Path(__file__).parents[2]
GENERATED: dict[str, Callable[..., str]] = {
    "api": api.api,
    "commands": reference.commands,
    "configurations": reference.configurations,
    "contract": contract.contract,
    "docstring": api.docstring,
    "exceptions": errors.exceptions,
    "forms": reference.forms,
    "keys": reference.key_table,
    "other_names": reference.other_names,
    "promises": promises.promises,
    "reasons": errors.reasons,
}
INSTEAD = {  # of a file, the page that shows it
    "README.md": "docs/index.md",
    "configs": "docs/reference/configurations.md",
    "proto/joybridge/v1/bridge.proto": "docs/reference/contract.md",
}
PART = re.compile(r"^<!-- generated: (.*?) -->$", re.MULTILINE)
PROGRAM = re.compile(r"\.venv/bin/(?=joybridge|python |tensorboard)")  # readers of the site need no checkout
SHELL = re.compile(r"(?<=^```sh\n).*?(?=^```$)", re.MULTILINE | re.DOTALL)
COMMENTED = re.compile(r"^(.*\S)  +(# .*)$", re.MULTILINE)
LINK = re.compile(r"\]\((?!\w+:|#)([^)\s#]+)")


def filled(page: str, text: str) -> str:
    """Return the text of a page, given by its path in the repository, with its parts and with links of the site.

    Programs are those of an activated environment, but for contributors.
    """

    def part(match: re.Match[str]) -> str:
        name, *arguments = match[1].split()
        return GENERATED[name](*arguments)

    text = PART.sub(part, _moved(text, page))
    return text if page == "CONTRIBUTING.md" else SHELL.sub(_aligned, PROGRAM.sub("", text))


def _aligned(block: re.Match[str]) -> str:
    """Return the commands of a block with their comments in one column, two characters after the longest command."""
    width = max((len(command) for command, _ in COMMENTED.findall(block[0])), default=0)
    return COMMENTED.sub(lambda line: f"{line[1]:<{width}}  {line[2]}", block[0])


def _moved(text: str, page: str) -> str:
    """Return the text of a page with links to the pages that the site shows instead of files."""

    def link(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(page), match[1]))
        return f"]({posixpath.relpath(INSTEAD.get(target, target), posixpath.dirname(page) or '.')}"

    return LINK.sub(link, text)
