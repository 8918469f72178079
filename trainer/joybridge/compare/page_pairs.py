"""Which variants of a comparison are better than which: the part of its page about pairs, as Markdown."""

import math
from collections.abc import Callable

from joybridge.compare.analysis import SIGNIFICANCE, Analysis, Pair
from joybridge.compare.estimators import Estimate
from joybridge.compare.page_parts import escaped, interval_text, number_text, table


def pairs_blocks(analysis: Analysis, few: str) -> list[str]:
    """Return the section about the pairs of a comparison. few: that scores rest on few episodes; "": they do not."""
    bold = analysis.smallest_p < SIGNIFICANCE
    return [
        "## Which variant is better",
        *_tested(analysis),
        _better(analysis, few),
        f"The effect size: the {analysis.center} of the row minus that of the column, with its 95 % interval.",
        _matrix(analysis, _difference_cell),
        "The probability that a run of the row has a higher score than one of the column, with its 95 % "
        "interval; that of all or none of the runs has none, because a bootstrap only knows the runs that it has. "
        f"{'**Bold**: the p value below is smaller than 0.05.' if bold else _nothing_bold(analysis)}",
        _matrix(analysis, _improvement_cell),
        "The p values of two-sided Mann-Whitney tests, corrected for the number of pairs by Holm's method."
        f"{' **Bold**: below 0.05.' if bold else ''}",
        _matrix(analysis, _p_cell),
    ]


def _tested(analysis: Analysis) -> list[str]:
    """Return a sentence about the pairs that the command has selected, if it has."""
    tested, all_pairs = len(analysis.pairs), math.comb(len(analysis.results), 2)
    if tested == all_pairs:
        return []
    return [
        f"{tested} of {all_pairs} pairs are tested: those that differ in one of the keys alone that `--pairs` names. "
        "The p values are corrected for their number. This counts only if they were named before the scores were seen."
    ]


def _better(analysis: Analysis, few: str) -> str:
    """Return the differences that are significant, in words."""
    by_label = {result.label: result for result in analysis.results}
    lines = []
    for pair in analysis.pairs:
        if pair.corrected < SIGNIFICANCE:
            better, worse = (pair.first, pair.second) if pair.improvement.value > 0.5 else (pair.second, pair.first)
            lines.append(
                f"- {escaped(better)} ({analysis.center} {number_text(by_label[better].iqm.value)}) is better than "
                f"{escaped(worse)} ({number_text(by_label[worse].iqm.value)}), p = {pair.corrected:.2g}."
            )
    if lines and few:
        lines.append(f"\n{few}, so this is about the episodes that happened to end there. `--test` says more.")
    return "\n".join(lines) or "No two variants differ significantly."


def _matrix(analysis: Analysis, cell: Callable[[Pair, bool], str]) -> str:
    """Return a table of all pairs. cell: the text of a pair; true where its second variant is the row."""
    labels = [result.label for result in analysis.results]
    cells = {(pair.first, pair.second): cell(pair, False) for pair in analysis.pairs}
    cells |= {(pair.second, pair.first): cell(pair, True) for pair in analysis.pairs}
    rows = [(escaped(row), *(cells.get((row, column), "") for column in labels)) for row in labels]
    return table(("", *map(escaped, labels)), rows)


def _difference_cell(pair: Pair, reverse: bool) -> str:
    value, low, high = pair.difference
    return interval_text(Estimate(0 - value, 0 - high, 0 - low) if reverse else pair.difference, pair.runs > 2)


def _improvement_cell(pair: Pair, reverse: bool) -> str:
    value, low, high = pair.improvement
    if reverse:
        value, low, high = 1 - value, 1 - high, 1 - low
    interval = {0.0: "(none)", 1.0: "(all)"}.get(value, f"[{100 * low:.0f}, {100 * high:.0f}]")
    text = f"{100 * value:.0f} % {interval}"
    return f"**{text}**" if pair.corrected < SIGNIFICANCE else text


def _p_cell(pair: Pair, reverse: bool) -> str:
    return f"**{pair.corrected:.2g}**" if pair.corrected < SIGNIFICANCE else f"{pair.corrected:.2g}"


def _nothing_bold(analysis: Analysis) -> str:
    """Return why nothing is bold: a bootstrap over two runs, for example, only knows these two."""
    return (
        f"Nothing is bold: with so few runs the smallest p value that is possible is {smallest_p_text(analysis)}, and "
        "their bootstrap intervals are too narrow."
    )


def smallest_p_text(analysis: Analysis) -> str:
    """Return the smallest p value that is possible with so few runs."""
    return f"{min(1.0, analysis.smallest_p):.2g}"
