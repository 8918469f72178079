"""Every fenced block of the pages: Python is run, commands are read by their own parsers, YAML and TOML are checked.

The tutorial has a test of its own, which does everything that it says.
"""

import argparse
import ast
import importlib.util
import re
import shlex
import sys
import tomllib
from argparse import Namespace
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from ruamel.yaml import YAML

from joybridge.cli import commands as all_commands
from joybridge.cli import main
from joybridge.client.command_line import add_own_game
from joybridge.client.launch import simulator_process
from joybridge.compare.suites import SUITES
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError
from joybridge.config.keys import all_keys
from joybridge.layouts.find import GROUP
from joybridge.simulator.new_game.write import write_game
from tests.test_docs import CODE, OF_THE_PAST, PATHS, ROOT
from tools.docs.pages import filled

BLOCK = re.compile(r"^( *)```(\S*)(.*)\n((?:.*\n)*?)\1```$", re.MULTILINE)
PAGES = [path for path in PATHS if path.name not in {"tutorial.md", *OF_THE_PAST}]
SHOWN = {"text", "bibtex", "cpp", "{raw}", "{toctree}"}  # they are not for the reader to run
PROGRAMS = {
    "apt-get",
    "chmod",
    "cmake",
    "cyclonedx-py",
    "mlagents-learn",
    "node",
    "npm",
    "openssl",
    "python3",
    "ray",
    "source",
    "tensorboard",
}  # of others
MEANT = {
    "ADDRESS": "127.0.0.1:5005",
    "HOST:PORT": "127.0.0.1:5005",
    "CONFIG": "archer/hybrid",
    "NAME": "archer/hybrid",
    "N": "1",
}
RUN_BY = {  # Python that is not run here: by what a test of its own says about it
    "my_layouts.py": "test_layouts.py",
    "my_network.py": "test_own_parts.py",
    "my_loss.py": "test_own_parts.py",
    'Policy("policy.json")': "test_new.py",
    'load("runs/catch")': "test_agent.py",
    'load("runs")': "test_origin.py",
    "pygame.examples.chimp": "test_pygame_chain.py",
    "shrink(screen": "test_pygame_chain.py",
    "MaskablePPO(": "test_gym_learners.py",
    '"CnnPolicy"': "test_gym_learners.py",
    "minari.load_dataset(": "test_minari.py",
}
READERS = {
    "NAME.yaml",
    "best.yaml",
    "birds.yaml",
    "config.yaml",
    "my_layouts.py",
    "my_loss.py",
    "my_network.py",
    "ppo.py",
    "reflection.proto",
    "Walker.yaml",
    "catch.py",
    "catch.yaml",
    "chimp_state.py",
    "small_pong.py",
    "teach_chimp.py",
}  # or of others
CHECKOUT = re.compile(
    r"\bmake (install|demo|check|test|docs|bench|proto)\b|python -m tools|\.\./tools/|\bcmake -S|python trainer/"
)


def blocks(language):
    """Return the texts of the blocks of a language, each once, with the page and the line where the first stands."""
    found: dict[str, str] = {}
    for path in PAGES:
        page = path.read_text(encoding="utf-8")
        for match in BLOCK.finditer(page):
            if match[2] == language:
                place = f"{path.relative_to(ROOT)}:{page.count(chr(10), 0, match.start()) + 1}"
                found.setdefault(match[4], place)
    return [pytest.param(text, id=place) for text, place in found.items()]


def command_lines(text):
    """Yield the words of each command in a block of the shell, or in code between words."""
    text = re.sub(r"(^| )#.*$|\[[^\[\]]*…[^\[\]]*\]", "", text.replace("\\\n", " "), flags=re.MULTILINE)
    for line in re.split(r"\n|&&|;|\|| &$", text):
        words = shlex.split(line)
        if words:
            yield [words[0].removeprefix(".venv/bin/"), *words[1:]]


BETWEEN_WORDS = {
    tuple(words): str(path.relative_to(ROOT))
    for path in PAGES
    for block, span in CODE.findall(path.read_text(encoding="utf-8"))
    for words in ([span.split()] if span else [])
    if words[0].removeprefix(".venv/bin/") == "joybridge"
    and len(words) > 2
    and words[1] in all_commands()
    and "…" not in span
}


class Parsed(BaseException):
    """A command line has been understood; the command is not run."""


