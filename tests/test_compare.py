"""`joybridge compare`: what it trains, refuses and repeats, and what its page says. Runs train in this process."""

import csv
import io
import itertools
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from joybridge.compare import command, grid, launch
from joybridge.compare import page as pages
from joybridge.compare.analysis import SIGNIFICANCE, Analysis, analyze, least_seeds
from joybridge.compare.compare import held_out_analysis
from joybridge.compare.job import Job
from joybridge.compare.launch import check_metric, different_bodies, make_job, scored_policy
from joybridge.compare.made_with import changed_sources, note
from joybridge.compare.made_with import read as read_made_with
from joybridge.compare.names import ResultName
from joybridge.compare.page import page_text, write_page
from joybridge.compare.page_numbers import Setting, pairs_csv, pairs_tex, scores_tex
from joybridge.compare.page_parts import page_html
from joybridge.compare.page_settings import settings_block
from joybridge.compare.scores import Point, Run, score_run
from joybridge.compare.table import TABLE, add_results, read_table
from joybridge.compare.tested import SEED, check_test
from joybridge.compare.variants import (
    VARIANTS,
    Variant,
    beside,
    check_game,
    kept_spec,
    make_variants,
    pairs_to_test,
    read_change,
    read_values,
    read_variants,
)
from joybridge.config.config import Config
from joybridge.config.differences import differences
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import read_rows
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.run_lock import locked
from joybridge.v1 import bridge_pb2 as pb
from tests.support.command_line import Done, joybridge
from tests.support.jobs import train_here

pytestmark = pytest.mark.usefixtures("signals")

SMALL = """
game: archer
arenas: 8
pipeline_groups: 1
total_timesteps: 1280
log_interval: 320
policy: {frame_stack: 1, hidden_sizes: [16], rollout_steps: 20, time_horizon: 20, minibatch_size: 80}
"""
OUT = Path("out")
Compare = Callable[..., Done]


def run_in(folder: Path, simulator: str, *more: str, draw: bool = False) -> Done:
    """Compare two layouts with two seeds in a folder. draw: also draw the pictures, which takes a second."""
    with pytest.MonkeyPatch.context() as patch:
        if not draw:
            patch.setattr(pages, "draw_pictures", lambda *_: [])
        patch.chdir(folder)
        patch.setattr(launch, "start", train_here)
        patch.setattr(grid, "POLL_SECONDS", 0.0)  # they have ended when they are polled
        Path("small.yaml").write_text(SMALL)
        shared = ["--layouts", "hybrid", "bucket-3", "--seeds", "2", "--output", str(OUT), "--simulator", simulator]
        return joybridge("compare", "small.yaml", *shared, *more)


@pytest.fixture(scope="module")
def whole(simulator, tmp_path_factory) -> Path:
    """Return a folder with a comparison that was not interrupted.

    It reaches most lines of a comparison. Tests that repeat much of it are not measured, which takes twice the time.
    """
    folder = tmp_path_factory.mktemp("whole")
    done = run_in(folder, simulator, draw=True)
    assert done.status == 0, done.errors
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


# ------------------------------------------------------------------------------------------------- the whole command


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
    assert "--metric accuracy --score 0.25" in text.splitlines()[-2]
    unknown = run_in(copied, "127.0.0.1:1", "--metric", "acuracy")
    assert unknown.status == 1
    known = "archer has reward, length, hits, accuracy, reward_std, episodes; of the training: "
    assert f"--metric got 'acuracy'; {known}" in unknown.errors
    assert page(copied, "page-accuracy") == text  # the last page is still there


def test_the_page_says_that_the_variants_differ_in_their_networks(whole):
    said = "## What differs\n\nThe variants differ in their networks, too: actor and critic have a body each in hybrid;"
    assert said in page(whole)


def test_all_runs_play_a_test_whose_scores_have_a_page_of_their_own(whole, copied, simulator):
    more = "--test", "parameters.size=0.5", "--episodes", "6", "--deterministic"
    done = run_in(copied, simulator, *more)
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
    shutil.rmtree(OUT / "runs/hybrid-s0")
    lost = run_in(copied, simulator, *more)
    assert lost.status == 1 and "missing: hybrid-s0: out/runs/hybrid-s0 is not the folder of a run" in lost.errors
    shutil.rmtree(OUT / "runs")
    archived = run_in(copied, simulator, *more)
    assert archived.status == 1 and "a test needs the policies of the runs, and there is no folder" in archived.errors


