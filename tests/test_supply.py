"""What is installed: few packages, in known versions, whose files have known hashes."""

import re
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
BESIDE_PYTORCH = {"torch", "fsspec", "mpmath", "networkx", "sympy"}  # which hashes.txt leaves out


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(path):
    """Return the version of each package in a file, and how many hashes follow it."""
    found = re.findall(
        r"^([\w.-]+)(?:\[[\w,]+\])?==([^ #;\n]+)(.*(?:\n +--hash=sha256:[0-9a-f]{64}.*)*)", path.read_text(), re.M
    )
    return {normal(name): (version, rest.count("--hash=")) for name, version, rest in found}


HASHES, CONSTRAINTS = pins(ROOT / "hashes.txt"), pins(ROOT / "constraints.txt")


def direct(*extras):
    """Return the names of what extras ask for, those of the extras that they contain included."""
    wishes = [wish for extra in extras for wish in PROJECT["optional-dependencies"][extra]]
    inner = [re.findall(r"\w+", wish)[1:] for wish in wishes if wish.startswith("joybridge[")]
    names = {name_of(wish) for wish in wishes} - {"joybridge"}
    return names.union(*(direct(*extras) for extras in inner))


def name_of(wish):
    return normal(re.findall(r"^[\w.-]+", wish)[0])


@pytest.mark.promise("X5")
def test_every_package_of_the_constraints_has_hashes_of_that_version():
    missing = [name for name in CONSTRAINTS if name not in HASHES and name not in BESIDE_PYTORCH | {"pip"}]
    assert not missing, "run `python -m tools.hashes`"
    other = {name: (HASHES[name][0], version) for name, (version, _) in CONSTRAINTS.items() if name in HASHES}
    assert [name for name, (ours, theirs) in other.items() if ours != theirs] == []
    assert [name for name, (_, hashes) in HASHES.items() if not hashes] == []


@pytest.mark.promise("X5")
def test_a_package_that_is_asked_for_with_its_extras_has_hashes_with_them():
    """Otherwise pip says that it has no version."""
    wishes = [Requirement(wish) for one in distributions() if normal(one.name) in HASHES for wish in one.requires or ()]
    with_extras = [wish for wish in wishes if wish.extras and (wish.marker is None or wish.marker.evaluate())]
    assert with_extras
    text = (ROOT / "hashes.txt").read_text()
    assert [str(one) for one in with_extras if f"{one.name}[{','.join(sorted(one.extras))}]==" not in text] == []


@pytest.mark.promise("X5")
def test_what_is_asked_for_has_hashes():
    asked = direct("dev", "docs") | {name_of(wish) for wish in PROJECT["dependencies"]}
    assert len(asked) > 30 and asked - HASHES.keys() == {"torch"}


@pytest.mark.promise("X5")
def test_a_trainer_asks_for_few_packages():
    assert len(direct("train")) <= 14  # beside the seven of the contract
    assert len(PROJECT["dependencies"]) <= 7


def test_what_is_cited_is_this_version():
    cited = dict(re.findall(r"^([\w-]+): (.+)$", (ROOT / "CITATION.cff").read_text(), re.M))
    assert (cited["title"].lower(), cited["version"]) == (PROJECT["name"], PROJECT["version"])
    assert cited["license"] == PROJECT["license"] and cited["abstract"] == PROJECT["description"]
    assert f"version = {{{PROJECT['version']}}}" in (ROOT / "docs/paper.md").read_text()
