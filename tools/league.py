"""What makes players of the complete Beastly Rivals strong: `python -m tools.league --seeds 0,1,2`.

Trains policies with the settings of `configs/beastly_rivals_full/league.yaml` and what `KINDS` changes, and lets them
play against scripts, their former selves and each other. Runs, evaluations and tournaments in `runs/league` that are
complete are not repeated. Writes `results/league/README.md`, and what is behind it, `numbers.json`.
"""

import argparse
import json
from collections.abc import Sequence
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any, NamedTuple

from joybridge.compare.page_parts import table
from joybridge.run.trained import find_trained
from tools.command_line import joybridge
from tools.paper.statistics import above_effect, sample, welch_p
from tools.several import RESULTS, RUNS, filled, train

CONFIG = Path("configs/beastly_rivals_full/league.yaml")
FOLDER = RUNS / "league"
SCRIPTS = ("script:flee", "script:at_once", "script:patient")
MATCHES = 2000  # of an evaluation, and of a tournament


class Kind(NamedTuple):
    """Runs that differ in their seeds only."""

    timesteps: int
    changes: tuple[str, ...] = ()


LEAGUE, SHORT = "league", 10_000_000
SAMPLINGS = ("pfsp_hard", "latest", "uniform")
LAYOUTS = ("bucket-11", "threshold-0.0", "multiagent")  # beside hybrid, which the others have
KINDS = {
    LEAGUE: Kind(40_000_000),
    **{sampling: Kind(SHORT, (f"opponents.sampling={sampling}",)) for sampling in SAMPLINGS},
    **{layout: Kind(SHORT, (f"layout={layout}",)) for layout in LAYOUTS},
}
GROWTH = 8  # policies of a run in the tournament of its training
EARLY = 5  # of its past policies, the first ones
SHOWN = {"passes": "passes", "ball_share": "time with the ball", "kills": "kills"}  # metrics beside `won`
Numbers = dict[str, Any]  # as JSON has them


def main() -> None:
    """Train and play what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0,1,2", help="default %(default)s")
    parser.add_argument("--layout-seeds", default="0", help="of layouts but hybrid; default %(default)s")
    options = parser.parse_args()
    seeds, fewer = options.seeds.split(","), options.layout_seeds.split(",")
    numbers = found([f"s{seed}" for seed in seeds], [f"s{seed}" for seed in fewer])
    folder = RESULTS / "league"
    folder.mkdir(exist_ok=True)
    (folder / "numbers.json").write_text(json.dumps(numbers, indent=1) + "\n")
    (folder / "README.md").write_text(page(numbers), encoding="utf-8")


def found(seeds: Sequence[str], fewer: Sequence[str]) -> Numbers:
    """Train and play what is missing, and return all that the page needs. fewer: seeds of other layouts."""
    runs = {kind: [learn(kind, seed) for seed in (fewer if kind in LAYOUTS else seeds)] for kind in KINDS}
    league, hybrid = runs[LEAGUE], runs[SAMPLINGS[0]]
    quarters = [quarter(run) for run in league]
    return {
        "seeds": list(seeds),
        "scripts": [against(run, *SCRIPTS) for run in league],
        "quarter": [against(run, f"{run}@{timesteps}") for run, timesteps in zip(league, quarters, strict=True)],
        "quarters": quarters,
        "samplings": tournament("samplings", [run for kind in SAMPLINGS for run in runs[kind]], 1),
        "layouts": tournament("layouts", [*hybrid, *(run for layout in LAYOUTS for run in runs[layout])], 1),
        "growth": [grow(run, seed) for run, seed in zip(league, seeds, strict=True)],
    }


def learn(kind: str, seed: str) -> Path:
    """Train a run if it is not complete, and return its folder."""
    run, (timesteps, changes) = FOLDER / f"{kind}-{seed}", KINDS[kind]
    # With one group it is as fast if two runs share a machine.
    train(CONFIG, run, timesteps, ["pipeline_groups=1", *changes, f"seed={seed[1:]}"])
    return run


def quarter(run: Path) -> int:
    """Return after how many timesteps the policy was added to the pool that is nearest to a quarter of the training."""
    kept = [one.timesteps for one in find_trained(run, 1000)]
    return min(kept, key=lambda timesteps: abs(timesteps - max(kept) / 4))


def grow(run: Path, seed: str) -> Numbers:
    """Let policies of a run play a tournament: some from all of its training, and the first ones in its pool."""
    first = [one.timesteps for one in find_trained(run, 1000)][:EARLY]
    spread = {one.timesteps for one in find_trained(run, GROWTH)}
    early = [f"{run}@{timesteps}" for timesteps in first if timesteps not in spread]
    return tournament(f"growth-{seed}", [run], GROWTH, [*early, *SCRIPTS]) | {"first": first}


def against(run: Path, *others: str) -> Numbers:
    """Return the means of a policy's metrics against others, with the half-widths of their 95 % intervals."""
    known = run / f"against-{'-'.join(other.rpartition('/')[2].rpartition(':')[2] for other in others)}.json"
    if not known.exists():
        words = [word for other in others for word in ("--others", other)]
        played = joybridge("evaluate", str(run), "--episodes", str(MATCHES), "--json", *words)
        known.write_text(played.splitlines()[-1])
    (evaluation,) = json.loads(known.read_text()).values()
    return {name: [evaluation[part][name] for part in ("means", "half_widths")] for name in ("won", *SHOWN)}


