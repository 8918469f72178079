"""Files of earlier versions, in tests/data/VERSION with the commit that wrote them: they are read, or refused by name.

A version that gives up a format replaces nothing there: the test then wants the sentence that names the format.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from joybridge.client.client import describe
from joybridge.client.recording import RecordingError
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.demonstrations.files import load_demonstration
from tests.support.command_line import joybridge
from tests.test_export import RUNTIME, load_runtime

VERSIONS = sorted(path for path in (Path(__file__).parent / "data").glob("[0-9]*") if path.is_dir())


def test_there_are_versions_and_each_names_its_commit():
    assert VERSIONS
    assert all(len((folder / "COMMIT").read_text().strip()) == 40 for folder in VERSIONS)


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_run_plays_as_it_did_or_its_format_is_named(folder, simulator, tmp_path):
    shutil.copytree(folder / "run", tmp_path / "run")
    assert load_config(tmp_path / "run/config.yaml").game == "archer"
    assert read_rows(tmp_path / "run/metrics-archer.csv")[-1]["timesteps"] == 480
    done = joybridge(
        "evaluate", str(tmp_path / "run"), "--episodes", "4", "--seed", "3", "--json", "--simulator", simulator
    )
    if done.status:
        assert "use the version of joybridge that wrote it" in done.errors
    else:
        means = json.loads(done.output.splitlines()[-1])["archer"]["means"]
        wanted = json.loads((folder / "evaluation.json").read_text())["archer"]["means"]
        assert means == pytest.approx(wanted)


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_demonstration_is_read_or_its_format_is_named(folder, simulator):
    try:
        demonstration = load_demonstration(folder / "archer-0001.demo", describe(simulator, "archer", {}))
    except RecordingError as error:
        if "use the version of its time" not in str(error):
            raise
    else:
        assert demonstration.episodes(0)[0] >= 4


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_policy_is_played_or_its_format_is_named(folder):
    try:
        policy = load_runtime(RUNTIME).Policy(folder / "policy.json")
    except ValueError as error:
        if "write it with `joybridge export RUN policy.json`" not in str(error):
            raise
    else:
        sensors = {one["name"]: np.zeros((1, *one["shape"])) for one in policy.sensors}
        axes, choices, _ = policy.act(sensors, policy.begin(1), np.random.default_rng(0))
        assert np.isfinite(axes).all() and choices.shape == (1, len(policy.branches))