def test_all_runs_play_under_each_value_of_a_setting_and_one_table_shows_all(whole, copied, simulator):
    done = run_in(copied, simulator, "--over", "parameters.size=0.5,1,2", "--episodes", "6")
    assert done.status == 0, done.errors
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
    assert f"pictures/scores{name}-light.png" in text and (OUT / f"pictures/scores{name}-dark.png").exists()
    assert (
        "--over parameters.size=0.5,1,2 --episodes 6" in text.splitlines()[-2] and "--test" not in text.splitlines()[-2]
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--test", "parameters.sise=2"], "--test got parameters.sise; archer has options.observation=screen, "),
        (["--over", "parameters.sise=1,2"], "--over got parameters.sise; archer has options.observation=screen, "),
        (["--over", "policy.gamma=0.5,1"], "--over got 'policy.gamma=0.5,1', expected options.NAME=CHOICE"),
        (["--test", "policy.gamma=0.5"], "policy belongs to the training of hybrid and cannot change now; what can is"),
        (
            ["--metric", "entropy", "--test"],
            "--test got --metric entropy; of its episodes it has reward, length, hits, ",
        ),
    ],
)
def test_a_test_that_no_run_could_play_is_refused_before_anything_is_trained(words, message, tmp_path, simulator):
    done = run_in(tmp_path, simulator, *words)
    assert done.status == 1 and message in done.errors and "done" not in done.output
    assert not (tmp_path / OUT / "runs").exists()


def test_what_another_trainer_has_trained_plays_no_test():
    (variant,) = make_variants(["archer/hybrid"], [], [])
    options = command.parse(["compare", "archer/hybrid", "--output", "x", "--test"], "joybridge")
    with pytest.raises(ConfigError, match="--test cannot play hybrid, SB3, of Stable-Baselines3; leave this variant"):
        check_test([Variant("hybrid, SB3", variant.config, "sb3")], [pb.GameSpec()], options)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--over", "hand.delay=0,2", "--over", "hand.reach=1,0.3"],
            "argument --over: it is given twice; give it once",
        ),
        (
            ["--deterministic"],
            "--episodes and --deterministic are for a test; say what is tested with --test or --over",
        ),
        (["--search", "policy.epochs=1..8", "--test"], "--test is for a comparison of one configuration; compare what"),
    ],
)
def test_options_of_a_test_are_for_a_comparison(words, message, capsys):
    with pytest.raises(SystemExit):
        command.parse(["compare", "archer/hybrid", "--output", "x", *words], "joybridge")
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["total_timesteps=160"],
            "log_interval is 320, longer than the runs of 160 timesteps, so they have no metrics;",
        ),
        (["--metric", "held_out_reward"], "hybrid measures nothing held out; set evaluate_during, as in evaluate_"),
        (
            ["--metric", "held_out_hit", "evaluate_during={episodes: 2}"],
            "--metric got 'held_out_hit'; archer has reward, length, hits, accuracy, reward_std, episodes; held_out_… "
            "before each of these; of the training: ",
        ),
    ],
)
def test_what_no_run_would_have_is_refused_before_anything_is_trained(words, message, tmp_path, simulator):
    done = run_in(tmp_path, simulator, *words)
    assert done.status == 1 and message in done.errors and "done" not in done.output
    assert not (tmp_path / OUT / "runs").exists()


def test_a_column_of_the_training_and_of_held_out_episodes_can_be_compared():
    (variant,) = make_variants(["archer/hybrid"], ["evaluate_during.episodes=2"], [])
    spec = pb.GameSpec(name="archer", behaviors=[pb.Behavior(name="archer", metrics=[pb.Metric(name="hits")])])
    for metric in ("hits", "entropy_fire", "explained_variance", "held_out_hits", "held_out_reward_std"):
        check_metric(variant, spec, metric, None)
    other = Variant("", variant.config, "sb3")  # it counts rewards and lengths alone
    for metric in ("hits", "explained_variance"):
        with pytest.raises(ConfigError, match=f"'{metric}'; a run of Stable-Baselines3 has reward, length"):
            check_metric(other, spec, metric, None)


