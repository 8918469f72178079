"""The page of a tournament: Markdown and HTML with the same text, its pictures, and its numbers as JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, PercentFormatter

from joybridge.compare.estimators import Estimate
from joybridge.compare.page_parts import PICTURES, escaped, page_html, picture_block, table, write_files
from joybridge.compare.pictures import COLORS, draw_themes, without_formula
from joybridge.run.matches import Match, Payoff, payoff, seat_shares

CAPTIONS = {
    "payoff": "How often a row's player was ahead of a column's, in per cent; a shared place counts one half",
    "training": "Rating over training, with 95 % intervals",
    "seats": "Share of matches won from each seat; dotted: its share among equals",
}
MAX_NUMBERS = 16  # players up to which the payoffs are written into their cells


@dataclass(frozen=True)
class Tournament:
    """Rated matches.

    ratings: the best first. trained: (run, timesteps) of the players that are policies. command: that repeats it.
    """

    title: str
    matches: Sequence[Match]
    ratings: Mapping[str, Estimate]
    anchor: str
    trained: Mapping[str, tuple[str, int]]
    command: str

    @cached_property
    def payoff(self) -> Payoff:
        """Return who was ahead of whom, the best first."""
        return payoff(self.matches, list(self.ratings))

    @cached_property
    def seats(self) -> list[float]:
        """Return the share of wins of each seat."""
        shares: list[float] = seat_shares(self.matches).tolist()
        return shares

    @cached_property
    def runs(self) -> dict[str, list[tuple[int, Estimate]]]:
        """Return (timesteps, rating) of each policy of the runs of which several have played, in order."""
        found: dict[str, list[tuple[int, Estimate]]] = {}
        for player, (run, timesteps) in self.trained.items():
            if player in self.ratings:
                found.setdefault(run, []).append((timesteps, self.ratings[player]))
        return {run: sorted(points) for run, points in found.items() if len(points) > 1}

    @property
    def shared(self) -> int:
        """The number of matches whose first place is shared."""
        return sum(match.places.count(min(match.places)) > 1 for match in self.matches)


def write_rating_page(tournament: Tournament, folder: Path, figures: str = "") -> list[Path]:
    """Write the page, its pictures and its numbers into a folder. Return the paths of all but the page's pictures.

    figures: see `draw_themes`. Raises StorageError.
    """
    draws = {"payoff": _draw_payoff, "seats": _draw_seats}
    draws |= {"training": _draw_training} if tournament.runs else {}
    drawn = draw_themes({name: partial(draw, tournament) for name, draw in draws.items()}, folder / PICTURES, figures)
    text = page_text(tournament)
    numbers = json.dumps(as_data(tournament), indent=1, ensure_ascii=False) + "\n"
    files = {"page.md": text, "page.html": page_html(text, folder), "rating.json": numbers}
    return [*write_files(files, folder), *drawn]


def page_text(tournament: Tournament) -> str:
    """Return the page as Markdown."""
    matches, ratings = tournament.matches, tournament.ratings
    blocks = [
        f"# {escaped(tournament.title)}: {len(ratings)} players",
        f"{len(matches):,} matches of {len(matches[0].players)}; in {tournament.shared:,} of them "
        f"({tournament.shared / len(matches):.1%}) the first place is shared. Ratings are fitted to all of them at "
        "once by maximum likelihood; shared places are counted as such. A player that is rated 400 points higher is "
        f"ten times as likely to be ahead. {escaped(tournament.anchor)} is 0 by definition. Intervals are 95 % "
        "confidence intervals of a bootstrap over matches.",
        "## Rating",
        rating_table(tournament),
        "## Who is ahead of whom",
        picture_block("payoff", CAPTIONS["payoff"]),
    ]
    if tournament.runs:
        lines = []
        for run, points in tournament.runs.items():
            grown = sum(after.value > before.value for (_, before), (_, after) in pairwise(points))
            lines.append(
                f"- {escaped(run)}: {grown} of {len(points) - 1} policies are rated higher than the one before."
            )
        blocks += ["## Over training", picture_block("training", CAPTIONS["training"]), "\n".join(lines)]
    blocks += ["## Seats", picture_block("seats", CAPTIONS["seats"])]
    blocks += ["## Again", f"```\n{tournament.command}\n```"]
    return "\n\n".join(blocks) + "\n"


def rating_table(tournament: Tournament) -> str:
    """Return a table in Markdown: rating, share of wins and matches of each player."""
    rows = []
    for player, rating in tournament.ratings.items():
        played = [match for match in tournament.matches if player in match.players]
        wins = sum(map(partial(_wins, player), played)) / sum(match.players.count(player) for match in played)
        interval = f"{rating.value:.0f} [{rating.low:.0f}, {rating.high:.0f}]"
        rows.append((escaped(player), interval, f"{100 * wins:.1f} %", f"{len(played):,}"))
    return table(("player", "rating", "wins per seat held", "matches"), rows)


def as_data(tournament: Tournament) -> dict[str, object]:
    """Return all numbers of the page as plain data."""
    shares = tournament.payoff.share.tolist()
    return {
        "title": tournament.title,
        "anchor": tournament.anchor,
        "matches": len(tournament.matches),
        "shared_first_places": tournament.shared,
        "ratings": {player: rating._asdict() for player, rating in tournament.ratings.items()},
        "trained": {player: {"run": run, "timesteps": t} for player, (run, t) in tournament.trained.items()},
        "payoff": [[None if math.isnan(share) else share for share in row] for row in shares],
        "seats": tournament.seats,
    }


def _wins(player: str, match: Match) -> float:
    """Return which part of a match a player has won: who share the first place share the win."""
    winners = [p for p, place in zip(match.players, match.places, strict=True) if place == min(match.places)]
    return winners.count(player) / len(winners)


def _draw_payoff(tournament: Tournament) -> Figure:
    players, share = [without_formula(player) for player in tournament.payoff.players], tournament.payoff.share
    side = min(12.0, 2.5 + 0.5 * len(players))
    figure = Figure(figsize=(side + 1.5, side), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(100 * share, cmap="RdBu", vmin=0, vmax=100, aspect="auto")  # else the layout cuts off labels
    for (row, column), value in np.ndenumerate(share) if len(players) <= MAX_NUMBERS else ():
        if not math.isnan(value):
            ink = "#ffffff" if abs(value - 0.5) > 0.3 else "#1f2328"
            axes.text(column, row, f"{100 * value:.0f}", ha="center", va="center", fontsize=8, color=ink)
    axes.set_xticks(range(len(players)), players, rotation=45, ha="right")
    axes.set_yticks(range(len(players)), players)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.6, format=PercentFormatter(100))
    return figure


def _draw_training(tournament: Tournament) -> Figure:
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots()
    for index, (run, points) in enumerate(tournament.runs.items()):
        color = COLORS[index % len(COLORS)]
        timesteps = [timesteps for timesteps, _ in points]
        values, low, high = zip(*(rating for _, rating in points), strict=True)
        axes.plot(timesteps, values, "o-", color=color, lw=1.8, ms=4, label=without_formula(run))
        axes.fill_between(timesteps, low, high, color=color, alpha=0.15, lw=0)
    others = [player for player in tournament.ratings if player not in tournament.trained]
    for index, player in enumerate(others, len(tournament.runs)):
        color, value = COLORS[index % len(COLORS)], tournament.ratings[player].value
        axes.axhline(value, color=color, lw=1.2, ls=":", label=without_formula(player))
    axes.xaxis.set_major_formatter(EngFormatter(sep="\N{THIN SPACE}"))
    axes.set(xlabel="timesteps", ylabel="rating")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=9)
    return figure


def _draw_seats(tournament: Tournament) -> Figure:
    shares = tournament.seats
    figure = Figure(figsize=(6, 2.8), layout="constrained")
    axes = figure.subplots()
    axes.bar(range(1, len(shares) + 1), shares, 0.6, color=COLORS[0])
    axes.axhline(1 / len(shares), color="#8a8f98", lw=1.2, ls=":")
    axes.set_xticks(range(1, len(shares) + 1))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.grid(visible=False, axis="x")
    axes.set(xlabel="seat", ylabel="matches won")
    return figure