def parsed(words, folder, monkeypatch):
    """Return what the parser of a command of joybridge makes of its words, and the words that are left for it."""
    monkeypatch.chdir(folder)
    read, depth = argparse.ArgumentParser.parse_known_args, 0

    def parse(self, arguments=None, namespace=None):
        nonlocal depth
        depth += 1
        try:
            found = read(self, arguments, namespace)
        finally:
            depth -= 1
        if not depth:
            raise Parsed(*found)
        return found

    words = [re.sub(r"\b(" + "|".join(MEANT) + r")\b", lambda match: MEANT[match[0]], word) for word in words]
    words = [re.sub(r"^[\w/]+\.yaml$", "my_game.yaml", word) for word in words]
    with mock.patch.object(argparse.ArgumentParser, "parse_known_args", parse), pytest.raises(Parsed) as found:
        main(words)
    options, rest = found.value.args
    return options, rest


def check_command(words, folder, monkeypatch):
    """Fail if a command of joybridge would not understand its words, or would not find its configuration or a key."""
    options, rest = parsed(words, folder, monkeypatch)
    overrides = [*getattr(options, "overrides", []), *rest]
    config = getattr(options, "config", None)
    if suite := getattr(options, "suite", None):  # what is read as the configuration is an override
        overrides += [config] if config else []
        config = next(iter(SUITES[suite].tasks.values())).config
    if config is None:  # what plays sets the game only
        assert [word for word in overrides if not re.match(r"(games\.\w+\.)?(options|parameters)\.\w+=", word)] == []
        return
    varied = [
        f"{key}={values.partition(',')[0]}"
        for key, _, values in (text.partition("=") for text in getattr(options, "set", []))
    ]
    layouts = [word if "=" in word else f"layout={word}" for word in getattr(options, "layouts", [])]
    load_config(find_config(config), [*overrides, *varied, *layouts])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Yield a folder in which the game and the configuration lie that the pages speak of."""
    folder = tmp_path_factory.mktemp("reader")
    write_game("my_game", folder)
    yield folder
    sys.modules.pop("my_game", None)


@pytest.fixture(scope="module")
def server(folder):
    """Yield the address of a simulator that has this game as well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        with simulator_process(["my_game:MyGame"]) as address:
            yield address


def test_every_block_says_what_it_holds_and_is_checked():
    languages = {match[2] for path in PAGES for match in BLOCK.finditer(path.read_text(encoding="utf-8"))}
    assert languages - SHOWN == {"sh", "python", "yaml", "toml"}
    assert all(len(blocks(language)) for language in languages)


