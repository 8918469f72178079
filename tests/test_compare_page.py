"""Scores of runs, and what the page of `joybridge compare` says of them."""

import csv
import io
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from joybridge.compare import command
from joybridge.compare.analysis import SIGNIFICANCE, Analysis, analyze, least_seeds
from joybridge.compare.compare import held_out_analysis
from joybridge.compare.job import Job
from joybridge.compare.made_with import MadeWith, changed_sources, note, packages_of
from joybridge.compare.made_with import read as read_made_with
from joybridge.compare.names import ResultName
from joybridge.compare.page import page_text, write_page
from joybridge.compare.page_numbers import Setting, pairs_csv, pairs_tex, scores_tex
from joybridge.compare.page_parts import page_html
from joybridge.compare.scores import Point, Run, score_run
from joybridge.compare.variants import (
    make_variants,
    pairs_to_test,
)
from joybridge.config.config import Config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import read_rows
from joybridge.run.origin import keep_origin
from joybridge.run.sources import note_sources


def runs(*values: list[float]) -> list[Run]:
    """Return runs with rows of metrics every 100 timesteps, one per second."""
    rows = [[{"timesteps": 100.0 * i, "seconds": i, "reward": one} for i, one in enumerate(each, 1)] for each in values]
    return [score_run(each, "x", seed, "reward") for seed, each in enumerate(rows)]


def setting_of(analysis: Analysis, missing: list[str]) -> Setting:
    return Setting("a game", [1000], {result.label: "" for result in analysis.results}, "joybridge …", missing)


def text_of(analysis: Analysis) -> str:
    return page_text(analysis, setting_of(analysis, []))


def test_the_score_of_a_run_is_the_mean_over_the_episodes_of_its_last_tenth():
    assert runs([0.0] * 9 + [4.0])[0].score == 4.0
    assert runs([0.0] * 18 + [4.0, 6.0])[0].score == 5.0
    assert runs([0.0] * 13 + [6.0])[0].score == 6.0  # more than half of the row before lies outside
    assert runs([3.0])[0].score == 3.0


def test_a_score_weighs_rows_by_their_episodes_and_takes_the_last_one_that_has_some():
    rows = [{"timesteps": 104.0 * i, "reward": 1.0, "entropy": float(i), "episodes": 5.0} for i in range(1, 21)]
    rows[18] |= {"reward": 7.0, "episodes": 3.0}
    rows[19] |= {"reward": 3.0, "episodes": 1.0}
    run = score_run(rows, "x", 0, "reward")
    assert (run.score, run.ended) == (6.0, 4)
    assert score_run(rows, "x", 0, "entropy").score == 19.5  # which is not of episodes
    for row in rows[17:]:
        del row["reward"]
        row["episodes"] = 0.0
    run = score_run(rows, "x", 0, "reward")
    assert (run.score, run.ended, run.points[-1].timesteps) == (1.0, 5, 17 * 104)


def test_a_measure_at_the_end_is_a_score_also_where_no_episode_ended_in_training():
    rows = [{"timesteps": 100.0, "seconds": 1.0}, {"timesteps": 200.0, "seconds": 2.0, "held_out_reward": 5.0}]
    rows[-1]["held_out_episodes"] = 30.0
    run = score_run(rows, "x", 0, "held_out_reward")
    assert (run.score, run.end, run.seconds, run.episodes) == (5.0, 200, 2.0, 30)
    with pytest.raises(ConfigError, match=r"no episode ended; lengthen the runs, or let them end with an evaluation"):
        score_run(rows, "x", 0, "reward")