def tournament(name: str, runs: Sequence[Path], policies: int, others: Sequence[str] = SCRIPTS) -> Numbers:
    """Play a tournament if it is not complete, and return its numbers."""
    folder = FOLDER / f"rating-{name}"
    if not (folder / "rating.json").exists():
        words = [word for other in others for word in ("--others", other)]
        limits = ["--policies", str(policies), "--matches", str(MATCHES), "--output", str(folder)]
        joybridge("rate", *map(str, runs), *limits, *words, "--anchor", SCRIPTS[0])
    numbers: Numbers = json.loads((folder / "rating.json").read_text())
    return numbers


def page(numbers: Numbers) -> str:
    """Return the page about the results."""
    made = (
        f"Made in the checkout by `python -m tools.league`: `{CONFIG}`, four players. `{LEAGUE}` has learned from "
        f"{KINDS[LEAGUE].timesteps:,} timesteps; the others from {SHORT:,}, with what they are named after: how past "
        "policies are drawn (`opponents.sampling`), or another layout than hybrid. In evaluations, a policy plays one "
        f"seat of each of {MATCHES:,} matches, of which it wins 25 % by chance; beside a share is half of its 95 % "
        "interval over matches. In tournaments of as many matches, seats are drawn, and the rating of "
        f"`{SCRIPTS[0]}` is 0."
    )
    blocks = [
        "# Leagues of the complete Beastly Rivals",
        filled(made),
        "## Against scripts, and its former selves",
        _league(numbers),
        "## Which past policies?",
        _samplings(numbers["samplings"]),
        "## Which layout?",
        _ratings(numbers["layouts"]),
        "## Seats",
        filled(_seats([numbers["samplings"], numbers["layouts"], *numbers["growth"]])),
    ]
    return "\n\n".join(blocks) + "\n"


def _league(numbers: Numbers) -> str:
    rows = [["wins against the three scripts", *(_percent(each["won"]) for each in numbers["scripts"])]]
    for name, shown in SHOWN.items():
        rows.append([f"{shown} there", *(f"{each[name][0]:.3g}" for each in numbers["scripts"])])
    rows.append(
        ["wins against three of a quarter of training", *(_percent(each["won"]) for each in numbers["quarter"])]
    )
    rows.append(["timesteps of these", *(f"{timesteps:,}" for timesteps in numbers["quarters"])])
    growth = numbers["growth"]
    rows.append([f"ahead of the first {EARLY} in the pool", *map(_ahead, growth)])
    rows.append([f"of {GROWTH} policies, rated higher than the one before", *(_neighbors(each, 1) for each in growth)])
    rows.append(["lower, beyond the intervals", *(_neighbors(each, -1) for each in growth)])
    return table(["", *(f"seed {seed[1:]}" for seed in numbers["seeds"])], rows)


def _ahead(tournament: Numbers) -> str:
    """Return how often the last policy of a run was ahead of the first ones in its pool, when they met."""
    players = [player for player in tournament["ratings"] if "@" in player]
    timesteps = {int(player.rpartition("@")[2]): [*tournament["ratings"]].index(player) for player in players}
    row = tournament["payoff"][timesteps[max(timesteps)]]
    return ", ".join(f"{row[timesteps[each]]:.0%}" for each in tournament["first"])


def _neighbors(tournament: Numbers, sign: int) -> str:
    """Return how many of the policies are rated higher (1) than the one before, or lower beyond the intervals (-1)."""
    order = sorted(tournament["trained"], key=lambda name: int(tournament["trained"][name]["timesteps"]))
    pairs = list(pairwise(tournament["ratings"][name] for name in order))
    if sign > 0:
        return f"{sum(after['value'] > before['value'] for before, after in pairs)}"
    return f"{sum(after['high'] < before['low'] for before, after in pairs)}"


def _samplings(tournament: Numbers) -> str:
    ratings = {
        kind: [each["value"] for name, each in tournament["ratings"].items() if name.startswith(f"{kind}-s")]
        for kind in SAMPLINGS
    }
    samples = {kind: sample(values) for kind, values in ratings.items()}
    lines = []
    for one, other in combinations(SAMPLINGS, 2):
        value, low, high = above_effect([samples[one]], [samples[other]])
        p = welch_p(samples[one], samples[other])
        lines.append(f"- `{one}` minus `{other}`: {value:.0f} [{low:.0f}, {high:.0f}], p = {p:.2f} (Welch's t test)")
    means = ", ".join(f"`{kind}` {each.mean:.0f}" for kind, each in samples.items())
    return f"{_ratings(tournament)}\n\nMeans over seeds: {means}.\n\n" + "\n".join(lines)


def _ratings(tournament: Numbers) -> str:
    """Return a table of the ratings of a tournament, the best first."""
    rows = [
        [f"`{name.partition('@')[0]}`", f"{each['value']:.0f} [{each['low']:.0f}, {each['high']:.0f}]"]
        for name, each in tournament["ratings"].items()
    ]
    return table(["player", f"rating, of {tournament['matches']:,} matches"], rows)


def _seats(tournaments: Sequence[Numbers]) -> str:
    """Return the share of matches won from each seat, over all tournaments."""
    matches = sum(each["matches"] for each in tournaments)
    seats = [
        sum(each["seats"][seat] * each["matches"] for each in tournaments) / matches
        for seat in range(len(tournaments[0]["seats"]))
    ]
    shares = ", ".join(f"{share:.1%}" for share in seats)
    return f"Of the {matches:,} matches of all tournaments, whose seats were drawn, these were won from each: {shares}."


def _percent(won: Sequence[float]) -> str:
    return f"{100 * won[0]:.0f} % (± {100 * won[1]:.1f})"


if __name__ == "__main__":
    main()
