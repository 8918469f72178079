"""The reference of the contract: bridge.proto as Markdown, its comments as text."""

import re
from collections.abc import Iterator
from pathlib import Path

PROTO = Path(__file__).parents[2] / "proto/joybridge/v1/bridge.proto"
SECTION = re.compile(r"^([A-Z][A-Z ]+[A-Z])\b(.*)$")
TERM = re.compile(r"^(\S.*) {2,}(\S.*)$")  # two columns


def contract() -> str:
    """Return the sections of the manual, then every service, message and enum with its comment."""
    manual, _, definitions = PROTO.read_text(encoding="utf-8").partition('syntax = "proto3";')
    return "\n".join([*_manual(manual), "", *_definitions(definitions)])


def _manual(text: str) -> Iterator[str]:
    """Yield the manual as Markdown: its sections as headings, its columns as lists, its examples as code."""
    listed = False
    for line in (re.sub("^// ?", "", line) for line in text.splitlines()):
        if heading := SECTION.match(line):
            name, rest = heading[1].capitalize(), heading[2]
            note = rest.startswith(" (")
            yield f"\n## {name}{rest if note else ''}\n"
            yield f"{name}{rest}" if rest and not note else ""
            listed = False
            continue
        body = line.removeprefix("  ")
        term = None if "- " in body[:4] else TERM.match(body.strip())
        if term or body.startswith("- "):
            yield f"- `{_single(term[1]).strip()}`: {term[2]}" if term else _single(body)
            listed = True
        elif listed and body.startswith("  "):
            yield f"  {body.strip()}"
        else:
            if listed:
                yield ""
            yield f"\n`{body.strip()}`\n" if body.startswith("  ") else body
            listed = False


def _single(text: str) -> str:
    return re.sub(" +", " ", text)


def _definitions(text: str) -> Iterator[str]:
    """Yield a heading, the comment and the code of every definition at the top level."""
    yield "## Definitions"
    for match in re.finditer(
        r"^((?:// .*\n)*)((?:service|message|enum) (\w+) \{(?:\n(?:.*\n)*?)?\})$", text, re.MULTILINE
    ):
        comment, code, name = match.groups()
        comment = re.sub("^// ?(-{20,}.*)?", "", comment, flags=re.MULTILINE)
        yield from (f"\n### {name}\n", comment, "```proto", code, "```")