def test_a_game_that_another_trainer_cannot_train_is_refused_at_once_with_the_next_move(tmp_path):
    done = run_in(tmp_path, "127.0.0.1:1", "--beside", "sb3", "--wait", "0.1")
    assert done.status == 1 and "waiting" not in done.errors
    assert "there is none called 'archer'; to train this game with Stable-Baselines3, write a program" in done.errors
    assert beside([Variant("a", Config(game="CartPole-v1", preset="sb3"))], "sb3")[0].label == "a, Stable-Baselines3"


def test_files_of_the_same_name_are_told_apart_by_their_folders(tmp_path):
    for folder, layout in (("a/x", "hybrid"), ("b/x", "bucket-3"), ("c", "bucket-5")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "best.yaml").write_text(SMALL + f"layout: {layout}\n")
    paths = [str(tmp_path / path) for path in ("a/x/best.yaml", "b/x/best.yaml", "c/best.yaml")]
    made = make_variants([*paths, "archer/hybrid"], [], [])
    assert [variant.label for variant in made] == ["a/x/best", "b/x/best", "c/best", "hybrid"]
    assert [variant.name for variant in made] == ["a_x_best", "b_x_best", "c_best", "hybrid"]
    with pytest.raises(ConfigError, match="have the same configuration; leave one of them out"):
        make_variants([paths[0], paths[0]], [], [])


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


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--set", "layout=hybrid,auto"], "layout is set twice; set it once, with all of its values"),
        (["--set", "policy.epochs=1,1"], "--set got 'policy.epochs=1,1', which names a value twice"),
        (["--set", "policy.epochs="], "expected KEY=VALUE,VALUE,… as in policy.gamma=0.9,0.99"),
        (["--set", "policy.gamma=0.9,0.90"], "'hybrid, gamma=0.9' and 'hybrid, gamma=0.90' have the same config"),
        (["--set", "seed=1,2"], "--set seed=…: seed does not vary here; use --seeds"),
        (["--set", "game=archer,orchard"], "use a comparison for each game"),
        (["--change", "policy.epochs=1,2"], "expected KEY=VALUE, or several that are set together"),
        (["--change", "layout=bucket-3"], "--change layout=…: layout is set twice; set it once"),
        (["--change", "seed=1"], "--change seed=…: seed does not vary here; use --seeds"),
        (["seed=7"], "seed=…: seeds are counted from 0; use --seeds for their number"),
        (["epocs=7"], "unknown key 'epocs'; did you mean 'policy.epochs'?"),
    ],
)
def test_a_wrong_grid_is_refused_before_a_simulator_is_waited_for(more, message, tmp_path):
    done = run_in(tmp_path, "127.0.0.1:1", *more)
    assert done.status == 1 and message in done.errors and "waiting" not in done.errors
    assert not (tmp_path / OUT).exists()


def test_a_layout_that_cannot_play_the_game_is_refused_before_anything_is_trained(tmp_path, simulator):
    done = run_in(tmp_path, simulator, "--layouts", "hybrid", "joint-9999")
    assert done.status == 1
    assert "joint-9999: layout: 'joint-9999' cannot express this device: " in done.errors
    done = run_in(tmp_path, simulator, "policy.sensors=[gnu]")
    assert done.status == 1 and "hybrid: archer: sensors: the game has no 'gnu'" in done.errors
    assert not (tmp_path / OUT).exists()
    done = run_in(tmp_path, simulator, "--behavior", "archers")
    assert done.status == 1 and "--behavior got 'archers'; archer has archer" in done.errors


# ---------------------------------------------------------------------------------------------------------- variants


def test_values_may_be_lists_and_variants_are_named_after_what_differs(tmp_path):
    (tmp_path / "small.yaml").write_text(SMALL)
    sizes = read_values("policy.hidden_sizes=[8, 8], [16]")
    assert sizes == ("policy.hidden_sizes", ["[8, 8]", "[16]"])
    made = make_variants([str(tmp_path / "small.yaml")], ["arenas=4"], [("layout", ["bucket-3", "hybrid"]), sizes])
    assert [variant.label for variant in made[:2]] == ["bucket-3, hidden_sizes=[8, 8]", "bucket-3, hidden_sizes=[16]"]
    assert [variant.name for variant in made[2:]] == ["hybrid-hidden_sizes=_8-8", "hybrid-hidden_sizes=_16"]
    assert made[3].config.layout == "hybrid" and made[3].config.policy.hidden_sizes == [16]
    assert {variant.config.arenas for variant in made} == {4}
    (alone,) = make_variants([str(tmp_path / "small.yaml")], [], [])
    assert alone.label == "hybrid"


