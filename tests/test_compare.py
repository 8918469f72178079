"""`joybridge compare`: what it trains, refuses and repeats. Runs train in this process."""

import csv
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from joybridge.compare import command, tested
from joybridge.compare.job import Job
from joybridge.compare.launch import different_bodies, make_job, scored_policy
from joybridge.compare.table import TABLE, add_results, read_table
from joybridge.compare.tested import SEED
from joybridge.compare.variants import (
    VARIANTS,
    check_game,
    kept_spec,
    make_variants,
    read_variants,
)
from joybridge.config.errors import ConfigError
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.run_lock import locked
from tests.support.compared import OUT, run_in
from tests.support.jobs import train_here

pytestmark = pytest.mark.usefixtures("signals")


@pytest.fixture(scope="module")
def whole(simulator, tmp_path_factory) -> Path:
    """Return a folder with a comparison that was not interrupted.

    It reaches most lines of a comparison. Tests that repeat much of it are not measured, which takes twice the time.
    """
    folder = tmp_path_factory.mktemp("whole")
    done = run_in(folder, simulator, draw=True)
    assert done.status == 0, done.errors
    assert "2 variants: hybrid, bucket-3\n" in done.errors
    assert "networks, too: actor and critic have a body each in hybrid; share one in bucket-3. With" in done.errors
    assert "hybrid-s0: done, reward " in done.output and "next: joybridge evaluate out/runs/" in done.errors
    return folder


