"""The documents name files, commands and keys that exist."""

import importlib.util
import itertools
import json
import re
import runpy
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from joybridge.cli import commands as all_commands
from joybridge.cli import main
from joybridge.config.config import Config
from joybridge.config.keys import SCHEMA, all_keys
from joybridge.config.policy_config import PolicyConfig
from joybridge.v1 import bridge_pb2 as pb
from tests.test_public_api import PROMISED
from tools.docs import errors, promises, reference, search
from tools.docs.api import api, exported
from tools.docs.contract import contract
from tools.docs.pages import INSTEAD, filled
from tools.docs.schema import schema
from tools.docs.search import FIND, ROW

ROOT = Path(__file__).parents[1]
COMMANDS = all_commands()
ELSEWHERE = {"node_modules", "build", "runs", "site"}  # written by programs
PATHS = [
    path
    for path in sorted(ROOT.rglob("*.md"))
    if not any(part in ELSEWHERE or part.startswith(".") for part in path.relative_to(ROOT).parts)
]
DOCUMENTS = [pytest.param(path, id=str(path.relative_to(ROOT))) for path in PATHS]
OF_THE_PAST = {"CHANGELOG.md"}  # it may name keys and modules that were replaced
NO_MODULES = {"joybridge.games", "joybridge.layouts"}  # names of entry points as well
CODE = re.compile(r"```\w*\n(.*?)```|`([^`\n]+)`", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def commands(path):
    """Return the commands of joybridge in a document: the words of each, with continued lines joined."""
    code = "\n".join(block + span for block, span in CODE.findall(path.read_text())).replace("\\\n", " ")
    return [
        line.split("#")[0].split() for line in re.findall(r"(?<![\w./])(?:\.venv/bin/)?joybridge ([a-z][^`\n]*)", code)
    ]


def braces(path):
    """Return the paths that a{b,c}d stands for."""
    parts = re.split(r"\{([^}]*)\}", path)
    choices = [part.split(",") if index % 2 else [part] for index, part in enumerate(parts)]
    return ["".join(pieces) for pieces in itertools.product(*choices)]


def test_there_are_documents():
    assert {"README.md", "CONTRIBUTING.md", "decisions.md", "glossary.md"} <= {path.name for path in PATHS}


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_relative_link_leads_to_a_file(path):
    links = [link.split("#")[0] for link in LINK.findall(path.read_text()) if "://" not in link]
    found = [(path.parent / link).resolve() for link in links if link]
    shown = {ROOT / name for name in INSTEAD}  # the site has a page for them
    assert [str(target) for target in found if not target.is_file() and target not in shown] == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_command_exists(path):
    names = {words[0] for words in commands(path)}
    assert names - set(COMMANDS) - {"simulator"} == set()  # "joybridge simulator listening on" is an output


def test_pages_are_in_docs_but_for_readmes_and_what_is_generated():
    elsewhere = {str(path.relative_to(ROOT)) for path in PATHS if ROOT / "docs" not in path.parents}
    assert {page for page in elsewhere if not page.endswith("/README.md")} == {
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "results/environments.md",
        "results/pygame-programs.md",
    }


def test_every_command_is_on_a_page_for_users():
    assert {words[0] for path in (ROOT / "docs").glob("*.md") for words in commands(path)} >= set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_in_a_document_exists(command, capsys):
    named = {
        option
        for path in PATHS
        for words in commands(path)
        if words[0] == command
        for option in re.findall(r"--[a-z-]+", " ".join(words).split("|")[0])
    }
    for part in ([], ["record"], ["replay"]) if command == "tape" else ([],):
        with pytest.raises(SystemExit):
            main([command, *part, "--help"])
    assert named - set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) == set()


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_module_that_is_run_exists(path):
    modules = re.findall(r"python -m ((?:tools|joybridge)[\w.]*\w)", path.read_text())
    assert [name for name in modules if name != "tools.NAME" and importlib.util.find_spec(name) is None] == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_configuration_that_is_trained_exists(path):
    named = [word for words in commands(path) if words[0] == "train" for word in words[1:2] if "/" in word]
    named = [name for name in named if not name.startswith("runs/")]  # a run has a configuration of its own
    assert [name for name in named if not (ROOT / "configs" / f"{name}.yaml").exists()] == []


def test_every_target_of_make_that_is_named_exists():
    makefile = (ROOT / "Makefile").read_text()
    named = {name for path in PATHS for name in re.findall(r"(?:^|`)make ([a-z]+)", path.read_text(), re.MULTILINE)}
    assert {name for name in named if not re.search(rf"^{name}:", makefile, re.MULTILINE)} == set()


