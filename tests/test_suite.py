"""A comparison on all tasks of a suite: real runs of every game, and one page about them."""

import json
import re
from typing import Any

import pytest

from joybridge.compare import launch
from joybridge.compare.command import parse
from joybridge.compare.suite import _timesteps, write_suite
from joybridge.compare.suites import SUITES
from joybridge.compare.table import read_table
from joybridge.compare.variants import Variant, keep
from joybridge.config.config import Config
from joybridge.config.config_files import config_names
from joybridge.config.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb
from tests.support.command_line import joybridge
from tests.support.jobs import train_here

TINY = (
    "arenas=2",
    "total_timesteps=64",
    "log_interval=32",
    "evaluate_during.episodes=2",
    "policy.rollout_steps=16",
    "policy.time_horizon=16",
    "policy.minibatch_size=16",
    "policy.epochs=1",
)


@pytest.mark.parametrize(("suite", "folder"), [("hybrid", "hybrid_suite/"), ("classic", "classic/")])
def test_a_suite_has_all_installed_configurations_of_its_folder(suite, folder):
    assert {task.config for task in SUITES[suite].tasks.values()} == {
        name for name in config_names() if name.startswith(folder)
    }


def test_tasks_are_trained_and_are_on_one_page(tmp_path, simulator, monkeypatch):
    monkeypatch.setattr(launch, "start", train_here)
    words = ["compare", "--suite", "hybrid", "--tasks", "catch_point", "--seeds", "1", "--output", str(tmp_path)]
    status, output, errors = joybridge(*words, *TINY)
    assert status == 0, errors
    page = (tmp_path / "page.md").read_text()
    assert re.search(r"\| catch_point \| 64 \| \d+ \| 0.85 / 0.93 \| unchanged \| \*\*", page) and "missing" not in page
    assert "|  |  |  |  | only\\_with=false | **" in page and "|  |  |  |  | bucket-16 | **" in page
    assert f"{tmp_path / 'page.html'}" in output
    assert (tmp_path / "catch_point" / "page-held_out_success.html").exists()


def test_a_task_of_which_no_two_runs_ended_an_episode_together_is_as_long_as_its_configuration(tmp_path):
    short = Variant("short", Config(game="g", total_timesteps=700))
    keep([short], [pb.GameSpec(name="g")], tmp_path)
    nothing: dict[str, list[Any]] = {"variants": [{"curve": {"timesteps": []}}]}
    assert _timesteps(nothing, tmp_path) == 700
    assert _timesteps({"variants": [*nothing["variants"], {"curve": {"timesteps": [10, 20]}}]}, tmp_path) == 20


def test_a_page_has_a_row_for_each_variant_and_says_what_is_missing(tmp_path):
    def variant(label, *scores):
        iqm = {"value": scores[0], "low": 0.0, "high": 1.0}
        return {"label": label, "scores": scores, "iqm": iqm, "curve": {"timesteps": [10, 200000]}}

    platform, goal = [variant("a", 0.5, 0.75), variant("b", 0.25)], [variant("b", 1.0)]
    for name, metric, variants in (("platform", "reward", platform), ("goal", "success", goal)):
        (tmp_path / name).mkdir()
        times = {each["label"]: {"seconds": [10.0, 20.0]} for each in variants}
        (tmp_path / name / f"compare-held_out_{metric}.json").write_text(
            json.dumps({"variants": variants, "wall_clock": times})
        )
        kept = {"config": Config(game=name, layout="bucket-3", policy={"gamma": 0.5, "epochs": 9}).model_dump()}
        (tmp_path / name / "variants.json").write_text(json.dumps({"a": kept | {"spec": {}}}))
    write_suite("hybrid", tmp_path, "joybridge compare --suite hybrid", {"moving": "it does not fit"})
    page = (tmp_path / "page.md").read_text()
    cells = (
        "a | **0.500** [0.000, 1.000] | 0.500, 0.750 | 15 |\n|  |  |  |  | b | **0.250** [0.000, 1.000] | 0.250 | 15 |"
    )
    assert f"| platform, *reward* | 200,000 | 2 | 0.90 / 0.98 | {cells}\n" in page
    assert "| goal, *success* | 200,000 | 2 | 0.50 / 0.78 | b | **1.000** [0.000, 1.000] | 1.000 | 15 |" in page
    assert "- moving: it does not fit" in page
    (tmp_path / "goal" / "compare-held_out_success.json").write_text("{")
    with pytest.raises(ConfigError, match="cannot be read"):
        write_suite("hybrid", tmp_path, "", {})


def test_ours_and_another_trainer_are_on_one_page(tmp_path):
    words = "compare", "--suite", "classic", "--tasks", "cartpole", "--seeds", "1", "--output", str(tmp_path)
    status, _, errors = joybridge(*words, *TINY)
    assert status == 0, errors
    page = (tmp_path / "page.md").read_text()
    assert re.search(r"\| cartpole \| 64 \| \d+ \| hybrid \| \*\*", page)
    assert "|  |  |  | hybrid, Stable-Baselines3 | **" in page
    assert (tmp_path / "pictures" / "seconds-light.png").stat().st_size > 4000
    models = [path.stat().st_mtime_ns for path in tmp_path.rglob("model.zip")]
    assert joybridge(*words, *TINY).status == 0  # what is finished is not trained again
    assert models == [path.stat().st_mtime_ns for path in tmp_path.rglob("model.zip")] != []
    assert {name.run.experiment for name in read_table(tmp_path / "cartpole")} == {"hybrid", "hybrid-Stable-Baselines3"}


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["archer/hybrid", "--suite", "hybrid"],
        ["--suite", "hybrid", "--also", "a"],
        ["--suite", "nothing"],
        ["archer/hybrid", "--tasks", "goal"],
    ],
)
def test_a_suite_or_a_configuration_is_named(words, capsys):
    with pytest.raises(SystemExit):
        parse(["compare", *words, "--output", "x"], "joybridge")
    assert "error: " in capsys.readouterr().err