@pytest.fixture
def copied(whole, tmp_path, monkeypatch) -> Iterator[Path]:
    """Return a copy of the whole comparison, beside which the test works."""
    shutil.copytree(whole, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    return tmp_path / "copy"


def page(folder: Path, name: str = "page") -> str:
    """Return the page without its only section that depends on the clock."""
    before, _, after = (folder / OUT / f"{name}.md").read_text().partition("## Wall-clock time")
    return before + after[after.index("## ") :]


def numbers(folder: Path) -> dict[str, object]:
    """Return the numbers of the page without those that depend on the clock."""
    data: dict[str, object] = json.loads((folder / OUT / "compare.json").read_text())
    assert data.pop("wall_clock")
    return data


def forget(run: str) -> None:
    """Take a run out of the table of finished runs."""
    results = read_table(OUT)
    (OUT / TABLE).unlink()
    add_results(OUT, {name: rows for name, rows in results.items() if str(name.run) != run})


def assert_same(one: Path, other: Path) -> None:
    assert page(one) == page(other)
    assert numbers(one) == numbers(other)
    assert (one / OUT / "scores.csv").read_bytes() == (other / OUT / "scores.csv").read_bytes()


@pytest.mark.no_cover  # see `whole`
@pytest.mark.promise("F2")
def test_a_comparison_that_was_killed_and_is_repeated_ends_in_the_same_figures(whole, copied, simulator):
    # As a kill leaves it: a finished run, one that was interrupted after a checkpoint, two that have not begun.
    for name in ("hybrid-s1", "bucket-3-s0", "bucket-3-s1"):
        shutil.rmtree(OUT / "runs" / name)
    (OUT / TABLE).unlink()
    half = Job("bucket-3", 0, 640, OUT / "configs", OUT / "runs", arguments=("--simulator", simulator))
    assert train_here(half).status == 0 and has_checkpoint(half.run)
    done = run_in(copied, simulator)
    assert done.status == 0 and "4 runs, 1 of them already finished" in done.output
    assert_same(copied, whole)


def test_a_finished_comparison_is_repeated_without_a_simulator(whole, copied):
    done = run_in(copied, "127.0.0.1:1", "--wait", "0.1")
    assert done.status == 0 and "done" not in done.output
    for name in ("page.md", "page.html", "compare.json"):
        assert (copied / OUT / name).read_bytes() == (whole / OUT / name).read_bytes()


def test_a_study_may_begin_with_a_seed_that_an_earlier_one_did_not_have(copied):
    done = run_in(copied, "127.0.0.1:1", "--wait", "0.1", "--first-seed", "1", "--seeds", "1")
    assert done.status == 0 and "done" not in done.output
    assert [variant["seeds"] for variant in json.loads((OUT / "compare.json").read_text())["variants"]] == [[1], [1]]
    assert "--seeds 1 --first-seed 1 --simulator" in page(copied)


def test_finished_runs_may_be_deleted_and_the_rest_is_trained(whole, copied, simulator):
    shutil.rmtree(OUT / "runs" / "hybrid-s0")
    finished = run_in(copied, "127.0.0.1:1", "--wait", "0.1")
    assert finished.status == 0
    shutil.rmtree(OUT / "runs")
    forget("bucket-3-s1")
    done = run_in(copied, simulator)
    assert done.status == 0 and done.output.count(": done") == 1 and "1 runs, 0 of them" in done.output
    assert_same(copied, whole)


@pytest.mark.no_cover  # see `whole`
def test_another_metric_and_score_need_no_training_and_leave_the_page_of_the_reward(whole, copied):
    more = "--metric", "accuracy", "--score", "0.25", "--figures", "svg"
    done = run_in(copied, "127.0.0.1:1", *more, draw=True)
    assert done.status == 0 and "out/page-accuracy.md" in done.output
    assert_same(copied, whole)
    pictures = [path.name for path in (OUT / "pictures").glob("curves*")]
    ends = "-accuracy-dark.png", "-accuracy-light.png", "-accuracy.svg", "-dark.png", "-light.png"
    assert sorted(pictures) == [f"curves{end}" for end in ends]
    assert "out/pictures/curves-accuracy.svg" in done.output
    assert ">timesteps</text>" in (OUT / "pictures/curves-accuracy.svg").read_text()  # not the outlines of letters
    for picture in (OUT / "pictures").glob("scores-[dl]*"):
        assert picture.read_bytes() == (whole / picture).read_bytes()
    assert "data:image" in (OUT / "page-accuracy.html").read_text()
    text = page(copied, "page-accuracy")
    assert "pictures/scores-accuracy-light.png" in text
    assert "mean *accuracy*" in text and "## Timesteps to a score of 0.25" in text
    again = text.splitlines()[-2]
    assert "--metric accuracy --score 0.25" in again and again.endswith(" --figures svg --output FOLDER")
    unknown = run_in(copied, "127.0.0.1:1", "--metric", "acuracy")
    assert unknown.status == 1
    known = "archer has reward, length, hits, accuracy, reward_std, episodes; of the training: "
    assert f"--metric got 'acuracy'; {known}" in unknown.errors
    assert page(copied, "page-accuracy") == text  # the last page is still there


def test_the_page_says_that_the_variants_differ_in_their_networks(whole):
    said = "## What differs\n\nThe variants differ in their networks, too: actor and critic have a body each in hybrid;"
    assert said in page(whole)


def test_all_runs_play_a_test_whose_scores_have_a_page_of_their_own(whole, copied, simulator, monkeypatch):
    more = "--test", "parameters.size=0.5", "--episodes", "6", "--deterministic"
    done = run_in(copied, "", *more)
    assert done.status == 0, done.errors
    assert_same(copied, whole)  # the page of the training, beside it
    name = "-test_parameters.size=0.5-deterministic"
    text = (OUT / f"page{name}.md").read_text()
    assert "Learning curves" not in text and "Timesteps to" not in text  # these are of the training
    played = "6 episodes that its policy plays in a test without learning, under parameters.size=0.5, with the most pro"
    assert f"mean *reward* of the {played}" in text
    assert "--test parameters.size=0.5 --episodes 6 --deterministic" in text.splitlines()[-2]
    with (OUT / f"scores{name}.csv").open() as file:
        scores = {(line["variant"], line["seed"]): float(line["reward"]) for line in csv.DictReader(file)}
    plays = PlaySpec(OUT / "runs/bucket-3-s1", simulator, SEED, True, ["parameters.size=0.5"])
    found = evaluate(plays, episodes=6, say=lambda _: None)["archer"]
    assert len(scores) == 4 and scores["bucket-3", "1"] == found.means["reward"]
    with monkeypatch.context() as patch:
        patch.setattr(tested, "open_simulators", lambda *_: pytest.fail("a simulator is started"))
        again = run_in(copied, "", *more, "--metric", "accuracy")
    assert again.status == 0, again.errors
    assert f"bucket-3-s1: accuracy {found.means['accuracy']:.4g}" in again.errors
    away = run_in(copied, "127.0.0.1:1", *more, "--wait", "0.2")
    assert away.status == 1 and away.errors.count("no simulator at 127.0.0.1:1") == 1  # it is waited for once
    with monkeypatch.context() as patch:
        patch.setattr(tested, "_newest", lambda run: 10**6)
        longer = run_in(copied, simulator, *more)
    assert longer.status == 1 and "its newest policy has trained for 1,000,000 timesteps, and " in longer.errors
    shutil.rmtree(OUT / "runs/hybrid-s0")
    lost = run_in(copied, simulator, *more)
    assert lost.status == 1 and "missing: hybrid-s0: out/runs/hybrid-s0 is not the folder of a run" in lost.errors
    shutil.rmtree(OUT / "runs")
    archived = run_in(copied, simulator, *more)
    assert archived.status == 1 and "a test needs the policies of the runs, and there is no folder" in archived.errors


def test_all_runs_play_under_each_value_of_a_setting_and_one_table_shows_all(whole, copied, simulator):
    done = run_in(copied, simulator, "--over", "parameters.size=0.5,1,2", "--episodes", "6")
    assert done.status == 0, done.errors
    assert "4 runs play 6 episodes each under each of 3 values of parameters.size, one after the other" in done.errors
    assert "\n12 of 12: " in done.errors
    assert_same(copied, whole)  # the page of the training, beside it
    name = "-over_parameters.size=0.5_1_2"
    with (OUT / f"scores{name}.csv").open() as file:
        lines = [*csv.DictReader(file)]
    assert [line["parameters.size"] for line in lines[:6]] == ["0.5", "0.5", "1", "1", "2", "2"] and len(lines) == 12
    plays = PlaySpec(OUT / "runs/hybrid-s1", simulator, SEED, False, ["parameters.size=2"])
    found = evaluate(plays, episodes=6, say=lambda _: None)["archer"].means["reward"]
    (kept,) = [
        line
        for line in lines
        if line["variant"] == "hybrid" and line["seed"] == "1" and float(line["parameters.size"]) == 2
    ]
    assert float(kept["reward"]) == found
    data = json.loads((OUT / f"compare{name}.json").read_text())
    value = data["variants"][0]["values"][2]
    assert value["value"] == "2" and found in value["scores"]
    assert value["iqm"]["value"] == pytest.approx(np.mean(value["scores"]))
    text = (OUT / f"page{name}.md").read_text()
    assert "| variant, mean under parameters.size= | 0.5 | 1 | 2 |" in text.replace("\\", "")
    assert "over parameters.size; gray: as trained" in text
    assert f"pictures/scores{name}-light.png" in text and (OUT / f"pictures/scores{name}-dark.png").exists()
    assert (
        "--over parameters.size=0.5,1,2 --episodes 6" in text.splitlines()[-2] and "--test" not in text.splitlines()[-2]
    )


def test_a_comparison_of_another_configuration_is_refused_by_name(copied):
    before = page(copied)
    done = run_in(copied, "127.0.0.1:1", "policy.epochs=3", "stop_at=640")
    assert done.status == 1
    assert done.errors == (
        "error: out holds another comparison: of 'hybrid', policy.epochs was 4 and is now 3; repeat the command as it "
        "was, or name another folder with --output\n"
    )
    assert page(copied) == before


def test_a_game_that_has_changed_is_refused_by_name(copied, simulator):
    data = json.loads((OUT / VARIANTS).read_text())
    data["bucket-3"]["spec"]["behaviors"][0]["sensors"][0]["shape"] = [77]
    (OUT / VARIANTS).write_text(json.dumps(data))
    shutil.rmtree(OUT / "runs/bucket-3-s1")
    forget("bucket-3-s1")
    done = run_in(copied, simulator)
    assert done.status == 1
    assert (
        "the game archer has changed since out was begun: of 'bucket-3', behaviors.0.sensors.0.shape.0 was 77 and "
        in (done.errors)
    )


def test_a_comparison_goes_on_with_a_simulator_that_offers_more_with_the_same_game(copied):
    (variant,) = make_variants(["archer/hybrid"], [], [])
    spec = kept_spec(variant, OUT)
    assert spec is not None
    spec.snapshot_bytes_per_arena += 8
    spec.parameters_per_episode = not spec.parameters_per_episode
    spec.behaviors[0].description = "in other words"
    spec.options.add(name="weather", choices=["calm", "windy"], default_choice="calm")
    check_game(variant, spec, OUT)
    spec.behaviors[0].metrics[0].name = "other"
    with pytest.raises(ConfigError, match=r"behaviors.0.metrics.0.name was \"\w+\" and is now \"other\""):
        check_game(variant, spec, OUT)


def test_another_default_of_an_option_or_an_option_that_is_gone_is_another_game(copied):
    (variant,) = make_variants(["archer/hybrid"], [], [])
    data = json.loads((OUT / VARIANTS).read_text())
    data["hybrid"]["spec"]["options"] = [{"name": "weather", "choices": ["calm", "windy"], "default_choice": "calm"}]
    (OUT / VARIANTS).write_text(json.dumps(data))
    spec = kept_spec(variant, OUT)
    assert spec is not None
    check_game(variant, spec, OUT)
    spec.options[0].default_choice = "windy"
    with pytest.raises(ConfigError, match=r'options.weather was "calm" and is now "windy"'):
        check_game(variant, spec, OUT)
    del spec.options[:]
    with pytest.raises(ConfigError, match=r'options.weather was "calm" and is now null'):
        check_game(variant, spec, OUT)


def test_a_page_of_some_variants_names_the_others_in_the_folder_for_which_no_p_value_is_corrected(copied):
    assert "Not on this page" not in page(copied)
    done = run_in(copied, "127.0.0.1:1", "--layouts", "hybrid")
    assert done.status == 0
    assert "**Not on this page, but trained in the same folder: bucket-3.** The p values are correct" in page(copied)
    assert run_in(copied, "127.0.0.1:1", "--seeds", "1").status == 0
    assert "in the same folder: bucket-3 with seed 1, hybrid with seed 1.** The p values" in page(copied)


@pytest.mark.no_cover  # see `whole`
def test_damaged_metrics_are_named_and_nothing_else_is_lost(whole, copied):
    damaged = OUT / "runs/hybrid-s1/metrics-archer.csv"
    damaged.write_text("timesteps,reward\n320,half\n")
    done = run_in(copied, "127.0.0.1:1")
    assert done.status == 1
    assert f"missing: hybrid-s1: {damaged} is no file of metrics" in done.errors
    assert "These runs are missing" in page(copied) and "1 to 2 runs" in page(copied)
    damaged.rename(copied / "away.csv")  # as the error says; the kept copy is whole
    assert run_in(copied, "127.0.0.1:1").status == 0
    assert_same(copied, whole)
    forget("hybrid-s1")
    done = run_in(copied, "127.0.0.1:1")
    assert "out/runs/hybrid-s1 has no metrics; delete this folder, and repeat the command" in done.errors


@pytest.mark.promise("S1")
def test_a_second_comparison_in_the_same_folder_is_refused_while_the_first_one_runs(copied):
    with locked(OUT):
        done = run_in(copied, "127.0.0.1:1")
    assert done.status == 1
    assert re.search(r"out is being trained by process \d+ .*; end that training, or .* with --output", done.errors)


def test_of_axes_and_buttons_the_buttons_count_and_of_several_behaviors_the_first_or_the_named_one(whole):
    (two,) = make_variants(["archer/hybrid"], ["layout=multiagent"], [])
    (one,) = make_variants(["archer/hybrid"], [], [])
    spec = kept_spec(one, whole / OUT)
    assert spec is not None
    del spec.behaviors[0].device.branches[0].choices[2:]  # it is a button now
    assert [scored_policy(variant, spec, None) for variant in (one, two)] == ["", "buttons"]
    spec.behaviors.add().CopyFrom(spec.behaviors[0])
    spec.behaviors[1].name = "other"
    assert scored_policy(one, spec, None) == "archer"
    assert scored_policy(two, spec, "other") == "other-buttons"


def test_only_runs_of_games_with_snapshots_are_resumed_and_go_on_after_a_loss(whole):
    (variant,) = make_variants(["archer/hybrid"], [], [])
    spec = kept_spec(variant, whole / OUT)
    assert spec is not None
    options = command.parse(["compare", "archer/hybrid", "--output", "out", "--game", "a:B"], "joybridge")
    job = make_job(variant, spec, 3, options)
    assert (job.exact, job.overrides, job.arguments) == (False, ("max_restarts=0",), ("--game", "a:B"))
    spec.snapshot_bytes_per_arena = 8
    job = make_job(variant, spec, 3, options)
    assert (job.exact, job.overrides, job.timesteps) == (True, (), 150_000)


def test_a_difference_in_bodies_that_the_layouts_bring_is_named_and_shared_body_ends_it(whole):
    spec = read_variants(whole / OUT)["hybrid"].spec

    def warning(layouts, *overrides):
        variants = make_variants(["archer/hybrid"], overrides, [("layout", layouts)])
        return different_bodies(variants, [spec for _ in variants])

    said = warning(["bucket-3", "hybrid", "beta", "ordinal-3"])
    assert "actor and critic have a body each in hybrid, beta; share one in bucket-3, ordinal-3." in said
    assert "With policy.shared_body=false behind the options" in said
    assert warning(["bucket-3", "ordinal-3"]) == warning(["hybrid", "beta"]) == ""
    assert warning(["bucket-3", "hybrid", "beta"], "policy.shared_body=false") == ""


def test_the_html_page_is_one_file_that_follows_the_theme(whole):
    html = (whole / OUT / "page.html").read_text()
    assert len(re.findall(r'(?:src|srcset)="data:image/png;base64,', html)) == 6
    assert not re.search(r'(?:src|srcset|href)="(?!data:|https://github.com)', html)
    assert "prefers-color-scheme: dark" in html and html.count("<table>") == 6
