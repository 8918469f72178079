"""Damaged policies, and games that send no numbers, in the three runtimes: an answer or an error, nothing else."""

import json
import math
import random
import shutil
import subprocess

import numpy as np
import pytest

from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import MemoryConfig
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.document import encode
from joybridge.policy.exported import read_exported
from tests.support.cpp_player import build_player
from tests.support.exported_runs import (
    EXAMPLES,
    IMAGES,
    PLAY_ALL,
    RUNTIME,
    SMALL,
    documents,
    load_runtime,
    make_run,
    pointing,
)

FINE, REFUSED = 0, 1  # exit statuses; the sanitizer's are others
FILES = 200
STRANGE: tuple[object, ...] = (
    -1,
    0,
    1,
    7,
    1e9,
    1e300,
    -0.5,
    2**63,
    "",
    "x",
    [],
    {},
    None,
    True,
    [[]],
    {"shape": [9, 9], "float32": "AAAA"},
)


@pytest.fixture(scope="module", params=["numbers", "map"])
def policy(request, simulator, tmp_path_factory):
    """Return a document; two have all of the format: tables, Gaussians, scaling and memory; images and a map."""
    memory = {"scale_observations": "bounds", "memory": MemoryConfig(kind="lstm", size=5)}
    settings = {
        "numbers": {"layout": "hybrid", "policy": SMALL.model_copy(update=memory)},
        "map": pointing(IMAGES[1], "map-3x2"),
    }[request.param]
    run = make_run(tmp_path_factory.mktemp("run") / "run", simulator, **settings)
    with open_play(PlaySpec(run, simulator, seed=3)) as play:
        return json.loads(encode(documents(play)))


@pytest.fixture(scope="module")
def decision(policy):
    return {
        "sensors": {one["name"]: [0.5] * math.prod(one["shape"]) for one in policy["sensors"]},
        "masks": {},
        "normal": [0.1] * 40,
        "uniform": [0.9] * 40,
        "ends": 0,
    }


def damaged(document, chance):
    """Return the document with one part of it removed, doubled, or replaced by something strange."""
    document = json.loads(json.dumps(document))
    places = []

    def walk(part):
        for key in list(part) if isinstance(part, dict) else range(len(part)):
            places.append((part, key))
            if isinstance(part[key], dict | list):
                walk(part[key])

    walk(document)
    part, key = chance.choice(places)
    match chance.randrange(4):
        case 0:
            del part[key]
        case 1 if isinstance(part, list):
            part.extend([part[key]] * chance.choice([1, 3, 1000]))
        case 2 if isinstance(part[key], str) and len(part[key]) > 8:
            part[key] = part[key][: chance.randrange(len(part[key]))]
        case _:
            part[key] = chance.choice(STRANGE)
    return json.dumps(document)


def hostile(policy):
    """Return files that are no policy, and policies of which one part is wrong."""
    chance = random.Random(7)
    return ["[" * 200_000, '{"a":' * 100_000, "", "nothing", *(damaged(policy, chance) for _ in range(FILES))]


@pytest.mark.slow  # each file has a process of its own
@pytest.mark.promise("X6")
def test_no_file_makes_the_c_runtime_leave_its_memory(policy, decision, tmp_path):
    if not shutil.which("c++"):
        pytest.skip("install a C++ compiler to play a policy there")
    command = [build_player(tmp_path), tmp_path / "policy.json", tmp_path / "decisions.json"]
    statuses = []
    (tmp_path / "decisions.json").write_text(json.dumps([decision] * 3))
    for text in (json.dumps(policy), *hostile(policy)):
        (tmp_path / "policy.json").write_text(text)
        result = subprocess.run(command, capture_output=True, check=False)
        assert result.returncode in (FINE, REFUSED), (text[:2000], result.stderr.decode()[:3000])
        statuses.append(result.returncode)
    assert statuses[0] == FINE and set(statuses) == {FINE, REFUSED}
    (tmp_path / "policy.json").write_text(json.dumps(policy))
    for value in ("nan", "-inf"):  # which `from_chars` reads as numbers
        (tmp_path / "decisions.json").write_text(json.dumps([decision]).replace("[0.5", f"[{value}", 1))
        result = subprocess.run(command, capture_output=True, check=False)
        assert result.returncode == REFUSED and b"a sensor is not finite" in result.stderr


def test_no_file_makes_the_javascript_runtime_act_without_numbers(policy, decision, tmp_path):
    if not shutil.which("node"):
        pytest.skip("install Node.js to play a policy there")
    files = hostile(policy)
    (tmp_path / "all.json").write_text(json.dumps([json.dumps(policy), *files]))
    program = (
        PLAY_ALL.split("const [")[0].replace("POLICY", (EXAMPLES / "javascript" / "policy.mjs").as_uri())
        + """
    const [files, decision] = process.argv.slice(1).map((file) => JSON.parse(readFileSync(file, "utf8")));
    const noise = { normal: () => 0.1, uniform: () => 0.9 };
    for (const file of files) {
      try {
        const policy = new Policy(JSON.parse(file));
        const { axes, choices } = policy.act(decision.sensors, policy.begin(), {}, noise);
        console.log([...axes, ...choices].every(Number.isFinite) ? "answer" : "not a number");
      } catch (error) {
        console.log("refused");
      }
    }"""
    )
    (tmp_path / "decision.json").write_text(json.dumps(decision))
    command = ["node", "--input-type=module", "-e", program, tmp_path / "all.json", tmp_path / "decision.json"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(said) == 1 + len(files) and said[0] == "answer" and set(said) == {"answer", "refused"}


def test_a_small_file_that_claims_endless_arrays_is_refused_at_once(policy):
    """One row of a grid or a table becomes a node of the model that plays the file."""
    endless = {"shape": [10**9, 0], "float32": ""}
    network = policy["policies"][0]
    wrong = [policy | {"policies": [network | {"discrete": [{"branches": [0], "values": endless}]}]}]
    if network["images"]:
        image = network["images"][0]
        for grid in (endless, {"shape": [3, 0], "float32": ""}, [1, 2]):
            moments = [{"step": 1, "grid": grid}]
            wrong.append(policy | {"policies": [network | {"images": [image | {"moments": moments}]}]})
    for document in wrong:
        with pytest.raises(ConfigError, match="is no exported policy"):
            read_exported(json.dumps(document).encode(), "policy.json")


def test_no_file_makes_the_python_runtime_act_without_numbers(policy, decision, tmp_path):
    runtime = load_runtime(RUNTIME)
    ends: list[bool | None] = []
    for text in (json.dumps(policy), *hostile(policy)):
        (tmp_path / "policy.json").write_text(text)
        sensors = {name: np.array([values], np.float32) for name, values in decision["sensors"].items()}
        try:
            one = runtime.Policy(tmp_path / "policy.json")
            axes, _, _ = one.act(sensors, one.begin(1), np.random.default_rng(0))
            ends.append(bool(np.isfinite(axes).all()))
        except Exception:
            ends.append(None)
    assert ends[0] and False not in ends and None in ends
