"""The page about the finished runs: figures, tables and claims, ours and the original's."""

import json
from pathlib import Path

from tools.paper import tables
from tools.paper.claims import Behavior, judge_claims
from tools.paper.figures import draw_figures
from tools.paper.runs import Results, read_results

README = Path(__file__).resolve().parents[2] / "README.md"  # the project's
RESULTS = README.with_name("results")  # the project's own
BEGIN, END = "<!-- results:begin -->\n", "<!-- results:end -->"  # around the table in the project's README
CAPTIONS = {
    "figure-11-threshold.png": "Figure 11: the threshold approach.",
    "figure-12-bucket.png": "Figure 12: the bucket approach with 3, 11 and 41 values per axis.",
    "figure-13-approaches.png": "Figure 13: all approaches; hybrid is not in the paper.",
    "figure-14-training-time.png": "Figure 14: training time, on a logarithmic scale.",
}
INTRODUCTION = """\
# The paper's experiments: our runs and the original's

`python -m tools.paper report` computes this page from the metrics in this folder, in the table `runs.csv.xz`, which
`pandas.read_csv` reads. If there are several lengths of a run, the longest is used. A seed counts as one run: of two
that differ in rounding errors, for example by the number of `pipeline_groups` (a setting of the trainer), the mean.

The original's numbers are from its logs of ten runs per experiment. Two of those of Beastly Rivals bucket-11 are the
same run, which counts once here. Its click accuracies are printed in the paper only. Reward is the mean over the
episodes of the last 300 000 timesteps (20 000 steps of the original), as in its logs. The reward of the two agents
(`multiagent`) is that of the agent that clicks, as in the paper."""
COMPLETE_RUNS = """\
A complete run has 30 million (30 M) timesteps. Reward is the mean of our runs, with the lowest and the highest run in
brackets, and the original's mean ± two standard deviations (sd) of its ten runs. *Inside* counts our runs within those
two standard deviations. Hours are wall-clock times on a shared machine."""
EACH_RUN = """\
Each complete run, compared with the same two standard deviations (*place*). *Last ten marks* is the mean reward of the
last 3 M timesteps."""
AGREEMENT = """\
The mean reward of the last 3 M timesteps (*last ten marks*) of experiments with three or more complete runs. The means
are compared by Welch's t test, the variances by a two-sided F test. **Bold**: the two differ at the 5 % level."""
FIGURES = """\
A line shows the mean of our runs. It is interrupted where some runs end. Timesteps and hours have logarithmic scales.
Our hours in figure 14 are computed for 30 M timesteps from the speed of short runs (those in `alone/`), which were made
one at a time on an otherwise idle machine."""
RULES = """\
All tests use the 5 % level. Beside the p value of a test stands the same corrected for the number of all claims that
are tested so (Holm's method); verdicts use the former. Of a claim about several pairs, it is the largest of the pairs.
*Runs* are ours, layout by layout, or the number of policies. *Difference* is in points, with its 95 % interval, between
the pair of the p value; of stability, how many times as large one standard deviation over runs is as the other (*sd
×*); of training time, percent; of behavior, the measure itself or how many policies show it.

- **Reward**: Welch's t test. A few runs do not show how much results vary, so our standard deviation is pooled with
  that of the original's ten runs. Rewards are *alike* if they do not differ significantly and the confidence interval
  of the difference is within 10 points; the p value is that of two one-sided tests (TOST) with this bound.
- **Stability**: an F test of the variances over runs, pooled over the layouts of each side: where `threshold-0.1` and
  `threshold-0.5` vary more than `threshold-0.0`, they decide (the numbers below show each).
- Both are tested at the largest number of timesteps that runs of all layouts of a claim have reached. Before 30 M
  timesteps, they are tested only if the original's runs confirm the claim both there and at 30 M. So shorter runs can
  confirm a claim, but hardly refute it.
- **Training time**: a t test of the logarithms of the ratios of the hours in figure 14, pair by pair.
- **Click accuracy** of complete runs: a difference counts if it is larger than one percentage point.
- **Behavior**: a claim *holds* if all complete runs of the paper's layouts show it, and *does not hold* if none does.
  Laps are smaller if the mean radius in the last third of the time is below 0.9 times that in the first third. Blinking
  is rare up to 10 blinks in 10 000 decisions. The slow sphere is neither sought nor avoided if the time in it is
  between 1/1.5 and 1.5 times that by chance; this excludes `multiagent`, where the sphere has no effect on the
  character."""