def test_changes_are_compared_one_at_a_time_with_what_is_unchanged(tmp_path):
    (tmp_path / "small.yaml").write_text(SMALL)
    changes = [read_change("layout=bucket-3"), read_change("policy.epochs=2 policy.hidden_sizes=[8,16]")]
    made = make_variants([str(tmp_path / "small.yaml")], [], [], changes)
    assert [variant.label for variant in made] == ["unchanged", "bucket-3", "epochs=2, hidden_sizes=[8,16]"]
    before = made[0].config.model_dump()
    pairs = [("policy.memory", "{kind: gru, size: 32}"), ("arenas", "2")]
    assert read_change(" policy.memory={kind: gru, size: 32}  arenas=2 ") == ("", pairs)
    assert read_change("with memory:  policy.memory={kind: gru, size: 32} arenas=2") == ("with memory", pairs)
    changed = [[key for key, *_ in differences(before, variant.config.model_dump())] for variant in made]
    assert changed == [[], ["layout"], ["policy.hidden_sizes", "policy.epochs"]]
    both = make_variants([str(tmp_path / "small.yaml")], [], [("policy.gamma", ["0.9", "0.99"])], changes[:1])
    assert [each.label for each in both] == ["gamma=0.9", "gamma=0.9, bucket-3", "gamma=0.99", "gamma=0.99, bucket-3"]
    far = read_change("far: policy.gamma=0.999 policy.epochs=2")
    (_, named) = make_variants([str(tmp_path / "small.yaml")], [], [], [far])
    assert (named.label, named.config.policy.gamma, named.config.policy.epochs) == ("far", 0.999, 2)
    with pytest.raises(ConfigError, match="--change got 'far: ', expected KEY=VALUE, "):
        read_change("far: ")


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


def test_layouts_may_be_mixtures_and_overrides_may_stand_behind_them():
    words = [
        "compare",
        "x.yaml",
        "--layouts",
        "hybrid",
        "bucket-3, direction=hybrid",
        "arenas=4",
        "--output",
        "y",
        "seed=1",
    ]
    options = command.parse(words, "joybridge")
    assert options.layouts == ["hybrid", "bucket-3, direction=hybrid"]
    assert sorted(options.overrides) == ["arenas=4", "seed=1"]
    suite = ["compare", "--suite", "hybrid", "--output", "y", "--tasks", "goal", "moving", "arenas=4"]
    options = command.parse(suite, "joybridge")
    assert (options.tasks, options.overrides) == (["goal", "moving"], ["arenas=4"])


def test_a_page_says_what_differs_but_not_layouts_alone():
    layouts = make_variants(["archer/hybrid"], [], [("layout", ["hybrid", "bucket-3"])])
    assert settings_block(layouts, []) == ""
    tuned = make_variants(["archer/hybrid"], [], [("layout", ["hybrid"]), ("policy.epochs", ["2", "3"])])
    block = settings_block(tuned, [])
    assert block == "## What differs\n\n| key | hybrid, epochs=2 | hybrid, epochs=3 |\n| --- | --- | --- |\n" + (
        "| `policy.epochs` | 2 | 3 |"
    )


def test_differences_name_the_innermost_key():
    before, now = {"a": {"b": [1, 2]}, "c": 3}, {"a": {"b": [1, 4]}, "d": 5}
    assert list(differences(before, now)) == [("a.b.1", 2, 4), ("c", 3, None), ("d", None, 5)]


# ------------------------------------------------------------------------------------------------ scores and the page


def runs(*values: list[float]) -> list[Run]:
    """Return runs with rows of metrics every 100 timesteps, one per second."""
    return [
        Run(seed, tuple(Point(100 * i, float(i), value) for i, value in enumerate(each, 1)))
        for seed, each in enumerate(values)
    ]


def setting_of(analysis: Analysis, missing: list[str]) -> Setting:
    return Setting("a game", [1000], {result.label: "" for result in analysis.results}, "joybridge …", missing)


def text_of(analysis: Analysis) -> str:
    return page_text(analysis, setting_of(analysis, []))


def test_the_score_of_a_run_is_the_mean_of_its_last_tenth_rounded_up():
    assert runs([0.0] * 9 + [4.0])[0].score == 4.0
    assert runs([0.0] * 9 + [4.0, 6.0])[0].score == 5.0
    assert runs([3.0])[0].score == 3.0


