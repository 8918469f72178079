"""Ratings of players: the maximum likelihood of all finished matches, with bootstrap intervals.

A match is a sequence of choices: of the players without a place, who gets the next one? Players that share a place are
chosen together. The chance of a set is proportional to the geometric mean of the strengths of its members, times a
factor for its size. This is the model of Davidson and Luce (Firth, Kosmidis and Turner, 2019): without shared places
that of Plackett and Luce, and for two players that of Bradley and Terry.

All matches count alike, whatever their order. Ratings are on the scale of Elo: 400 points more, and a player is ten
times as likely to be ahead.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import sparse

from joybridge.compare.estimators import CONFIDENCE, Estimate
from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array
from joybridge.run.matches import Match

POINTS = 400 / math.log(10)  # of a rating, per unit of the logarithm of a strength
RESAMPLES = 200  # of the bootstrap
GHOST_MATCHES = (
    0.5  # that each player has won, and lost, against a ghost: without them, who never lost is infinitely good
)
MAX_TERMS = 2_000_000  # of a likelihood; more take gigabytes
RIDGE = 1e-8  # curvature of the likelihood along strengths that it does not fix, as that of all players together
MAX_ITERATIONS, TOLERANCE = 100, 1e-12


class Choices(NamedTuple):
    """All different choices of some matches. Each has several terms: the sets of players that may be chosen."""

    terms: (
        sparse.csr_array
    )  # [terms, parameters]: a set's share of each player's strength, and of the factor of its size
    begins: Array  # [choices]: the first term of each
    chosen: Array  # [choices]: the term that was chosen
    of_match: Array  # [made]: the match of each choice that was made
    made: Array  # [made]: which of the different choices it was


def rate(
    matches: Sequence[Match],
    anchor: str,
    *,
    seed: int = 0,
    resamples: int = RESAMPLES,
    ghost_matches: float = GHOST_MATCHES,
) -> dict[str, Estimate]:
    """Return the rating of each player with its 95 % interval, the best first; that of `anchor` is 0.

    The intervals are the percentiles of a bootstrap over matches, whose random numbers `seed` fixes. ghost_matches: see
    GHOST_MATCHES. Raises ValueError if the anchor has not played.
    """
    players = sorted({player for match in matches for player in match.players})
    if anchor not in players:
        raise ValueError(f"the anchor {anchor!r} has played no match; players are {', '.join(players)}")
    choices = list_choices(matches, {player: index for index, player in enumerate(players)})
    count, zero, rng = len(players), players.index(anchor), np.random.default_rng(seed)

    def fit(weights: Array, start: Array) -> Array:
        made = np.bincount(choices.made, weights[choices.of_match], len(choices.begins))
        return maximize(choices, made, count, ghost_matches, start)

    best = fit(np.ones(len(matches)), np.zeros(choices.terms.shape[1]))
    drawn = [
        fit(rng.multinomial(len(matches), np.full(len(matches), 1 / len(matches))), best) for _ in range(resamples)
    ]
    ratings = POINTS * np.array([logs[:count] - logs[zero] for logs in (best, *drawn)])
    tail = 100 * (1 - CONFIDENCE) / 2
    low, high = np.percentile(ratings[1:] if resamples else ratings, [tail, 100 - tail], axis=0)
    order = np.argsort(-ratings[0], kind="stable")
    return {players[i]: Estimate(float(ratings[0, i]), float(low[i]), float(high[i])) for i in order}


def list_choices(matches: Sequence[Match], index: Mapping[str, int]) -> Choices:
    """Return the choices that lead to the places of all matches. index: the parameter of each player."""
    different: dict[tuple[tuple[int, ...], tuple[int, ...]], int] = {}
    of_match, made = [], []
    for number, match in enumerate(matches):
        left = [(place, index[player]) for place, player in zip(match.places, match.players, strict=True)]
        for place in sorted(set(match.places)):
            together = tuple(sorted(player for other, player in left if other == place))
            choice = (together, tuple(sorted(player for _, player in left)))
            left = [pair for pair in left if pair[0] != place]
            if len(choice[1]) > 1:  # otherwise there is no choice
                of_match.append(number)
                made.append(different.setdefault(choice, len(different)))
    sizes = sorted({len(together) for together, _ in different} | {1})
    if (most := sum(math.comb(len(left), size) for _, left in different for size in sizes)) > MAX_TERMS:
        seats = max(len(match.players) for match in matches)
        raise ConfigError(
            f"with {seats} seats, and places that up to {sizes[-1]} share, the likelihood of these matches has "
            f"{most:,} terms, expected at most {MAX_TERMS:,}; rate fewer matches, or let the game have a metric "
            "`place` that is not shared"
        )
    rows, columns, shares, begins, chosen = [], [], [], [], []
    terms = 0
    for together, left_players in different:
        begins.append(terms)
        sets = [each for size in sizes for each in combinations(left_players, size)]
        chosen.append(terms + sets.index(together))
        for each in sets:
            tied = [len(index) + sizes.index(len(each)) - 1] if len(each) > 1 else []
            rows += [terms] * (len(each) + len(tied))
            columns += [*each, *tied]
            shares += [1 / len(each)] * len(each) + [1.0] * len(tied)
            terms += 1
    table = sparse.csr_array((shares, (rows, columns)), shape=(terms, len(index) + len(sizes) - 1))
    return Choices(table, *map(np.array, (begins, chosen, of_match, made)))


def maximize(choices: Choices, made: Array, players: int, ghost_matches: float, start: Array) -> Array:
    """Return the parameters of the highest likelihood, by Newton's method: logarithms of strengths and factors.

    made [choices]: how often each choice was made.
    """
    logs = start
    value, gradient, curvature = _likelihood(choices, made, players, ghost_matches, logs)
    for _ in range(MAX_ITERATIONS):
        step = np.linalg.solve(curvature, gradient)
        if gradient @ step < TOLERANCE:
            break
        following = _likelihood(choices, made, players, ghost_matches, logs + step)
        while following[0] < value:  # it went too far
            step /= 2
            following = _likelihood(choices, made, players, ghost_matches, logs + step)
        logs = logs + step
        value, gradient, curvature = following
    return logs


def _likelihood(
    choices: Choices, made: Array, players: int, ghost_matches: float, logs: Array
) -> tuple[float, Array, Array]:
    """Return the logarithm of the likelihood, its gradient, and the negative of its second derivatives."""
    terms, begins = choices.terms, choices.begins
    counts = np.diff(begins, append=terms.shape[0])
    scores = terms @ logs
    scores -= np.repeat(np.maximum.reduceat(scores, begins), counts)
    sums = np.add.reduceat(np.exp(scores), begins)
    chances = np.exp(scores) / np.repeat(sums, counts)
    expected = np.repeat(made, counts) * chances
    means = sparse.csr_array((chances, (np.repeat(np.arange(len(counts)), counts), np.arange(len(chances)))))
    means = means @ terms  # [choices, parameters]
    value = made @ (scores[choices.chosen] - np.log(sums)) - RIDGE / 2 * logs @ logs
    gradient = np.bincount(choices.chosen, made, len(chances)) @ terms - expected @ terms - RIDGE * logs
    curvature = (terms.T * expected @ terms - means.T * made @ means).toarray() + RIDGE * np.eye(len(logs))
    wins = 1 / (1 + np.exp(-logs[:players]))  # chances against the ghost, whose strength is 1
    value += ghost_matches * np.log(wins * (1 - wins)).sum()
    gradient[:players] += ghost_matches * (1 - 2 * wins)
    curvature[range(players), range(players)] += 2 * ghost_matches * wins * (1 - wins)
    return float(value), gradient, curvature
