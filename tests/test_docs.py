"""The documents name files, commands and keys that exist."""

import importlib.util
import itertools
import re
from pathlib import Path

import pytest

from joybridge.cli import COMMANDS, main
from joybridge.trainer.config import Config, PolicyConfig

ROOT = Path(__file__).parents[1]
ELSEWHERE = {"node_modules", "build", "runs"}  # written by programs
PATHS = [
    path
    for path in sorted(ROOT.rglob("*.md"))
    if not any(part in ELSEWHERE or part.startswith(".") for part in path.relative_to(ROOT).parts)
]
DOCUMENTS = [pytest.param(path, id=str(path.relative_to(ROOT))) for path in PATHS]
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
    assert {"README.md", "CONTRIBUTING.md", "DECISIONS.md", "GLOSSARY.md"} <= {path.name for path in PATHS}


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_relative_link_leads_to_a_file(path):
    links = [link.split("#")[0] for link in LINK.findall(path.read_text()) if "://" not in link]
    assert [link for link in links if not (path.parent / link).exists()] == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_command_exists(path):
    names = {words[0] for words in commands(path)}
    assert names - set(COMMANDS) - {"simulator"} == set()  # "joybridge simulator listening on" is an output


def test_the_readme_names_every_command():
    assert {words[0] for words in commands(ROOT / "README.md")} >= set(COMMANDS)


def test_the_readme_leads_to_every_page_for_users():
    links = {(ROOT / link.split("#")[0]).resolve() for link in LINK.findall((ROOT / "README.md").read_text())}
    pages = {path for path in PATHS if path.parent in (ROOT / "trainer", ROOT / "simulator", ROOT / "proto/examples")}
    assert len(pages) >= 6 and pages - links == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_in_a_document_exists(command, capsys):
    named = {
        option
        for path in PATHS
        for words in commands(path)
        if words[0] == command
        for option in re.findall(r"--[a-z-]+", " ".join(words).split("|")[0])
    }
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert named - set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) == set()


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_module_that_is_run_exists(path):
    modules = re.findall(r"python -m ((?:tools|joybridge)[\w.]*\w)", path.read_text())
    assert [name for name in modules if name != "tools.NAME" and importlib.util.find_spec(name) is None] == []


@pytest.mark.parametrize("path", DOCUMENTS)
def test_every_configuration_that_is_trained_exists(path):
    named = [word for words in commands(path) if words[0] == "train" for word in words[1:2] if "/" in word]
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


def test_the_keys_of_the_glossary_are_keys_of_a_configuration():
    keys = re.findall(r"^\| `([a-z_.]+)`", (ROOT / "GLOSSARY.md").read_text(), re.MULTILINE)
    assert len(keys) > 10
    known = {*Config.model_fields, *(f"policy.{name}" for name in PolicyConfig.model_fields)}
    assert set(keys) - known == set()