def test_rows_without_the_metric_are_left_out_and_others_must_be_finite(tmp_path):
    path = tmp_path / "run-s0.csv"

    def read() -> Run:
        return score_run(read_rows(path), path.name, 7, "reward")

    path.write_text("timesteps,seconds,reward\n100,1,\n200,2,0.5\n300,3,1.5\n")
    assert read() == Run(7, (Point(200, 2.0, 0.5), Point(300, 3.0, 1.5)))
    path.write_text("timesteps,reward\n100,nan\n")
    with pytest.raises(CheckpointError, match=r"run-s0.csv: reward is nan after 100 timesteps, expected a finite"):
        read()
    path.write_text("timesteps,length\n100,\n")
    with pytest.raises(ConfigError, match="has no reward: no episode ended; lengthen the runs"):
        read()


def test_what_was_measured_at_the_end_is_the_score_and_the_curve_is_that_of_the_training(tmp_path):
    path = tmp_path / "run-s0.csv"
    path.write_text("timesteps,seconds,reward,held_out_reward\n100,1,2,\n200,2,4,9\n")
    found = score_run(read_rows(path), path.name, 7, "held_out_reward")
    assert (found.score, found.points) == (9.0, (Point(100, 1.0, 2.0), Point(200, 2.0, 4.0)))
    path.write_text("timesteps,seconds,reward,held_out_reward\n100,1,2,7\n200,2,4,9\n")
    assert score_run(read_rows(path), path.name, 7, "held_out_reward").points == (Point(100, 1, 7), Point(200, 2, 9))
    path.write_text("timesteps,seconds,reward,held_out_reward\n100,1,2,\n200,2,4,nan\n")
    with pytest.raises(CheckpointError, match="held_out_reward is nan at the end, expected a finite"):
        score_run(read_rows(path), path.name, 7, "held_out_reward")


def test_the_time_to_a_score_is_a_median_to_which_unsuccessful_runs_count():
    three = runs([1, 5, 5], [1, 1, 5], [1, 1, 1])
    analysis = analyze("reward", {"three": three, "none": runs([0, 0], [0, 1])}, 5.0)
    text = text_of(analysis)
    assert "| three | 2 | 1 | 300 | 200 to 300 |" in text
    assert "| none | 0 | 2 | not reached |  |" in text
    assert "| three | 3 | 3 |" in text  # seconds


def test_clear_differences_are_said_and_too_few_runs_are_warned_of():
    good, bad = [[10.0 + i] for i in range(5)], [[0.0 + i] for i in range(5)]
    text = text_of(analyze("reward", {"good": runs(*good), "bad": runs(*bad)}))
    assert "- good (IQM 12) is better than bad (2), p = 0.0079." in text  # 2 of the 252 ways to choose 5 ranks of 10
    assert "| good |  | **100 % (all)** |" in text and "| bad | **0.0079** |  |" in text
    assert "Too few runs" not in text and "| **good** | 5 |" in text
    alike = text_of(analyze("reward", {"a": runs(*good), "b": runs(*[[value + 0.5] for (value,) in good])}))
    assert "Too few runs" not in alike and "| b | 5 |" in alike  # the higher one, by chance
    text = text_of(analyze("reward", {"good": runs(*good[:3]), "bad": runs(*bad[:3])}))
    assert "No two variants differ significantly." in text and "the same score" not in text
    warning = (
        "**Too few runs for a significance test**: the smallest p value that is possible with them is 0.1. Repeat the"
    )
    assert f"{warning} command with `--seeds 4` or more; finished runs are kept." in text
    tied = text_of(analyze("reward", {"good": runs([2.0], [2.0], [2.0]), "bad": runs([1.0], [1.0], [1.0])}))
    assert warning in tied and "No two variants differ significantly." in tied
    assert least_seeds(36) == 7  # nine variants: the smallest p value is then 36 x 2 / 3432 = 0.021, with 6 seeds 0.078


def test_a_score_that_follows_from_the_runs_is_said_to_and_one_that_was_named_is_not():
    scores = {"a": runs([1, 5]), "b": runs([1, 4])}
    text = text_of(analyze("reward", scores))
    assert "## Timesteps to a score of 4" in text and "**This score was chosen from these runs**" in text
    assert "no measurement to report. Name a score that you chose before the runs with `--score`." in text
    assert "chosen from these runs" not in text_of(analyze("reward", scores, 4.0))


