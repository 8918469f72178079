"""The numbers of a comparison as files: CSV to read again, LaTeX for a paper, and JSON with everything."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from joybridge.compare.analysis import Analysis, Band, Result
from joybridge.compare.made_with import MadeWith
from joybridge.compare.page_parts import csv_text, interval_text, number_text

# What LaTeX would take for a command, and how it is written.
LATEX = str.maketrans({
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
})  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """What was compared, for the beginning and the end of the page."""

    game: str
    timesteps: Sequence[int]  # lengths of the runs
    policies: Mapping[str, str]  # whose metric is the score, by variant; "": a game has one policy
    command: str  # that makes this comparison
    missing: Sequence[str]  # runs that failed, each with its reason
    mark: str = ""  # what the names of the files of the page end with
    settings: str = ""  # in what the variants differ, and what they share, as Markdown
    test: str = ""  # how the policies play in a test, whose scores are compared; "": there is none
    figures: str = ""  # the format in which pictures are also written, for a paper
    left_out: Sequence[str] = ()  # variants in the same folder that are not compared, the names of their files
    held_out: Analysis | None = None  # of the same runs and metric, where it was measured beside the training
    made_with: Sequence[MadeWith] = ()  # the runs
    played: MadeWith | None = None  # what the test was made with


def scores_csv(analysis: Analysis, *, timed: bool) -> str:
    """Return a line per run: variant, seed, score and, if timed, the timesteps until the common score."""
    times = [f"timesteps_to_{analysis.score:.6g}"] if timed else []
    lines: list[Sequence[object]] = [("variant", "seed", analysis.metric, *times)]
    for result in analysis.results:
        for run, first in zip(result.runs, result.firsts(analysis.score), strict=True):
            times = [str(first.timesteps) if first else ""] if timed else []
            lines.append((result.label, run.seed, repr(run.score), *times))
    return csv_text(lines)


def pairs_csv(analysis: Analysis) -> str:
    """Return a line per pair of variants: the effect sizes with their 95 % intervals, and the p values.

    An interval is empty where a bootstrap cannot know it, see `Pair`.
    """
    ends = [f"{name}{end}" for name in ("difference", "probability") for end in ("", "_low", "_high")]
    lines: list[Sequence[object]] = [("first", "second", *ends, "p_value", "corrected")]
    for pair in analysis.pairs:
        estimates = [
            repr(value) if known or not index else ""
            for each, known in ((pair.difference, pair.runs > 2), (pair.improvement, pair.overlap))
            for index, value in enumerate(each)
        ]
        lines.append((pair.first, pair.second, *estimates, repr(pair.p_value), repr(pair.corrected)))
    return csv_text(lines)


def scores_tex(analysis: Analysis) -> str:
    """Return the final scores as a table for LaTeX, the rows in the order of the page."""
    rows = [
        (
            latex(result.label),
            f"{len(result.runs)}",
            latex(interval_text(result.iqm, len(result.runs) > 1)),
            f"{latex(number_text(result.mean))} $\\pm$ {number_text(result.std)}",
            latex(number_text(result.median)),
        )
        for result in analysis.results
    ]
    return tabular(("variant", "runs", f"{analysis.center} [95\\,\\%]", r"mean $\pm$ sd", "median"), rows)


def pairs_tex(analysis: Analysis) -> str:
    """Return the effect sizes and p values of all pairs of variants as a table for LaTeX."""
    rows = [
        (
            f"{latex(pair.first)} -- {latex(pair.second)}",
            latex(interval_text(pair.difference, pair.runs > 2)),
            latex(interval_text(pair.improvement, pair.overlap)),
            f"{pair.corrected:.2g}",
        )
        for pair in analysis.pairs
    ]
    heads = ("pair", rf"$\Delta$ {analysis.center} [95\,\%]", r"$P$(first better) [95\,\%]", "$p$ (Holm)")
    return tabular(heads, rows)


def tabular(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for LaTeX with the package `booktabs`, from cells that mean what they say there."""
    lines = [
        r"% \usepackage{booktabs}, then \input this file",
        rf"\begin{{tabular}}{{l{'r' * (len(heads) - 1)}}}",
        r"\toprule",
        rf"{' & '.join(heads)} \\",
        r"\midrule",
        *(rf"{' & '.join(row)} \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def latex(text: str) -> str:
    """Return a text that means nothing to LaTeX; negative numbers in brackets have a minus sign."""
    return re.sub(r"(?<![\w.+-])-(?=\d)", "$-$", text.translate(LATEX))


def as_data(analysis: Analysis, setting: Setting) -> dict[str, Any]:
    """Return all numbers as plain data. Only those under "wall_clock" differ when a comparison is made again.

    Those of a test have no curves and times, which would be those of the training.
    """
    score, results, timed = analysis.score, analysis.results, not setting.test
    return {
        "game": setting.game,
        "metric": analysis.metric,
        "score": score,
        "score_given": analysis.score_given,
        "missing": list(setting.missing),
        "made_with": [each._asdict() for each in setting.made_with],
        "played_with": setting.played and setting.played._asdict(),
        "variants": [
            {
                "label": result.label,
                "policy": setting.policies[result.label],
                "seeds": [run.seed for run in result.runs],
                "scores": result.scores,
                "iqm": result.iqm._asdict(),
                "mean": result.mean,
                "std": result.std,
                "median": result.median,
                "profile": _band(result.profile, "scores"),
                **(_course(result, score) if timed else {}),
            }
            for result in results
        ],
        "pairs": [
            {
                "first": pair.first,
                "second": pair.second,
                "difference": pair.difference._asdict(),
                "improvement": pair.improvement._asdict(),
                "p_value": pair.p_value,
                "corrected": pair.corrected,
            }
            for pair in analysis.pairs
        ],
        "wall_clock": {
            result.label: {
                "seconds": [_finite(run.seconds) for run in result.runs],
                "seconds_to_score": [_finite(first.seconds) if first else None for first in result.firsts(score)],
            }
            for result in (results if timed else ())
        },
    }


def _course(result: Result, score: float) -> dict[str, Any]:
    reached = [first.timesteps if first else None for first in result.firsts(score)]
    return {"timesteps_to_score": reached, "curve": _band(result.curve, "timesteps")}


def _band(each: Band, x: str) -> dict[str, list[float]]:
    return {x: each.x, "value": each.value, "low": each.low, "high": each.high}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
