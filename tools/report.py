"""A page about the finished runs in results/: each experiment beside the original's ten runs."""

from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from tools.original import TRANSITIONS_PER_STEP, Point, original_curve
from trainer.metrics import Row, read_rows

MARKS = (300_000, 1_200_000, 1_500_000, 3_000_000, 15_000_000, 30_000_000)  # transitions that the page compares at
SLACK = 5_000  # transitions of one step at most


@dataclass(frozen=True)
class Curves:
    """The finished runs of one policy of one experiment."""

    game: str
    layout: str
    policy: str  # "axes" or "buttons" of multiagent, else ""
    runs: tuple[tuple[Row, ...], ...]  # rows of metrics, one tuple per seed

    def at(self, transitions: int, key: str = "reward") -> list[float]:
        """Return the figure of each run that has a row there, which ends with the first step beyond it."""
        return [
            row[key] for run in self.runs for row in run if 0 <= row["transitions"] - transitions < SLACK and key in row
        ]


def read_curves(results: Path) -> list[Curves]:
    """Return everything under `results`; of several lengths of one run, the longest."""
    longest: dict[tuple[str, str, str, str], tuple[Row, ...]] = {}
    for path in sorted(results.glob("*M/*/*.csv")):
        stem, policy = path.stem, ""
        for part in ("axes", "buttons"):
            if stem.endswith(f"-{part}"):
                stem, policy = stem.removesuffix(f"-{part}"), part
        layout, _, seed = stem.rpartition("-s")
        rows = tuple(read_rows(path))
        key = (path.parent.name, layout, policy, seed)
        if len(rows) > len(longest.get(key, ())):
            longest[key] = rows
    grouped: dict[tuple[str, str, str], list[tuple[Row, ...]]] = {}
    for (game, layout, policy, _), rows in sorted(longest.items()):
        grouped.setdefault((game, layout, policy), []).append(rows)
    return [Curves(*key, tuple(runs)) for key, runs in grouped.items()]


def write_report(results: Path, output: Path) -> None:
    """Write the page."""
    lines = [
        "# Our runs beside the original's",
        "",
        "Mean episode reward over the 300 000 transitions (20 000 original steps) before each mark, of all our seeds,",
        "and in brackets the original's mean ± two standard deviations of its ten runs. **Bold** lies outside. Raw",
        "metrics are in the folders beside this page, named by the length of the run; `tools/paper.py` made them.",
    ]
    curves = read_curves(results)
    for game in sorted({curve.game for curve in curves}):
        marks = [mark for mark in MARKS if any(c.at(mark) for c in curves if c.game == game)]
        heads = [f"{mark / 1e6:g} M ({mark // TRANSITIONS_PER_STEP // 1000} k steps)" for mark in marks]
        lines += ["", f"## {game}", "", "| experiment | seeds | " + " | ".join(heads) + " |"]
        lines.append("|---" * (2 + len(marks)) + "|")
        for curve in curves:
            if curve.game == game:
                cells = [_cell(curve, mark) for mark in marks]
                name = f"{curve.layout} {curve.policy}".strip()
                lines.append(f"| {name} | {len(curve.runs)} | " + " | ".join(cells) + " |")
    output.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _cell(curve: Curves, mark: int) -> str:
    rewards = curve.at(mark)
    if not rewards:
        return ""
    ours = mean(rewards)
    point = original_point(curve, mark)
    if point is None:
        return f"{ours:.1f}"
    inside = abs(ours - point.reward) <= 2 * point.reward_std
    return f"{ours:.1f} ({point.reward:.1f} ± {2 * point.reward_std:.1f})" if inside else (
        f"**{ours:.1f}** ({point.reward:.1f} ± {2 * point.reward_std:.1f})"
    )  # fmt: skip


def original_point(curve: Curves, transitions: int) -> Point | None:
    """Return the original's figures for an experiment at a mark, or None where it has none."""
    points = original_curve(curve.game, curve.layout, curve.policy)
    return next((point for point in points if point.transitions == transitions), None)
