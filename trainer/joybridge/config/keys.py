"""`joybridge keys`: every key of a configuration as it is written with its default, its meaning, type and range."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

from pydantic import BaseModel

from joybridge.config.config import Config
from joybridge.config.presets import PRESETS
from joybridge.config.wrong_keys import FORMS, OTHER_NAMES
from joybridge.contract.argument_types import command_parser

SUBJECTS = {  # words that people look for: the beginning of the names of the keys that are about them
    "self-play": "opponents", "league": "opponents", "recurrent": "policy.memory", "rnn": "policy.memory",
    "lstm": "policy.memory", "gru": "policy.memory",
    "held-out": "evaluate_during", "test": "evaluate_during", "generalization": "evaluate_during",
    "procedural": "parameters", "level": "parameters", "pixels": "policy.image_encoder", "cnn": "policy.image_encoder",
    "wandb": "log_to", "mlflow": "log_to", "imitation": "demonstrations", "gpu": "accelerator",
}  # fmt: skip

INDENT, WIDTH = 38, 120  # columns
TYPES = {"string": "text", "boolean": "true or false"}  # others are called as JSON schema calls them
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}

SCHEMA = Path(__file__).with_name("config.schema.json")  # written by tools/docs/schema.py


class Key(NamedTuple):
    """A key of a configuration."""

    name: str
    default: str  # as it is written; "NAME": there is none
    meaning: str
    kind: str  # its type and range, as in "integer ≥ 1 or null"


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status: 1 if no key is found."""
    parser, keys = command_parser(prog, "keys", "List the keys of configurations: default, meaning, type and range.")
    keys.add_argument(
        "word",
        nargs="?",
        default="",
        metavar="WORD",
        help="only keys with this word in their name or meaning; a key of another library finds ours",
    )
    keys.add_argument(
        "--schema",
        action="store_true",
        help="print the first line of a YAML file with which editors complete and check its keys",
    )
    given = parser.parse_args(arguments)
    if given.schema:
        print(f"# yaml-language-server: $schema={SCHEMA.as_uri()}")
        return 0
    word = given.word
    lines = list(listing(word))
    if not lines:
        print(
            f"error: {word!r} is in the name and meaning of no key; `joybridge keys` lists all keys, and the page "
            '"What you may be looking for" (docs/find.md) has more words, also for what is not here',
            file=sys.stderr,
        )
        return 1
    print(*lines, sep="\n")
    return 0


def listing(word: str = "") -> Iterator[str]:
    """Yield the lines about the keys with a word in their name or meaning, and about those that it means."""
    meant, subject = OTHER_NAMES.get(word.strip()), SUBJECTS.get(word.strip().lower(), " ")
    for key in all_keys():
        if key.name == meant or key.name.startswith(subject) or word.lower() in f"{key.name} {key.meaning}".lower():
            written = FORMS.get(key.name.rpartition(".")[2]) or f"{key.name}={key.default}"
            first, *more = wrap(f"{key.meaning} ({key.kind})", WIDTH - INDENT)
            yield f"{written:<{INDENT - 2}}  {first}"
            yield from (" " * INDENT + line for line in more)
            if key.name == "preset":
                yield from preset_lines()


def preset_lines() -> Iterator[str]:
    """Yield what each preset sets."""
    for name, settings in PRESETS.items():
        pairs = [f"{key}={json.dumps(value)}" for key, value in settings.items() if key != "policy"]
        pairs += [f"policy.{key}={json.dumps(value)}" for key, value in settings["policy"].items()]
        text = f"preset={name}: {'  '.join(pair.replace(' ', '').replace(chr(34), '') for pair in pairs)}"
        indent = " " * INDENT
        yield from wrap(text, WIDTH, initial_indent=indent, subsequent_indent=f"{indent}  ", break_on_hyphens=False)


def all_keys() -> Iterator[Key]:
    """Yield every key: those of the run, then those of its policies."""
    run = _schemas(Config, "")
    policies = run.pop("policies")
    for name, schema in (run | {"policies": policies}).items():
        yield Key(name, _default(schema), schema["description"], _kind(schema))


def _schemas(model: type[BaseModel], prefix: str) -> dict[str, Mapping[str, Any]]:
    """Return the JSON schema of each key of a model; keys of the models in it are written with dots."""
    schemas: dict[str, Mapping[str, Any]] = {}
    for key, schema in model.model_json_schema()["properties"].items():
        inner = model.model_fields[key].annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            schemas |= _schemas(inner, f"{prefix}{key}.")
        else:
            schemas[f"{prefix}{key}"] = schema
    return schemas


def _default(schema: Mapping[str, Any]) -> str:
    default = schema.get("default", "NAME")
    return default if isinstance(default, str) else json.dumps(default)


def _kind(schema: Mapping[str, Any]) -> str:
    """Return the type of a value and its range, as in "integer ≥ 1 or null"."""
    if "$comment" in schema:
        return str(schema["$comment"])
    if "$ref" in schema:
        return "lessons" if schema["$ref"].endswith("/Lesson") else "keys"
    if "anyOf" in schema:
        return " or ".join(map(_kind, schema["anyOf"]))
    if "enum" in schema:
        return " or ".join(schema["enum"])
    match schema["type"]:
        case "array":
            return f"list of {_kind(schema['items'])}"
        case "object":
            inner = schema["additionalProperties"]
            return "values" if inner is True else f"{_kind(inner)} by name"
        case kind:
            bounds = [f"{sign} {schema[bound]}" for bound, sign in BOUNDS.items() if bound in schema]
            return f"{TYPES.get(kind, kind)} {', '.join(bounds)}".rstrip()