def test_python_is_run(server, folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr("joybridge.gym.bridge.simulator_process", lambda places: nullcontext(server))
    names: dict[str, Any] = {}
    run = 0
    for block in blocks("python"):
        text = block.values[0].replace("127.0.0.1:5005", server)
        elsewhere = [test for piece, test in RUN_BY.items() if piece in text]
        assert all((ROOT / "tests" / test).exists() for test in elsewhere)
        if elsewhere:
            compile(text, str(block.id), "exec", dont_inherit=True)
            continue
        if "infos" in text and "infos =" not in text:
            names["infos"] = names["envs"].reset()[1]
        exec(compile(text, str(block.id), "exec", dont_inherit=True), names)
        run += 1
    assert run >= 3 and all(hasattr(names[name], "close") for name in ("envs", "env", "pair", "mine", "forgiving"))
    for name in ("envs", "env", "pair", "mine", "forgiving"):
        names[name].close()


@pytest.mark.parametrize("text", blocks("sh"))
def test_commands_are_understood(text, folder, monkeypatch):
    for program, *words in command_lines(text):
        if program == "joybridge":
            check_command(words, folder, monkeypatch)
        elif program == "make":
            assert all(re.search(rf"^{word}:", (ROOT / "Makefile").read_text(), re.MULTILINE) for word in words)
        elif program == "pip":
            extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
            named = re.findall(r"\[(.*?)\]", " ".join(words))
            assert {extra for group in named for extra in group.split(",")} <= set(extras)
        elif program == "python":
            check_tool(words)
        else:
            assert program in PROGRAMS or program.startswith("proto/examples/"), program


def check_tool(words):
    """Fail if there is no such module or file, or if its sources do not know its options and commands."""
    if words[0] == "-m":
        found = importlib.util.find_spec(words[1])
        assert found is not None and found.origin is not None
        path = Path(found.origin)
    else:
        path = ROOT / words[0]
    files = path.parent.glob("*.py") if path.name == "__init__.py" else [path]
    known = {
        node.value for file in files for node in ast.walk(ast.parse(file.read_text())) if type(node) is ast.Constant
    }
    assert {word for word in words[2:] if word.startswith("--")} <= known


@pytest.mark.parametrize("words", BETWEEN_WORDS, ids=" ".join)
def test_commands_between_words_are_understood(words, folder, monkeypatch):
    check_command(list(words[1:]), folder, monkeypatch)


@pytest.mark.parametrize("text", blocks("yaml"))
def test_configurations_are_valid(text, tmp_path):
    given = YAML(typ="safe").load(text)
    several = "common_device" in given and "games" not in given
    one: dict[str, object] = {} if "games" in given else {"game": "archer"}
    data = ({"games": {"archer": {}, "marble": {}}} if several else one) | given
    path = tmp_path / "config.yaml"
    with path.open("w") as file:
        YAML().dump(data, file)
    options = Namespace(game=[], simulator=[], overrides=[])
    add_own_game(options, [str(path)])
    load_config(path, options.overrides)


@pytest.mark.parametrize("text", blocks("toml"))
def test_entry_points_are_those_that_are_looked_for(text):
    (group,) = tomllib.loads(text)["project"]["entry-points"]
    assert group == GROUP


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("train archer/hybrid --sead 3", ConfigError),
        ("train archer/hybrid policy.epoch=3", ConfigError),
        ("train archer/hybird", ConfigError),
        ("evaluate RUN policy.epochs=3", AssertionError),
        ("compare archer/hybrid --output a --set policy.gama=0.9,0.99", ConfigError),
        ("trian archer/hybrid", pytest.fail.Exception),
    ],
)
def test_a_wrong_command_option_key_or_name_is_noticed(line, error, folder, monkeypatch):
    with pytest.raises(error):
        check_command(line.split(), folder, monkeypatch)


# ------------------------------------------------------------------------------------------------------ other words


def test_the_keys_and_defaults_in_the_table_for_those_who_come_from_other_libraries_are_right():
    defaults = {key.name: key.default for key in all_keys()}
    rows = [
        line.strip("| ").split(" | ")
        for line in (ROOT / "docs/from-sb3-cleanrl.md").read_text().splitlines()
        if line.startswith("| ")
    ]
    read = YAML(typ="safe").load
    keys = 0
    for *_, names, values in rows:
        found = [name for name in re.findall(r"`([a-z_.]+)`", names) if name in defaults]
        shown = values.split(", ") if len(found) > 1 else [values]
        if found and values not in ("–", "as in the game"):
            assert [read(value) for value in shown] == [read(defaults[name]) for name in found], names
            keys += len(found)
    assert keys > 10


def test_source_files_that_pages_and_drawings_name_exist():
    sources = {path.name for path in ROOT.rglob("*.*") if not {"node_modules", ".venv"} & set(path.parts)}
    texts = [path.read_text(encoding="utf-8") for path in [*PAGES, *(ROOT / "docs").glob("*.svg")]]
    named = {
        name for text in texts for name in re.findall(r"[`/ ,>]([\w.-]+\.(?:py|cpp|hpp|ts|mjs|proto|yaml))\b", text)
    }
    assert len(named) > 50 and named - sources <= READERS


# ------------------------------------------------------------------------------------------------ without a checkout


@pytest.mark.parametrize(
    "path", [path for path in PAGES if path.parent.name != "reference"], ids=lambda path: str(path.relative_to(ROOT))
)
def test_what_needs_a_checkout_says_so(path):
    page = str(path.relative_to(ROOT))
    if page in ("CONTRIBUTING.md", "README.md", "docs/faults.md", "results/README.md"):
        return  # for those who have one; its sections are tested where the site shows them; how it was made
    head, *sections = re.split(r"^##+ ", filled(page, path.read_text(encoding="utf-8")), flags=re.MULTILINE)
    for section in [head, *sections]:
        assert ".venv/bin/joybridge" not in section
        assert not CHECKOUT.search(section) or "checkout" in head + section, section