def test_effect_sizes_with_intervals_are_on_the_page_and_in_a_table():
    good, bad = [10.0, 11.0, 12.0, 13.0], [0.0, 1.0, 2.0, 5.0]
    analysis = analyze("reward", {"good": runs(*([each] for each in good)), "bad": runs(*([each] for each in bad))})
    assert pairs_csv(analysis).splitlines()[1].split(",")[5:8] == ["1.0", "", ""]  # as on the page
    (line,) = csv.DictReader(io.StringIO(pairs_csv(analysis)))
    assert (line["first"], line["second"], float(line["difference"])) == ("good", "bad", 10.0)  # of 11.5 and 1.5
    # The same, from all 35 x 35 different pairs of samples that a bootstrap can draw, each as likely as it is.
    drawn = [[sorted(each)[1:3] for each in itertools.product(values, repeat=4)] for values in (good, bad)]
    middle, other = (np.array([sum(pair) / 2 for pair in each]) for each in drawn)
    exact = np.percentile(middle[:, None] - other[None, :], [2.5, 97.5])
    assert [float(line["difference_low"]), float(line["difference_high"])] == pytest.approx(exact, abs=0.5)
    low, high = (f"{float(line[f'difference_{end}']):.4g}" for end in ("low", "high"))
    text = text_of(analysis)
    assert "The effect size: the IQM of the row minus that of the column" in text
    assert f"| good |  | 10 [{low}, {high}] |" in text and f"| bad | -10 [-{high}, -{low}] |  |" in text
    alone = analyze("reward", {"good": runs([2.0]), "bad": runs([1.0])})
    assert "| good |  | 1 |" in text_of(alone) and "\ngood,bad,1.0,,,1.0,,,1.0,1.0\n" in pairs_csv(alone)


def test_tables_for_a_paper_mean_nothing_else_to_latex():
    rows = {"a_b, 5%": runs([-2.0], [-1.0]), "bucket-11 {x}": runs([1.0], [2.0])}
    analysis = analyze("reward", rows)
    scores, pairs = scores_tex(analysis), pairs_tex(analysis)
    assert r"a\_b, 5\% & 2 & $-$1.5 [$-$2, $-$1] & $-$1.5 $\pm$ 0.7071 & $-$1.5 \\" in scores
    assert r"bucket-11 \{x\} & 2 & 1.5 [1, 2] &" in scores
    assert r"a\_b, 5\% -- bucket-11 \{x\} & $-$3 [$-$4, $-$2] & 0 & 0.33 \\" in pairs
    for text in (scores, pairs):
        body = text.split(r"\midrule")[1].split(r"\bottomrule")[0].strip().splitlines()
        heads = text.split(r"\toprule")[1].split(r"\midrule")[0]
        assert {line.count(" & ") for line in [*body, heads]} == {heads.count(" & ")}
        assert text.count("{") == text.count("}")


@pytest.mark.parametrize(("variants", "seeds"), [(1, 1), (2, 4), (3, 5)])
def test_so_many_seeds_are_needed_for_a_significant_difference(variants, seeds):
    pairs = variants * (variants - 1) // 2

    def smallest(seeds):
        apart = {f"{i}": runs(*([100.0 * i + j] for j in range(seeds))) for i in range(variants)}
        return min((pair.corrected for pair in analyze("reward", apart).pairs), default=0.0)

    assert least_seeds(pairs) == seeds
    assert smallest(seeds) < SIGNIFICANCE and (variants == 1 or smallest(seeds - 1) >= SIGNIFICANCE)


def test_a_game_whose_file_changes_between_runs_is_named_on_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("reach_game.py").write_text("REACH = 0.1")
    Path("program.py").write_text("import pygame")
    Path("my hook.py").write_text("")
    games, config = (
        ["reach_game:Reach", "pygame:program.py keys=LEFT 'hook=my hook.py'", "gym:CartPole-v1"],
        Config(game="reach"),
    )
    out = tmp_path / "out"
    out.mkdir()
    for _ in range(2):
        note(out, games, [config])
    (first,) = read_made_with(out)
    assert first.versions["torch"] and first.versions["joybridge"].startswith("0.1.0")
    assert list(first.sources) == ["my hook.py", "program.py", "reach_game"] and not changed_sources([first])
    Path("reach_game.py").write_text("REACH = 0.3")
    note(out, games, [config])
    assert changed_sources(read_made_with(out)) == ["reach_game"]
    setting = Setting("reach", [1], {"a": ""}, "joybridge compare", [], made_with=read_made_with(out))
    text = page_text(analyze("reward", {"a": runs([1.0])}), setting)
    assert "**The files of reach_game have changed between runs.**" in text.replace("\\", "")
    assert text.count("\n- python 3") == 2
    (out / "made_with.json").write_text("{")
    with pytest.raises(ConfigError, match=r"made_with\.json cannot be read .*; delete it, it is only for people"):
        read_made_with(out)


