"""The page of a comparison: Markdown and HTML with the same text, and its numbers as CSV and JSON."""

import json
import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from statistics import mean

from joybridge.compare.analysis import SIGNIFICANCE, Analysis, Result, center, least_seeds
from joybridge.compare.estimators import RESAMPLES
from joybridge.compare.made_with import changed_sources
from joybridge.compare.page_numbers import Setting, as_data, pairs_csv, pairs_tex, scores_csv, scores_tex
from joybridge.compare.page_pairs import pairs_blocks, smallest_p_text
from joybridge.compare.page_parts import (
    PICTURES,
    escaped,
    interval_text,
    number_text,
    page_html,
    picture_block,
    table,
    write_files,
)
from joybridge.compare.page_settings import made_with_block
from joybridge.compare.pictures import CAPTIONS, draw_pictures
from joybridge.compare.scores import LEAST

FEW = 30  # episodes, whose mean says little
ENOUGH = 10  # runs, with which intervals are about as wide as they claim to be
_IQM = (
    " The interquartile mean (IQM) leaves out the lowest and the highest quarter of the runs; of three or fewer it is "
    "the mean."
)
# 2,000 samples each from a normal distribution, with 1,000 resamples, as docs/compare.md says.
_NARROW = (
    " With fewer than ten runs these are too narrow: in a simulation they held the true value in 76 % of all cases "
    "with three runs, in 87 % with four and in 90 % with five."
)
_WHOLE = (
    "In the last part of a short training, long episodes do not end, so where lengths differ, short ones count for "
    "more than their share. Repeat the command with `--test`, which plays whole episodes with every policy, or train "
    "for longer."
)


def write_page(analysis: Analysis, setting: Setting, folder: Path) -> list[Path]:
    """Write the page, its pictures and its numbers into a folder. Return the paths of all but the page's pictures.

    Raises StorageError.
    """
    second = setting.held_out if setting.held_out and _has_curves(setting.held_out) else None
    curves = {"curves": analysis} if not setting.test else {}
    curves |= {"held_out": second} if second else {}
    figures = draw_pictures(analysis, curves, folder / PICTURES, setting.mark, setting.figures)
    text = page_text(analysis, setting)
    files = {
        "page.md": text,
        "page.html": page_html(text, folder),
        "scores.csv": scores_csv(analysis, timed=not setting.test),
        "scores.tex": scores_tex(analysis),
        **({"pairs.csv": pairs_csv(analysis), "pairs.tex": pairs_tex(analysis)} if analysis.pairs else {}),
        "compare.json": json.dumps(as_data(analysis, setting), indent=1, ensure_ascii=False) + "\n",
    }
    return [*write_files(files, folder, setting.mark), *figures]


def page_text(analysis: Analysis, setting: Setting) -> str:
    """Return the page as Markdown. Only the section "Wall-clock time" differs when a comparison is made again."""
    blocks = [f"# {escaped(setting.game)}: {_count(len(analysis.results), 'variant')}"]
    blocks += [_introduction(analysis, setting), *_warnings(analysis, setting)]
    center = analysis.center
    blocks += [
        "## Final scores",
        final_scores(analysis),
        _to_look_at(analysis),
        picture_block(f"scores{setting.mark}", CAPTIONS["scores"].format(center=center)),
    ]
    if not setting.test:
        blocks += [
            "## Learning curves",
            picture_block(f"curves{setting.mark}", CAPTIONS["curves"].format(center=center)),
        ]
    if setting.held_out:
        blocks += _held_out(setting.held_out, setting.mark)
    blocks += pairs_blocks(analysis, few_episodes(analysis)) if analysis.pairs else []
    blocks += [setting.settings] if setting.settings else []
    blocks += ["## Performance profiles", picture_block(f"profiles{setting.mark}", CAPTIONS["profiles"])]
    if not setting.test:
        blocks += [f"## Timesteps to a score of {number_text(analysis.score)}", _timesteps_to_score(analysis)]
        blocks += ["## Wall-clock time", _wall_clock(analysis)]
    blocks += [made_with] if (made_with := made_with_block(setting.made_with, setting.played)) else []
    blocks += ["## Again", f"```\n{setting.command}\n```"]
    return "\n\n".join(blocks) + "\n"


def _introduction(analysis: Analysis, setting: Setting) -> str:
    counts = sorted({len(result.runs) for result in analysis.results})
    lengths = sorted(set(setting.timesteps))
    length = f"{lengths[0]:,}" + (f" to {lengths[-1]:,}" if len(lengths) > 1 else "")
    metric = escaped(analysis.metric)
    measured = any(run.measured is not None for result in analysis.results for run in result.runs)
    episodes = _episodes(analysis)
    when = f"in a test without learning, {escaped(setting.test)}" if setting.test else "at the end without learning"
    curves = "on the page of the training" if setting.test else "of the same metric in training"
    score = (
        f"mean *{metric}* of the {episodes}episodes that its policy plays {when}; curves and times are {curves}"
        if measured
        else f"mean *{metric}* of the rows of metrics in the last tenth of its timesteps, each of {episodes}episodes"
        if episodes
        else f"mean *{metric}* {_ended(analysis)}"
    )
    policies = [f"{escaped(name)} for {escaped(label)}" for label, name in setting.policies.items() if name]
    several = f" Where several policies play, it is that of one of them: {', '.join(policies)}."
    return (
        f"{runs_text(counts)} of {length} timesteps per variant, with {_seeds(analysis)}. "
        f"The score of a run is the {score}; higher is better.{several if policies else ''}"
        f"{intervals_sentences(counts)}"
    )