def folder_map():
    """Return the paths in the map of the contributing guide."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    lines = re.findall(r"^([\w{},./]+/[\w{},./]*)  +\S", text, re.MULTILINE)
    return [ROOT / path for line in lines for path in braces(line)]


def test_the_folder_map_of_the_contributing_guide_names_what_exists():
    assert len(folder_map()) > 20
    assert [path for path in folder_map() if not path.exists()] == []


def test_the_folder_map_of_the_contributing_guide_leaves_no_module_out():
    named = set(folder_map())
    modules = [path for side in ("proto", "simulator", "trainer") for path in (ROOT / side / "joybridge").rglob("*.py")]
    assert len(modules) > 50
    missing = [path for path in modules if path.name != "__init__.py" and not named & {path, *path.parents}]
    assert missing == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_key_that_is_set_on_a_command_line_exists(path):
    words = [word for words in commands(path) if words[0] == "train" for word in words[1:]]
    keys = [word.partition("=")[0] for word in words if re.match(r"[a-z_]+[\w.]*=", word)]
    assert {key for key in keys if not key_exists(key)} == set()


@pytest.mark.parametrize(
    "path",
    [path for path in PATHS if path.name not in {*OF_THE_PAST, "exported-policies.md"}],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_every_key_of_a_policy_that_is_named_exists(path):
    assert {
        key for key in re.findall(r"`(policy\.(?!json|onnx|py\b|mjs|hpp)\w+)", path.read_text()) if not key_exists(key)
    } == set()


def key_exists(key):
    """Return whether a configuration has this key, written with dots."""
    first, _, rest = key.partition(".")
    model = PolicyConfig if first == "policy" else Config
    return (rest.partition(".")[0] or first if first == "policy" else first) in {*model.model_fields, "policy"}


@pytest.mark.parametrize(
    "path", [path for path in PATHS if path.name not in OF_THE_PAST], ids=lambda path: str(path.relative_to(ROOT))
)
def test_every_module_and_name_of_joybridge_that_is_named_exists(path):
    text = path.read_text()
    imports = re.findall(r"^ *from (joybridge[\w.]*) import ([\w, ]+)", text, re.MULTILINE)
    named = {f"{module}.{name.strip()}" for module, names in imports for name in names.split(",")}
    named |= set(re.findall(r"`(joybridge(?!\.v1\.)(?:\.\w+)+)`", text)) - NO_MODULES
    assert {name for name in named if not is_importable(name)} == set()


def is_importable(path):
    """Return whether a dotted name is a module, or a name that a module has."""
    module, _, name = path.rpartition(".")
    if path in PROMISED or (module in PROMISED and name in exported(module)):
        return True  # without an import: that of Stable-Baselines3 takes seconds
    try:
        return hasattr(import_module(module), name) or importlib.util.find_spec(path) is not None
    except ModuleNotFoundError:
        return False


# ------------------------------------------------------------------------------------------------------- the site


def test_the_navigation_of_the_site_leaves_no_page_out():
    text = (ROOT / "docs/index.md").read_text()
    blocks = re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL)
    listed = re.findall(r"^(?:.* <)?/([\w./-]+\.md)>?$", "\n".join(blocks), re.MULTILINE)
    pages = {str(path.relative_to(ROOT)) for path in PATHS} - {"README.md", "docs/pypi.md", "docs/index.md"}
    assert len(listed) == len(set(listed)) and set(listed) == pages, "list every page in docs/index.md"


def test_sphinx_reads_every_page_of_the_navigation():
    patterns = runpy.run_path(str(ROOT / "docs/conf.py"))["include_patterns"]
    read = re.compile("|".join(re.escape(pattern).replace(r"\*", "[^/]*") for pattern in patterns))
    assert [page for page in map(str, (path.relative_to(ROOT) for path in PATHS)) if not read.fullmatch(page)] == []


def test_the_comments_of_a_block_are_in_one_column_after_the_programs_have_lost_their_folder():
    block = "```sh\n.venv/bin/joybridge serve         # one\n.venv/bin/joybridge list --json   # two\nmake\n```\n"
    shown = "```sh\njoybridge serve        # one\njoybridge list --json  # two\nmake\n```\n"
    assert filled("docs/page.md", block + "No   # comment\n") == shown + "No   # comment\n"


@pytest.mark.parametrize("path", sorted((ROOT / "docs").rglob("*.md")), ids=lambda path: path.stem)
def test_every_part_of_a_page_is_filled_and_every_link_in_it_leads_to_a_file(path):
    page = str(path.relative_to(ROOT))
    text = filled(page, path.read_text())
    assert not re.search("<!-- generated", text)
    assert [link for link in LINK.findall(text) if not re.match(r"\w+:|#", link) and not leads(path, link)] == []


def leads(page, link):
    return (page.parent / link.split("#")[0]).exists()


def test_the_reference_has_every_key_every_command_and_every_message():
    assert all(f"| `{key.name}` |" in reference.key_table() for key in all_keys())
    assert all(f"usage: joybridge {name} " in reference.commands() for name in COMMANDS)
    messages = {f"\n### {name}\n" for name in pb.DESCRIPTOR.message_types_by_name}
    assert messages and all(message in contract() for message in messages)


def test_the_reference_has_every_public_name_with_its_declaration():
    pages = "\n".join(path.read_text() for path in (ROOT / "docs/reference").glob("*.md"))
    shown = [name for line in re.findall("<!-- generated: api (.*) -->", pages) for name in line.split()]
    assert sorted(shown) == sorted(PROMISED)
    for module in shown:
        sections = re.split(r"^### ", api(module), flags=re.MULTILINE)[1:]
        assert [section.split()[0] for section in sections] == exported(module) == import_module(module).__all__
        assert all("```python" in section or "contract.md#" in section for section in sections)


@pytest.mark.promise("O1")
def test_the_reference_of_errors_has_every_reason_and_every_exception():
    names = {name.removeprefix("REASON_") for name in pb.Reason.keys()} - {"UNSPECIFIED"}  # noqa: SIM118
    assert set(errors.REASONS) == names and all(f"\n| `{name}` | `" in errors.reasons() for name in names)
    found = errors.found_exceptions()
    assert len(found) > 20 and set(errors.EXCEPTIONS) == set(found), "say in tools/docs/errors.py what to do"
    assert sorted(re.findall(r"- \*\*(\w+)\*\*", errors.exceptions())) == sorted(found)
    assert all(docstring for _, _, docstring in found.values())


CODES = [  # of version 0.1.0, but for DOOR, which is SERVER_CREDENTIALS now
    "ACTION", "ADAPTER", "ARENA", "CATALOG", "CHECKPOINT", "COMMUNICATOR", "CONFIG", "CREDENTIALS", "DEVICE",
    "DIVERGED", "EXPORT", "FAULT_FOUND", "GAME", "MESSAGE", "NEW_GAME", "NO_SUCH_GAME", "RECORDING",
    "RUN_LOCKED", "SELECTION", "SERVER", "SERVER_CREDENTIALS", "SETTING", "SIMULATOR", "SIMULATOR_LOST",
    "SIMULATOR_SHUT_DOWN", "SPEC", "STORAGE", "TENSOR", "UNTRUSTED_RUN",
]  # fmt: skip


@pytest.mark.promise("O1")
def test_codes_of_errors_stay_the_same():
    assert set(CODES) <= {errors.code_of(name) for name in errors.found_exceptions()}


@pytest.mark.promise("T2")
def test_every_promise_is_held_by_a_test_and_every_marker_by_a_promise():
    held, table = promises.tests_by_promise(), promises.promises()
    assert set(held) == set(promises.PROMISES) and len(held) >= 40
    assert all(f"| {number} | {text} | `test_" in table for number, text in promises.PROMISES.items())


def test_the_schema_for_editors_is_that_of_the_configuration():
    assert SCHEMA.read_text(encoding="utf-8") == schema(), "run `python -m tools.docs.schema`"


def test_the_schema_for_editors_accepts_every_configuration_and_refuses_a_wrong_key():
    validator = Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    files = sorted((ROOT / "configs").rglob("*.yaml"))
    assert len(files) > 20
    assert [path.name for path in files if not validator.is_valid(YAML(typ="safe").load(path))] == []
    assert not validator.is_valid({"game": "archer", "polices": {}})
    assert not validator.is_valid({"game": "archer", "policies": {"buttons": {"epoch": 3}}})


def test_the_line_for_editors_names_the_schema(capsys):
    assert main(["keys", "--schema"]) == 0
    uri = capsys.readouterr().out.strip().removeprefix("# yaml-language-server: $schema=")
    assert Path(unquote(urlparse(uri).path)) == SCHEMA and SCHEMA.exists()


def test_each_question_of_the_search_has_a_page_that_answers():
    pages = {page for answers in search.QUESTIONS.values() for page in answers}
    assert len(search.QUESTIONS) >= 30 and all((ROOT / f"{page}.md").exists() for page in pages)


def test_the_words_that_people_search_for_are_entries_of_the_page_that_answers():
    assert "self-play" in search.words()["docs/opponents.md"] and "lstm" in search.words()["docs/memory.md"]
    text = search.indexed("docs/memory.md", "# Memory\n\nText.\n")
    assert text.startswith("# Memory\n\n```{index} ! ") and " ! lstm," in text and text.endswith("```\n\nText.\n")
    assert search.indexed("docs/unknown.md", "# Other\n") == "# Other\n"
    assert search.indexed("CHANGELOG.md", "# Changes\n").startswith("---\nnosearch: true\n---\n# Changes")
    assert all((ROOT / page).exists() for page in search.words())


def test_the_words_that_the_search_of_the_site_indexes_are_plain():
    words = [row[0] for row in ROW.findall((ROOT / FIND).read_text(encoding="utf-8"))]
    assert len(words) > 40 and [each for each in words if re.search(r"[`*<>\[\]{}]", each)] == []