STATEMENTS = """\
What section VI-D of the paper says in words of trained policies is judged by a figure of each policy, a bound, and the
95 % interval of the mean over policies by the t distribution. The statement *holds* if the whole interval is above the
bound, *does not hold* if it is below, and is *undecided* otherwise. It is judged at the largest number of timesteps
that three or more policies of the paper's layouts have trained; before 30 M timesteps it is *undecided*, whatever the
figures are, since the paper speaks of complete runs. Means of ratios are geometric.

- **Faster along x**: the mean speed along x over that along y; bound 1.
- **Changes sides**: changes from the left to the right side of the field, or back, per time on a side on which no bird
  can be hit, over the same on sides with birds; bound 2. Without regard to birds it is 1. A crosshair within 3 units
  of the middle is still on its former side.
- **Half hidden birds**: hits per time of birds of which 25 to 75 % are behind obstacles, over those of birds of the
  same size in full view; bound 0.5. Large birds do not count, because nothing hides them.
- **Dense regions**: hits per time of birds with two or more neighbors within 4 units, over those of birds without any.
  A crowd is not shot at once, so this is below 1 for most policies. So the mean of the threshold policies over that of
  the others is judged, which must be below 1.
- **Triangle**: the fraction of the cursor's laps in the last third of the time limit that are triangles, which means
  that the smallest triangle around the lap's convex hull is smaller than the smallest parallelogram; bound 0.5. Of a
  circle or an ellipse, the parallelogram is smaller. This measure was chosen after a look at the paths of three of
  the policies.
- **Survive**: the fraction of clocks (240 s of an arena) without a death; bound 0.5. For complete runs, which were
  measured before, it is the least that the number of episodes allows.
- **Very frequent**: commands per second; bound 2."""
CONTRADICTIONS = """\
By the same rules, the original's own logs do not confirm these claims of the paper:"""
EVIDENCE = """\
The numbers behind each verdict, with the number of runs in brackets; ± is one standard deviation of runs:"""
BEHAVIOR = """\
Measured by `python -m tools.paper.behavior` on trained policies. Speeds are in units/s, `slow share` is a fraction of
time. For comparison, the original's published bucket-11 network hits 157, 157, 127, 173, 131, 168 and 78 birds in
levels 0 to 6."""
SHORTER = """\
The same of policies of 3 M timesteps, with the schedules and the settings of
[action-spaces](../docs/experiments.md#action-spaces): other settings than those of the paper's layouts, and schedules
that end after 3 M timesteps. *Early* and *late triangles* are of the first and the last third of the time limit."""
EXPERIMENTS = """\
The last figures of all runs. An experiment has a row per length of its runs, over all runs that are at least that long.
In square brackets is the 95 % bootstrap confidence interval of the mean; with two or three runs it is no more than the
lowest and the highest run. The interquartile mean (IQM) leaves out the lowest and the highest quarter of four or more
runs. Hours are from runs on a shared machine. The original's logs are given ± one standard deviation."""
BY_MARKS = """\
The mean of our runs with their number in brackets, then the original's mean ± two standard deviations of a run.
**Bold**: the two means differ significantly by Student's t test, which happens by chance in one of twenty cells. The
first mark of Shooting Birds is lower with 75 arenas than with the original's 15 (record 36 of
[decisions](../docs/decisions.md))."""


def write_report(folder: Path) -> list[Path]:
    """Draw the figures and write the page into a folder of results. Return the paths of the pages written.

    For the project's own results, the table of complete runs is also written into the project's README.
    """
    results = read_results(folder)
    draw_figures(results, folder / "figures")
    pages = {folder / "README.md": page_text(folder, results)}
    if folder.resolve() == RESULTS:
        pages[README] = readme_text(README.read_text(encoding="utf-8"), results)
    for path, text in pages.items():
        path.write_text(text, encoding="utf-8")
    return list(pages)


def page_text(folder: Path, results: Results) -> str:
    """Return the page about the results in a folder."""
    behavior, shorter = _behavior(folder), _behavior(folder / "action-spaces")
    judged = judge_claims(results, behavior, shorter)
    blocks = [
        INTRODUCTION,
        "## Complete runs",
        COMPLETE_RUNS,
        tables.complete_experiments(results),
        EACH_RUN,
        tables.complete_runs(results),
        AGREEMENT,
        tables.agreement(results),
        "## The figures of the paper",
        FIGURES,
        *(f"![{caption}](figures/{name})\n\n{caption}" for name, caption in CAPTIONS.items()),
        "## The paper's claims",
        RULES,
        STATEMENTS,
        tables.claims(judged),
        CONTRADICTIONS,
        tables.contradictions(judged),
        EVIDENCE,
        tables.evidence(judged),
    ]
    if behavior:
        blocks += ["## Learned behavior", BEHAVIOR, *tables.behaviors(behavior)]
    if shorter:
        blocks += [SHORTER, *tables.behaviors(shorter)]
    if (folder / "figures" / "behavior.png").exists():
        blocks.append("![Behavior of trained policies](figures/behavior.png)")
    blocks += [
        "## Every experiment",
        EXPERIMENTS,
        tables.every_experiment(results),
        "## Reward over time",
        BY_MARKS,
        *tables.by_marks(results),
    ]
    return "\n\n".join(blocks) + "\n"


def _behavior(folder: Path) -> Behavior:
    """Return what was measured of the policies of the runs in a folder."""
    path = folder / "behavior.json"
    behavior: Behavior = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return behavior


def readme_text(text: str, results: Results) -> str:
    """Return the text of the project's README with a new table of complete runs between its markers."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{README} has no {BEGIN.strip()} … {END}; add both lines where the table belongs")
    return f"{before}{begin}{tables.complete_experiments(results)}\n{end}{after}"