def _seeds(analysis: Analysis) -> str:
    """Return the seeds of all runs in words."""
    seeds = sorted({run.seed for result in analysis.results for run in result.runs})
    if len(seeds) == 1:
        return f"the seed {seeds[0]}"
    whole = seeds == [*range(seeds[0], seeds[-1] + 1)]
    return f"the seeds {f'{seeds[0]} to {seeds[-1]}' if whole else ', '.join(map(str, seeds))}"


def runs_text(counts: Sequence[int]) -> str:
    """Return how many runs a variant has. counts: the fewest first."""
    return f"{counts[0]} to {counts[-1]} runs" if len(counts) > 1 else _count(counts[0], "run")


def intervals_sentences(counts: Sequence[int]) -> str:
    """Return what a reader has to know of the values and intervals of so many runs of a variant, the fewest first."""
    iqm = _IQM if center(counts[-1]) == "IQM" else ""
    return (
        f"{iqm} Intervals are 95 % confidence intervals of a stratified bootstrap over "
        f"runs ({RESAMPLES:,} resamples), as in [rliable](https://github.com/google-research/rliable)."
        f"{_NARROW if 1 < counts[0] < ENOUGH else ''}"
    )


def _held_out(analysis: Analysis, mark: str) -> list[str]:
    """Return the section about held-out scores, for the page of the same metric in training."""
    metric, episodes = escaped(analysis.metric), _episodes(analysis)
    blocks = [
        "## Held-out scores",
        f"The same runs in the {episodes}held-out episodes of `evaluate_during`, from which nothing is learned: "
        f"*{metric}*. With `--metric {analysis.metric}` the command writes a page about them, with effect sizes and "
        "tests. If you choose a variant by them, report it on other settings, with `--test`.",
        final_scores(analysis),
    ]
    if _has_curves(analysis):
        blocks.append(picture_block(f"held_out{mark}", CAPTIONS["held_out"].format(center=analysis.center)))
    return blocks


def _has_curves(analysis: Analysis) -> bool:
    """Return whether the metric was measured during the training, and not only at its end."""
    return all(run.measured is None for result in analysis.results for run in result.runs)


def _episodes(analysis: Analysis) -> str:
    """Return how many held-out episodes are behind a value, with a space; "" if none are."""
    counts = sorted({run.episodes for result in analysis.results for run in result.runs} - {0})
    return " to ".join(f"{count:,}" for count in dict.fromkeys([*counts[:1], *counts[-1:]])) + " " * bool(counts)


def _ended(analysis: Analysis) -> str:
    """Return of what in the training a score is the mean: of how many episodes, if that is known."""
    counts = sorted({run.ended for result in analysis.results for run in result.runs})
    if not counts[0]:
        return "of the last tenth of its timesteps"
    number = f"{counts[0]:,} to {counts[-1]:,}" if len(counts) > 1 else f"{counts[0]:,}"
    return (
        f"of the {number} {'episodes that end' if counts[-1] > 1 else 'episode that ends'} in the last tenth of its "
        "timesteps, or at least in its last row of metrics that has one"
    )


def few_episodes(analysis: Analysis) -> str:
    """Return that a score of a training rests on few episodes; "" if none does."""
    fewest = min(run.ended for result in analysis.results for run in result.runs)
    return f"A score rests on {_count(fewest, 'episode')}" if _has_curves(analysis) and 0 < fewest < FEW else ""


def warnings(setting: Setting) -> list[str]:
    """Return what a reader has to know first: runs that are missing, and sources that have changed."""
    blocks = []
    if setting.missing:
        runs = "\n".join(f"- {escaped(each)}" for each in setting.missing)
        blocks.append(f"**These runs are missing, and the page is computed without them:**\n\n{runs}")
    if changed := changed_sources(setting.made_with):
        blocks.append(
            f"**The files of {', '.join(map(escaped, changed))} have changed between runs.** If what they do has "
            "changed, the runs are of several games or layouts under one name: train all of them in another folder."
        )
    if setting.played and (other := changed_sources([*setting.made_with, setting.played])) and other != changed:
        blocks.append(
            f"**The files of {', '.join(map(escaped, other))} have changed since these runs were trained.** The test "
            "plays them as they are now."
        )
    return blocks