def test_pairs_that_differ_in_one_named_key_alone_are_tested():
    grid = [("layout", ["hybrid", "bucket-3"]), ("hand.delay", ["0", "2"])]
    variants = make_variants(["archer/hybrid"], [], grid)
    one, late, two, late_two = (variant.label for variant in variants)
    assert len(pairs_to_test(variants, [])) == 6
    assert pairs_to_test(variants, ["layout"]) == [(one, two), (late, late_two)]
    assert pairs_to_test(variants, ["hand"]) == [(one, late), (two, late_two)]
    assert len(pairs_to_test(variants, ["layout", "hand.delay"])) == 4
    with pytest.raises(ConfigError, match=r"--pairs seed: no two .* it alone; variants differ in hand\.delay, layout"):
        pairs_to_test(variants, ["seed"])
    scores = {variant.label: runs(*([10.0 * at + i] for i in range(5))) for at, variant in enumerate(variants)}
    analysis = analyze("reward", scores, tested=pairs_to_test(variants, ["layout"]))
    assert [pair.corrected for pair in analysis.pairs] == [2 * pair.p_value for pair in analysis.pairs]
    text = text_of(analysis)
    assert "2 of 6 pairs are tested: those that differ in one of the keys alone that `--pairs` names." in text
    del scores[two]
    assert [pair.first for pair in analyze("reward", scores, tested=pairs_to_test(variants, ["layout"])).pairs] == [
        late
    ]


def test_nothing_is_bold_if_no_difference_can_be_significant():
    scores = {"good": runs([10.0], [11.0]), "bad": runs([0.0], [1.0])}
    text = text_of(analyze("reward", scores))
    assert "| good |  | 100 % (all) |" in text and "| good | 2 | 10.5 [10, 11] |" in text
    assert "Nothing is bold: with so few runs the smallest p value that is possible is 0.33," in text
    assert "**Bold**" not in text and "**100" not in text and "**good**" not in text
    three = {name: runs(*([score + i] for i in range(4))) for name, score in (("a", 0.0), ("b", 10.0), ("c", 20.0))}
    text = text_of(analyze("reward", three))  # four runs are enough for one pair, but not for three
    assert "possible is 0.086," in text and "| a |  | 0 % (none) | 0 % (none) |" in text
    del three["c"]
    assert "| a |  | **0 % (none)** |" in text_of(analyze("reward", three))


def test_three_runs_have_a_mean_and_fewer_than_ten_are_said_to_have_narrow_intervals():
    three = text_of(analyze("reward", {"a": runs([1.0], [2.0], [3.0])}))
    assert "| variant | runs | mean | mean ± sd |" in three and "IQM" not in three and "interquartile" not in three
    assert "(dots), mean (line)" in three and "these are too narrow: in a simulation" in three
    ten = text_of(analyze("reward", {"a": runs(*([float(i)] for i in range(10)))}))
    assert "| variant | runs | IQM |" in ten and "(dots), IQM (line)" in ten and "too narrow" not in ten


def test_the_page_says_how_many_held_out_episodes_are_behind_a_score():
    def text(rows):
        run = score_run(rows, "x", 0, "held_out_reward")
        return text_of(analyze("held_out_reward", {"a": [run, run]}))

    last = {"timesteps": 200.0, "reward": 2.0, "held_out_reward": 3.0, "held_out_episodes": 1500.0}
    assert "of the 1,500 episodes that its policy plays at the end" in text([{"timesteps": 100.0, "reward": 1.0}, last])
    between = {"timesteps": 100.0, "held_out_reward": 1.0, "held_out_episodes": 1500.0}
    assert "of its rows of metrics that have it, each of 1,500 episodes" in text([between, last])