def test_rows_without_the_metric_are_left_out_and_others_must_be_finite(tmp_path):
    path = tmp_path / "run-s0.csv"

    def read() -> Run:
        return score_run(read_rows(path), path.name, 7, "reward")

    path.write_text("timesteps,seconds,reward\n100,1,\n200,2,0.5\n300,3,1.5\n")
    assert read() == Run(7, (Point(200, 2.0, 0.5, begin=100), Point(300, 3.0, 1.5, begin=200)), 300)
    path.write_text("timesteps,reward\n100,nan\n")
    with pytest.raises(CheckpointError, match=r"run-s0.csv: reward is nan after 100 timesteps, expected a finite"):
        read()
    path.write_text("timesteps,reward\n200,1\n100,1\n")
    with pytest.raises(CheckpointError, match=r"run-s0.csv: its rows are not in the order of their timesteps"):
        read()
    for row, problem in (("inf,1,1", "timesteps is inf"), ("9,nan,1", "episodes is nan"), ("9,-1,1", "episodes is -1")):
        path.write_text(f"timesteps,episodes,reward\n{row}\n")
        with pytest.raises(CheckpointError, match=rf"is no file of metrics \({problem}\)"):
            read()
    path.write_text("timesteps,length\n100,\n")
    with pytest.raises(ConfigError, match="has no reward: no episode ended; lengthen the runs"):
        read()


def test_a_lucky_episode_reaches_no_score(tmp_path):
    path = tmp_path / "run-s0.csv"
    path.write_text("timesteps,episodes,reward\n100,1,9\n200,4,1\n300,5,2\n400,9,6\n500,1,99\n600,20,5\n700,2,8\n")
    run = score_run(read_rows(path), path.name, 7, "reward")
    firsts = [run.first_at(score) for score in (2.3, 2.4, 4.5, 4.6, 15.3, 15.4)]
    # Means over ten episodes or more: 2.3 after 300, (5 * 2 + 9 * 6) / 14 after 400, (9 * 6 + 99) / 10 after 500.
    assert [first and first.timesteps for first in firsts] == [300, 400, 400, 500, 500, None]
    path.write_text("timesteps,reward\n100,9\n200,1\n")  # of who knows how many
    first = score_run(read_rows(path), path.name, 7, "reward").first_at(9.0)
    assert first and first.timesteps == 100


def test_what_was_measured_at_the_end_is_the_score_and_the_curve_is_that_of_the_training(tmp_path):
    path = tmp_path / "run-s0.csv"
    path.write_text("timesteps,seconds,reward,held_out_reward\n100,1,2,\n200,2,4,9\n")
    found = score_run(read_rows(path), path.name, 7, "held_out_reward")
    assert (found.score, found.points) == (9.0, (Point(100, 1.0, 2.0), Point(200, 2.0, 4.0, begin=100)))
    path.write_text("timesteps,seconds,reward,held_out_reward\n100,1,2,7\n200,2,4,9\n")
    points = (Point(100, 1, 7), Point(200, 2, 9, begin=100))
    assert score_run(read_rows(path), path.name, 7, "held_out_reward").points == points
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
    games = ["reach_game:Reach", "pygame:program.py keys=LEFT 'hook=my hook.py'", "gym:CartPole-v1"]
    out, packages = tmp_path / "out", packages_of(games)
    out.mkdir()

    def trained(name: str, games: list[str]) -> Path:
        keep_origin(out / name)
        note_sources(out / name, games, Config(game="reach"))
        return out / name

    for name in ("a-s0", "a-s1", "a-s2"):
        (out / name).mkdir()
    first, second, third = (trained(name, games) for name in ("a-s0", "a-s1", "a-s2"))
    note(out, [first, out / "deleted"], packages)
    note(out, [first, second], packages)
    (noted,) = read_made_with(out)
    assert noted.versions["torch"] and noted.versions["joybridge"].startswith("0.1.0") and "cores" in noted.machine
    assert noted.versions["gymnasium"] and noted.versions["pygame"] and "stable-baselines3" not in noted.versions
    assert list(noted.sources) == ["my hook.py", "program.py", "reach_game"] and not changed_sources([noted])
    Path("reach_game.py").write_text("REACH = 0.3")
    trained("a-s2", games[:1])
    note(out, [first, second, third], [*packages, "stable-baselines3"])
    assert changed_sources(read_made_with(out)) == ["reach_game"]
    assert read_made_with(out)[-1].versions["stable-baselines3"]
    setting = Setting("reach", [1], {"a": ""}, "joybridge compare", [], made_with=read_made_with(out))
    text = page_text(analyze("reward", {"a": runs([1.0])}), setting)
    assert "**The files of reach_game have changed between runs.**" in text.replace("\\", "")
    (out / "made_with.json").write_text("{")
    with pytest.raises(ConfigError, match=r"made_with\.json cannot be read .*; delete it, it is only for people"):
        read_made_with(out)