def _warnings(analysis: Analysis, setting: Setting) -> list[str]:
    blocks = warnings(setting)
    if setting.left_out:
        names = ", ".join(map(escaped, setting.left_out))
        blocks.append(
            f"**Not on this page, but trained in the same folder: {names}.** The p values are corrected for the "
            f"{_count(len(analysis.pairs), 'pair')} here. If what is here was chosen after all was seen, that "
            "is too few: take the p values of a page with all."
        )
    for one, other in combinations(analysis.results, 2):
        if one.scores == other.scores:
            blocks.append(
                f"**{escaped(one.label)} and {escaped(other.label)} have the same score with every seed.** Perhaps "
                "they do not differ on this game: without buttons, for example, threshold and hybrid are the same."
            )
    if few := few_episodes(analysis):
        blocks.append(f"**{few}.** {_WHOLE}")
    runs = [run for result in analysis.results for run in result.runs]
    if early := [run.early for run in runs if run.early]:
        blocks.append(
            f"**In {len(early)} of {_count(len(runs), 'run')} no episode ends in the last tenth of the timesteps.** "
            f"The score is of the last row of metrics in which some do, which ends after {min(early):,} timesteps at "
            "the earliest. Where all episodes are as long, those of all arenas end at once: take fewer arenas, train "
            "for longer, or repeat the command with `--test`, which plays whole episodes with every policy."
        )
    if analysis.smallest_p >= SIGNIFICANCE:
        blocks.append(
            f"**Too few runs for a significance test**: the smallest p value that is possible with them is "
            f"{smallest_p_text(analysis)}. Repeat the command with `--seeds {least_seeds(len(analysis.pairs))}` or "
            "more; finished runs are kept."
        )
    return blocks


def final_scores(analysis: Analysis) -> str:
    """Return the scores of all variants as a table in Markdown; the best is bold if it differs from another one."""
    results = analysis.results
    best = max(results, key=lambda result: result.iqm.value).label
    differs = any(pair.corrected < SIGNIFICANCE for pair in analysis.pairs if best in (pair.first, pair.second))
    rows = [
        (
            f"**{escaped(result.label)}**" if differs and result.label == best else escaped(result.label),
            f"{len(result.runs)}",
            interval_text(result.iqm, len(result.runs) > 1),
            f"{number_text(result.mean)} ± {number_text(result.std)}",
            number_text(result.median),
            f"{number_text(min(result.scores))} to {number_text(max(result.scores))}",
        )
        for result in results
    ]
    return table(("variant", "runs", analysis.center, "mean ± sd", "median", "lowest to highest"), rows)


def _to_look_at(analysis: Analysis) -> str:
    """Return which runs are typical and which are the best, for `joybridge record`."""
    found = []
    for result in analysis.results:
        best = max(result.runs, key=lambda run: run.score).seed
        typical = min(result.runs, key=lambda run: abs(run.score - result.median)).seed
        found.append(f"{escaped(result.label)}, {typical} and {best}")
    return f"The seeds of a run in the middle and of the best one: {'; '.join(found)}."


def _timesteps_to_score(analysis: Analysis) -> str:
    rows = []
    for result in analysis.results:
        reached = [first.timesteps for first in result.firsts(analysis.score) if first]
        middle, ends = _middle(result, reached, "{:,.0f}")
        never = len(result.runs) - len(reached)
        rows.append((escaped(result.label), f"{len(reached)}", f"{never}", middle, ends))
    chosen = (
        ""
        if analysis.score_given
        else f"**This score was chosen from these runs**: it is the lowest {analysis.center} at the end of the curves "
        "above, so the times say how the variants differ here, and are no measurement to report. Name a score that you "
        "chose before the runs with `--score`. "
    )
    heads = ("variant", "runs that reach it", "never", "median", "shortest to longest of those that do")
    return (
        f"{chosen}Timesteps until the first row of metrics that reaches this score; one of fewer than {LEAST} episodes "
        "is taken together with those before it. The median counts runs that never do as infinitely long; the range "
        "cannot, and leaves them out.\n\n" + table(heads, rows)
    )


def _wall_clock(analysis: Analysis) -> str:
    rows = []
    for result in analysis.results:
        reached = [first.seconds for first in result.firsts(analysis.score) if first and math.isfinite(first.seconds)]
        whole = [run.seconds for run in result.runs if math.isfinite(run.seconds)]
        middle = _middle(result, reached, "{:,.0f}")[0]
        rows.append((escaped(result.label), f"{mean(whole):,.0f}" if whole else "", middle))
    return (
        "Seconds of a run, and until the score above. These depend on the machine and on what else it did.\n\n"
        + table(("variant", "seconds of a run, mean", "seconds to the score, median"), rows)
    )


def _middle(result: Result, reached: Sequence[float], form: str) -> tuple[str, str]:
    """Return the median over all runs, and the range of those that have reached a score."""
    ordered = [*sorted(reached), *[math.inf] * (len(result.runs) - len(reached))]
    middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    ends = f"{form.format(min(reached))} to {form.format(max(reached))}" if reached else ""
    return form.format(middle) if math.isfinite(middle) else "not reached", ends


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"