def test_the_page_says_how_many_episodes_of_the_training_are_behind_a_score():
    def text(*counts, **measured):
        rows = [{"timesteps": 100.0 * i, "reward": 1.0, "episodes": 50.0} for i in range(1, 20)]
        several = [
            score_run([*rows, {"timesteps": 2000.0, "reward": 2.0, "episodes": each}], "x", 0, "reward")
            for each in counts
        ]
        return text_of(analyze("reward", {"a": [replace(run, **measured) for run in several]}))

    assert "the last tenth of its rows of metrics, in which 51 to 90 episodes end; higher" in text(1.0, 40.0)
    assert "rests on" not in text(1.0, 40.0)
    rows = [{"timesteps": 100.0, "reward": 1.0, "episodes": 1.0}]
    few = text_of(analyze("reward", {"a": [score_run(rows, "x", 0, "reward")]}))
    assert "in which 1 episode ends; higher" in few and "**A score rests on 1 episode.**" in few and "`--test`" in few
    assert "rests on" not in text(1.0, measured=3.0, episodes=5)


@pytest.mark.parametrize("every", [True, False])
def test_the_page_of_the_training_shows_what_was_held_out_as_a_second_curve(every, tmp_path):
    rows = [
        {"timesteps": 100.0 * i, "reward": i, "held_out_reward": 2.0 * i, "held_out_episodes": 60.0} for i in (1.0, 2.0)
    ]
    if not every:
        del rows[0]["held_out_reward"]
    job = Job("a", 0, 200, tmp_path, tmp_path)
    options = command.parse(["compare", "x", "--output", str(tmp_path)], "joybridge")
    cells = [{name: f"{value}" for name, value in row.items()} for row in rows]
    kept = {ResultName(job.name, 200): cells}
    held_out = held_out_analysis({job: "a"}, {"a": ""}, kept, options)
    assert held_out is not None and held_out.results[0].scores == [4.0]
    analysis = analyze("reward", {"a": [score_run(rows, "x", 0, "reward")]})
    write_page(analysis, replace(setting_of(analysis, []), held_out=held_out), tmp_path)
    text = (tmp_path / "page.md").read_text()
    assert "The same runs in the 60 held-out episodes of `evaluate_during`, from which nothing is learned" in text
    assert "| a | 1 | 2 |" in text.replace("**", "") and "| a | 1 | 4 |" in text.replace("**", "")
    assert ("pictures/held_out-light.png" in text) == (tmp_path / "pictures/held_out-light.png").exists() == every
    plain = {name: [{"timesteps": "100", "reward": "1"}] for name in kept}
    assert held_out_analysis({job: "a"}, {"a": ""}, plain, options) is None


def test_the_page_names_a_run_in_the_middle_and_the_best_one():
    text = text_of(analyze("reward", {"a": runs([1.0], [5.0], [3.0]), "b*": runs([4.0])}))
    assert "in the middle and of the best one: a, 2 and 1; b\\*, 0 and 0." in text


def test_variants_that_play_the_same_are_named():
    text = text_of(analyze("reward", {"hybrid": runs([1.0], [2.0]), "x": runs([1.0]), "y": runs([1.0], [2.0])}))
    assert "**hybrid and y have the same score with every seed.**" in text and text.count("the same score") == 1


def test_one_variant_has_a_page_without_comparisons():
    text = text_of(analyze("reward", {"alone": runs([1.0, 2.0])}))
    assert "Which variant is better" not in text and "| alone | 1 | 2 | 2 ± 0 | 2 | 2 to 2 |" in text


def test_the_html_page_is_one_file_that_follows_the_theme(whole):
    html = (whole / OUT / "page.html").read_text()
    assert len(re.findall(r'(?:src|srcset)="data:image/png;base64,', html)) == 6
    assert not re.search(r'(?:src|srcset|href)="(?!data:|https://github.com)', html)
    assert "prefers-color-scheme: dark" in html and html.count("<table>") == 6


def test_names_mean_nothing_to_markdown_and_html(tmp_path):
    analysis = analyze("reward", {"a|<b>*$": runs([1.0], [2.0]), "c": runs([1.5])})
    html = page_html(page_text(analysis, setting_of(analysis, ["x: <i>"])), tmp_path)
    assert "<strong>a|&lt;b&gt;*$</strong>" in html or "<td>a|&lt;b&gt;*$</td>" in html
    assert "<li>x: &lt;i&gt;</li>" in html and html.count("<table>") == 6