def test_the_page_of_a_test_says_what_was_played_and_that_it_is_not_what_was_trained():
    trained, played = MadeWith({"python": "3.11"}, {"reach": "a1"}, "a machine"), MadeWith({}, {"reach": "b2"})
    setting = Setting(
        "reach", [1], {"a": ""}, "joybridge compare", [], test="under x", made_with=[trained], played=played
    )
    text = page_text(analyze("reward", {"a": runs([1.0])}), setting)
    assert "**The files of reach have changed since these runs were trained.**" in text
    assert "- python 3.11, reach (files a1); on a machine\n- the test: reach (files b2)" in text
    again = page_text(analyze("reward", {"a": runs([1.0])}), replace(setting, played=trained))
    assert "have changed" not in again


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
    assert "of the rows of metrics in the last tenth of its timesteps, each of 1,500 episodes" in text([between, last])


def test_a_score_of_episodes_before_the_last_tenth_is_named():
    def text(*ends):
        rows = [{"timesteps": end, "reward": 1.0, "episodes": 50.0} for end in (500.0, *ends)]
        run = score_run([*rows, {"timesteps": 2000.0, "entropy": 1.0}], "x", 0, "reward")
        return text_of(analyze("reward", {"a": [run, replace(run, seed=1)]}))

    assert "**In 2 of 2 runs no episode ends in the last tenth of the timesteps.** " in text(1700.0, 1800.0)
    assert "which ends after 1,800 timesteps at the earliest" in text(1700.0, 1800.0)
    assert "no episode ends" not in text(1900.0)


def test_the_page_says_how_many_episodes_of_the_training_are_behind_a_score():
    def text(*counts, **measured):
        rows = [{"timesteps": 100.0 * i, "reward": 1.0, "episodes": 50.0} for i in range(1, 20)]
        several = [
            score_run([*rows, {"timesteps": 2000.0, "reward": 2.0, "episodes": each}], "x", 0, "reward")
            for each in counts
        ]
        return text_of(analyze("reward", {"a": [replace(run, **measured) for run in several]}))

    assert "of the 51 to 90 episodes that end in the last tenth of its timesteps, or" in text(1.0, 40.0)
    assert "rests on" not in text(1.0, 40.0)
    rows = [{"timesteps": 100.0, "reward": 1.0, "episodes": 1.0}]
    few = text_of(analyze("reward", {"a": [score_run(rows, "x", 0, "reward")]}))
    assert (
        "of the 1 episode that ends in the last" in few
        and "**A score rests on 1 episode.**" in few
        and "`--test`" in few
    )
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


def test_names_mean_nothing_to_markdown_and_html(tmp_path):
    analysis = analyze("reward", {"a|<b>*$": runs([1.0], [2.0]), "c": runs([1.5])})
    html = page_html(page_text(analysis, setting_of(analysis, ["x: <i>"])), tmp_path)
    assert "<strong>a|&lt;b&gt;*$</strong>" in html or "<td>a|&lt;b&gt;*$</td>" in html
    assert "<li>x: &lt;i&gt;</li>" in html and html.count("<table>") == 6


def test_runs_are_timed_to_a_score_that_their_curves_have_where_scores_are_measured_apart():
    rows = [{"timesteps": 100.0 * i, "reward": float(i), "episodes": 50.0} for i in range(1, 11)]
    run = score_run([*rows[:-1], {**rows[-1], "held_out_reward": 30.0}], "x", 0, "held_out_reward")
    found = analyze("held_out_reward", {"a": [run, run]})
    assert found.results[0].iqm.value == 30.0 and found.score == 10.0
    assert [first and first.timesteps for first in found.results[0].firsts(found.score)] == [1000, 1000]
