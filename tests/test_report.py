"""The report about the paper: which results it reads, how claims are judged, and what it writes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from PIL import Image

from joybridge.compare import ResultName, RunName, add_results
from tools.paper.claims import COMPARISONS, Behavior, Judged, judge_claims, judge_logs
from tools.paper.original import original_curve, original_ends, original_point, paper_figures
from tools.paper.page import BEGIN, CAPTIONS, README, RESULTS, page_text, readme_text, write_report
from tools.paper.runs import (
    COMPLETE,
    MARK,
    Experiment,
    Results,
    Run,
    main_policy,
    read_results,
)
from tools.paper.statistics import (
    FAILS,
    HOLDS,
    UNDECIDED,
    UNTESTED,
)
from tools.paper.tables import agreement, last_ten

pytestmark = pytest.mark.no_cover  # of tools, which are not measured

EARLY = 10 * MARK  # 3 M


def write_run(folder: Path, name: str, rewards: Sequence[float], policy: str = "", **more: float) -> None:
    """Write the metrics of a run: a reward per mark, and other figures that never change."""
    columns = {"episodes": 150.0, "length": 1000.0, "click_accuracy": 0.9, "timesteps_per_second": 30_000.0} | more
    rows = [
        {"timesteps": f"{number * MARK + 24:.6g}", "reward": f"{reward}", **{key: f"{columns[key]}" for key in columns}}
        for number, reward in enumerate(rewards, 1)
    ]
    add_results(folder, {ResultName(RunName.parse(name), len(rewards) * MARK, policy): rows})


def made_up(game: str, rewards: Mapping[str, Sequence[float]], mark: int = COMPLETE, **more: float) -> Results:
    """Return results with a row at one mark only. rewards: by layout, one per run."""
    results = {}
    for layout, values in rewards.items():
        key = (game, layout, "buttons" if layout == "multiagent" else "")
        figures = {"click_accuracy": 0.9, "timesteps_per_second": 30_000.0} | more
        runs = [Run(seed, {mark: {"reward": value, **figures}}) for seed, value in enumerate(values)]
        results[key] = Experiment(*key, tuple(runs), tuple(runs))
    return results


def judge(text: str, game: str, results: Results, behavior: Behavior | None = None) -> Judged:
    """Return the claim of a game that begins with a text, judged."""
    judged = judge_claims(results, behavior or {})
    (found,) = [claim for claim in judged if claim.text.startswith(text) and claim.game == game]
    return found


# What is read


def test_of_several_lengths_of_one_run_the_longest_counts(tmp_path):
    write_run(tmp_path, "shooting_birds/bucket-11-s0", [2.0] * 5)
    write_run(tmp_path, "shooting_birds/bucket-11-s0", [2.0] * 10)
    write_run(tmp_path, "shooting_birds/bucket-11-s1", [4.0] * 5)
    experiment = read_results(tmp_path)["shooting_birds", "bucket-11", ""]
    assert [(run.seed, run.end) for run in experiment.runs] == [(0, 10 * MARK), (1, 5 * MARK)]
    assert experiment.at(5 * MARK) == [2.0, 4.0]
    assert experiment.at(6 * MARK) == [2.0]
    assert experiment.at(11 * MARK) == []


def test_a_seed_is_one_run_however_often_it_was_started(tmp_path):
    write_run(tmp_path, "beastly_rivals/hybrid-s0", [1.0] * 100)
    write_run(tmp_path, "beastly_rivals/hybrid-s0", [3.0] * 10)
    experiment = read_results(tmp_path)["beastly_rivals", "hybrid", ""]
    assert experiment.at(10 * MARK) == [2.0] and experiment.at(11 * MARK) == [1.0]
    assert [run.end for run in experiment.complete] == [COMPLETE]


def test_the_two_agents_are_told_apart_and_rounded_timesteps_find_their_mark(tmp_path):
    write_run(tmp_path, "beastly_rivals/multiagent-s3", [float(n) for n in range(1, 101)], "axes")
    write_run(tmp_path, "beastly_rivals/multiagent-s3", [5.0] * 100, "buttons")
    results = read_results(tmp_path)
    assert list(results) == [("beastly_rivals", "multiagent", policy) for policy in ("axes", "buttons")]
    axes = results["beastly_rivals", "multiagent", "axes"]
    assert axes.at(COMPLETE) == [100.0]
    assert axes.at(99 * MARK) == [99.0]
    assert last_ten(axes.runs[0]) == 95.5
    assert axes.runs[0].hours == pytest.approx(COMPLETE / 30_000 / 3600)


def test_runs_alone_count_for_speed_and_for_nothing_else(tmp_path):
    write_run(tmp_path, "beastly_rivals/multiagent-s0", [1.0] * 10, "axes")
    write_run(tmp_path / "alone", "beastly_rivals/multiagent-s0", [2.0] * 2, "axes", timesteps_per_second=40_000)
    write_run(tmp_path / "alone", "beastly_rivals/hybrid-s0", [2.0] * 2)
    ((key, axes),) = read_results(tmp_path).items()
    assert key == ("beastly_rivals", "multiagent", "axes")
    assert [run.end for run in axes.runs] == [10 * MARK]
    assert [run.complete_hours for run in axes.alone] == [pytest.approx(COMPLETE / 40_000 / 3600)]


def test_the_originals_figures_are_there_for_every_experiment_of_the_paper():
    for game in ("shooting_birds", "beastly_rivals"):
        for layout in ("bucket-3", "bucket-11", "bucket-41", "threshold-0.0", "threshold-0.1", "threshold-0.5"):
            ends = original_ends(game, layout)
            assert ends is not None
            twice = (game, layout) == ("beastly_rivals", "bucket-11")  # two of its ten logs are of one run
            assert len(ends.reward) == len(ends.hours) == 10 - twice
            end = original_point(game, layout, "", COMPLETE)
            assert end is not None
            total = sum(ends.reward) + (ends.reward[0] if twice else 0.0)
            assert total / 10 == pytest.approx(end.reward, abs=0.01) and end.runs == len(ends.reward)
            assert len(original_curve(game, layout)) == 28
            assert "hours" in paper_figures(game, layout)
    assert original_ends("shooting_birds", "hybrid") is None
    assert original_ends("shooting_birds", "multiagent", "axes") != original_ends(
        "shooting_birds", "multiagent", "buttons"
    )


# How rules decide


# How claims are judged

BIRDS, RIVALS = "shooting_birds", "beastly_rivals"
WINS = "The bucket approach scores higher than the threshold"
AGENTS = "The two agents score higher"
BEST = "Threshold 0.0 is the best"


def of(best: float, others: tuple[float, float]) -> dict[str, list[float]]:
    """Return a reward of each threshold."""
    return {
        f"threshold-{value}": [reward] for value, reward in zip(("0.0", "0.1", "0.5"), (best, *others), strict=True)
    }


@pytest.mark.parametrize(
    ("text", "game", "mark", "rewards", "verdict", "evidence"),
    [
        (WINS, BIRDS, COMPLETE, {"bucket-11": [137.0], "threshold-0.0": [114.0]}, (HOLDS, "at 30 M"),
         "bucket-11 137.0 (1), threshold-0.0 114.0 (1)"),
        (WINS, BIRDS, COMPLETE, {"bucket-11": [115.0], "threshold-0.0": [114.0]}, (UNDECIDED, "at 30 M"),
         "the original bucket-11 137.6 ± 2.8 (10)"),
        (WINS, BIRDS, COMPLETE, {"bucket-11": [100.0], "threshold-0.0": [114.0]}, (FAILS, "at 30 M"), ""),
        # Short runs decide what the original shows as early, and nothing that it shows only later, or loses again.
        (WINS, BIRDS, EARLY, {"bucket-11": [200.0], "threshold-0.0": [10.0]}, (UNTESTED, ""), "needs longer runs"),
        (BEST, BIRDS, EARLY, of(65.0, (20.0, 15.0)), (HOLDS, "at 3 M"), ""),
        (BEST, BIRDS, EARLY, of(30.0, (20.0, 15.0)), (UNDECIDED, "at 3 M"), ""),
        (BEST, BIRDS, EARLY, of(-40.0, (20.0, 15.0)), (FAILS, "at 3 M"), ""),
        (BEST, RIVALS, EARLY, of(80.0, (35.0, 35.0)), (UNTESTED, ""), "needs longer runs"),
        (WINS, BIRDS, COMPLETE, {"bucket-11": [100.0]}, (UNTESTED, ""), "needs runs of threshold-0.0"),
        # A single run has the standard deviation of the original's.
        (AGENTS, RIVALS, COMPLETE, {"multiagent": [105.0], "threshold-0.0": [100.0]}, (UNDECIDED, "at 30 M"), ""),
        (AGENTS, RIVALS, COMPLETE, {"multiagent": [105.0] * 10, "threshold-0.0": [100.0] * 10}, (HOLDS, "at 30 M"), ""),
    ],
)  # fmt: skip
def test_scores_decide_where_the_runs_are_long_enough(text, game, mark, rewards, verdict, evidence):
    here = judge(text, game, made_up(game, rewards, mark)).here
    assert (here.word, here.where) == verdict and evidence in here.evidence


@pytest.mark.parametrize(
    ("bucket", "threshold", "word"), [(1.0, 20.0, HOLDS), (5.0, 5.0, UNDECIDED), (20.0, 1.0, FAILS)]
)
def test_stability_needs_several_runs_and_compares_their_variances(bucket, threshold, word):
    claim = ("The bucket approach is more stable", "shooting_birds")
    names = {f"bucket-{values}": bucket for values in (11, 3, 41)} | {
        f"threshold-{value}": threshold for value in ("0.0", "0.1", "0.5")
    }
    several = {layout: [100 - scatter, 100.0, 100 + scatter] for layout, scatter in names.items()}
    assert judge(*claim, made_up("shooting_birds", several)).here.word == word
    single = {layout: values[:1] for layout, values in several.items()}
    verdict = judge(*claim, made_up("shooting_birds", single)).here
    assert verdict.word == UNTESTED
    assert "at least 2 runs of bucket-11, bucket-3" in verdict.evidence


@pytest.mark.parametrize(
    ("text", "exact", "others", "accuracy", "word"),
    [
        ("Bucket and the two agents click more", ("bucket-11", "multiagent"), ("threshold-0.0",), 0.95, HOLDS),
        ("Bucket and the two agents click more", ("bucket-11", "multiagent"), ("threshold-0.0",), 0.985, FAILS),
        ("Bucket and the two agents click more", ("bucket-11", "multiagent"), (), 0.0, UNTESTED),
        ("3 and 41 values per axis click", ("bucket-11",), ("bucket-3", "bucket-41"), 0.985, HOLDS),
        ("3 and 41 values per axis click", ("bucket-11",), ("bucket-3", "bucket-41"), 0.9, FAILS),
    ],
)
def test_click_accuracies_differ_by_more_than_one_point(text, exact, others, accuracy, word):
    results = made_up(BIRDS, dict.fromkeys(exact, (130.0,)), click_accuracy=0.99)
    results |= made_up(BIRDS, dict.fromkeys(others, (110.0,)), click_accuracy=accuracy)
    assert judge(text, BIRDS, results).here.word == word


@pytest.mark.parametrize(
    ("text", "one", "other", "word", "extra"),
    [
        ("The two agents take longer", {"bucket-11": (30, 30)}, {"multiagent": (15, 15)}, HOLDS, "+100 %"),
        ("The two agents take longer", {"bucket-11": (30, 30)}, {"multiagent": (30, 30)}, UNDECIDED, "+0 %"),
        ("The two agents take longer", {"bucket-11": (30, 30)}, {"multiagent": (60, 60)}, FAILS, "-50 %"),
        ("The two agents take longer", {"bucket-11": (30, 30)}, {"multiagent": (15,)}, UNTESTED, ""),
        ("The two agents take longer", {"bucket-11": (30, 30)}, {}, UNTESTED, ""),
        # They are compared turn by turn, because the machine is not equally fast in all turns.
        ("The largest bucket takes longer", {"bucket-3": (10, 20, 5)}, {"bucket-41": (9, 18, 4.5)}, HOLDS, ""),
        ("The largest bucket takes longer", {"bucket-3": (10, 20, 5)}, {"bucket-41": (18, 9, 9)}, UNDECIDED, ""),
    ],
)
def test_training_time_follows_from_the_speed_of_runs_alone(text, one, other, word, extra):
    results = {}
    for layout, speeds in (one | other).items():  # in thousands of timesteps per second
        rows = [{MARK: {"reward": 1.0, "timesteps_per_second": 1000.0 * speed}} for speed in speeds]
        key = (BIRDS, layout, main_policy(layout))
        results[key] = Experiment(*key, (), tuple(Run(turn, row) for turn, row in enumerate(rows)))
    verdict = judge(text, BIRDS, results).here
    assert verdict.word == word and extra in verdict.evidence


def policy(**more: object) -> dict[str, object]:
    """Return the behavior of a trained policy of Beastly Rivals."""
    return {
        "lap_radius": [[seconds, 6.0 if seconds < 120 else 4.0] for seconds in range(0, 240, 10)],
        "blinks_per_episode": 0.5,
        "survival_seconds": 210.0,
        "slow_share": 0.12,
        "slow_share_by_chance": 0.13,
        "timesteps": COMPLETE + 75,
    } | more


GROWING = [[seconds, 4.0 + seconds / 100] for seconds in range(0, 240, 10)]


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ("Laps around the pitch", {"lap_radius": GROWING}),
        ("Blinking hardly matters", {"blinks_per_episode": 20.0}),
        ("The slow sphere hardly matters", {"slow_share": 0.02}),
    ],
)
def test_behavior_holds_fails_or_differs_between_policies(text, changed):
    def word(**behavior: dict[str, object]) -> str:
        known = {f"beastly_rivals/{name}": figures for name, figures in behavior.items()}
        return judge(text, "beastly_rivals", {}, known).here.word

    assert word(**{"bucket-3-s0": policy(), "threshold-0.0-s0": policy()}) == HOLDS
    assert word(**{"bucket-3-s0": policy(**changed)}) == FAILS
    assert word(**{"bucket-3-s0": policy(), "threshold-0.0-s0": policy(**changed)}) == UNDECIDED
    assert word(**{"bucket-3-s0": policy(timesteps=EARLY)}) == UNTESTED  # has not learned to behave yet
    assert word(**{"hybrid-s0": policy()}) == UNTESTED  # not an approach of the paper


def test_the_originals_logs_are_judged_by_the_same_rules():
    words = {(claim.text, claim.game): logs.word for claim in COMPARISONS if (logs := judge_logs(claim))}
    assert words["The thresholds score alike", "beastly_rivals"] == FAILS
    assert words["Threshold 0.0 is the best threshold", "beastly_rivals"] == UNDECIDED
    assert words["Eleven values per axis score higher than 3 and 41", "shooting_birds"] == HOLDS
    assert words["The bucket approach is more stable than the threshold approach", "shooting_birds"] == HOLDS


# What is written


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    """Return results of a few runs of different lengths."""
    folder = tmp_path_factory.mktemp("results")
    rising = [136.0 * number / 100 for number in range(1, 101)]
    write_run(folder, "shooting_birds/bucket-11-s0", rising)
    write_run(folder, "shooting_birds/bucket-11-s1", rising[:10])
    write_run(folder, "beastly_rivals/hybrid-s0", [80.0] * 100)
    for seed, reward in enumerate((150.0, 130.0)):
        write_run(folder, f"beastly_rivals/threshold-0.0-s{seed}", [reward] * 100)
    write_run(folder, "beastly_rivals/multiagent-s0", [40.0] * 10, "axes", timesteps_per_second=10_000.0)
    write_run(folder, "beastly_rivals/multiagent-s0", [41.0] * 10, "buttons", timesteps_per_second=10_000.0)
    write_run(folder / "alone", "shooting_birds/bucket-11-s0", rising[:2], timesteps_per_second=40_000.0)
    shooter = {"abs_vx": 12.5, "hits_per_level": [150.0, 151.0, 120.4], "timesteps": COMPLETE}
    known = {"beastly_rivals/threshold-0.0-s0": policy(), "shooting_birds/bucket-11-s0": shooter}
    (folder / "behavior.json").write_text(json.dumps(known))
    made = {f"shooting_birds/bucket-3-s{n}": {"half_hidden_hits": 0.8 + n / 100, "timesteps": EARLY} for n in range(3)}
    (folder / "action-spaces").mkdir()
    (folder / "action-spaces" / "behavior.json").write_text(json.dumps(made))
    return folder


SHOWN = (
    # Complete runs: per experiment, with the mean and the range of several, and each beside the original's ten.
    "| Shooting Birds bucket-11 | 1 | 136.0 | 137.6 ± 5.6 | 1 of 1 | 0.28 | 6.1 |",
    "| Beastly Rivals hybrid | 1 | 80.0 | not in the paper |  | 0.28 |  |",
    "| Beastly Rivals threshold-0.0 | 2 | 140.0 (130.0 to 150.0) | 93.2 ± 6.7 | 0 of 2 |",
    "| Shooting Birds bucket-11, seed 0 | 136.0 | 137.6 ± 5.6 | inside | 129.9 | 135.9 ± 5.2 | 0.28 | 6.1 |",
    "| Beastly Rivals threshold-0.0, seed 0 | 150.0 | 93.2 ± 6.7 | above | 150.0 |",
    # Verdicts. Policies of shorter trainings do not decide.
    "scores higher than the threshold approach | Shooting Birds | **not tested** |  |  |  |  | holds |",
    "policies almost never blink | Beastly Rivals | **holds** at 30 M | 1 | 1 of 1 |  |  | no logs |",
    "| Half hidden birds are hit | Shooting Birds | **undecided** at 3 M | 3 | ",
    "The logs contradict claim 18, Beastly Rivals: threshold-0.0 93.2 ± 3.4 (10)",
    # Behavior
    "| threshold-0.0-s0 | 0.5 | 210 | 0.12 | 0.13 | 30000075 |",
    "| bucket-11-s0 | 12.5 | 150 151 120 | 30000000 |",
    "| bucket-3-s2 | 0.82 | 3000000 |",
    # Every experiment: a line per length. Marks are bold where the means differ.
    "| Shooting Birds bucket-11 | 3 M | 2 | 13.6 [13.6, 13.6] | 13.6 |",
    "| Shooting Birds bucket-11 | 30 M | 1 | 136.0 | one run | 90.0 % | 0.28 | 40000 | 137.6 ± 2.8 [",
    "| Beastly Rivals multiagent, buttons | 3 M | 1 | 41.0 | one run | 1000 | 0.08 |  | 81.7 ± 8.9 |",
    "| bucket-11 | **1.4 (2)**; -47.7 ± 5.2 |",
    "| 136.0 (1); 137.6 ± 5.6 |",
)


def test_runs_claims_behavior_and_marks_are_tabulated(results):
    text = page_text(results, read_results(results))
    assert [line for line in SHOWN if line not in text] == []
    for number, claim in enumerate(judge_claims({}, {}), 1):
        assert f"| {number} | {claim.text} |" in text and f"\n{number}. Here: " in text


@pytest.mark.nightly
def test_four_small_figures_are_drawn_and_shown(results):
    (path,) = write_report(results)
    assert sorted(picture.name for picture in (results / "figures").iterdir()) == sorted(CAPTIONS)
    for name in CAPTIONS:
        assert f"](figures/{name})" in path.read_text()
        assert (results / "figures" / name).stat().st_size < 120_000
        with Image.open(results / "figures" / name) as picture:
            assert picture.width > 1000
            assert len(picture.convert("RGB").getcolors(100_000) or []) > 50


def test_without_any_run_the_page_says_so(tmp_path):
    text = page_text(tmp_path, read_results(tmp_path))
    assert "There is no complete run yet." in text
    assert "**holds**" not in text and "**not tested**" in text


def test_means_and_variances_are_compared_where_there_are_three_complete_runs(tmp_path):
    for seed, reward in enumerate((95.5, 105.4, 100.8, 97.2)):
        write_run(tmp_path, f"beastly_rivals/bucket-11-s{seed}", [reward] * 100)
    for seed in range(2):
        write_run(tmp_path, f"beastly_rivals/bucket-3-s{seed}", [100.0] * 100)
    (line,) = agreement(read_results(tmp_path)).splitlines()[2:]
    cells = line.strip("| ").split(" | ")
    assert cells[:7] == ["Beastly Rivals bucket-11", "4", "99.7", "4.4", "9", "103.9", "1.8"]
    assert float(cells[7]) > 0.05 > float(cells[8].strip("*"))


def test_the_table_in_the_readme_is_replaced_between_its_markers(results):
    written = readme_text(f"before\n{BEGIN}stale\n<!-- results:end -->\nafter\n", read_results(results))
    assert written.startswith(f"before\n{BEGIN}| experiment | runs |")
    assert written.endswith(" |\n<!-- results:end -->\nafter\n") and "stale" not in written
    with pytest.raises(ValueError, match="add both lines where the table belongs"):
        readme_text("no markers", {})


def test_the_projects_pages_are_up_to_date():
    results = read_results(RESULTS)
    advice = "is stale; run: python -m tools.paper report"
    assert page_text(RESULTS, results) == (RESULTS / "README.md").read_text(), f"results/README.md {advice}"
    assert readme_text(README.read_text(), results) == README.read_text(), f"README.md {advice}"
