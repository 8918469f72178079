"""Ratings: the maximum likelihood of a log of matches, checked in closed form and against choix; the log itself."""

import math
from collections.abc import Sequence
from itertools import permutations

import choix
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joybridge.compare.rating import GHOST_MATCHES, POINTS, rate
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.policy.seats import places_of
from joybridge.run.matches import Match, payoff, read_matches, seat_shares, write_matches


def matches(*rows: tuple[str, Sequence[float]]) -> list[Match]:
    """Return matches from the players of their seats, a letter each, and their places."""
    return [Match(players=tuple(players), places=tuple(places)) for players, places in rows]


def drawn_matches(strengths: np.ndarray, seats: int, count: int) -> list[Match]:
    """Draw matches without shared places from the model of Plackett and Luce."""
    rng = np.random.default_rng(5)
    drawn = []
    for _ in range(count):
        players = rng.permutation(len(strengths))[:seats]
        times = rng.exponential(1 / np.exp(strengths[players]))
        drawn.append(Match(players=tuple(map(str, players)), places=tuple(places_of(-times).tolist())))
    return drawn


def values(log: list[Match], anchor: str, ghost_matches: float = GHOST_MATCHES) -> dict[str, float]:
    found = rate(log, anchor, resamples=0, ghost_matches=ghost_matches)
    return {player: rating.value for player, rating in found.items()}


@pytest.mark.parametrize("seats", [2, 4])
def test_ratings_without_shared_places_are_those_of_choix(seats):
    log = drawn_matches(np.array([0.0, 0.5, 1.0, 1.5, -1.0]), seats, 300)
    rankings = [tuple(int(m.players[seat]) for seat in np.argsort(m.places)) for m in log]
    theirs = choix.opt_rankings(5, rankings, tol=1e-10)
    ours = values(log, "0", ghost_matches=0)
    assert [ours[str(i)] for i in range(5)] == pytest.approx(POINTS * (theirs - theirs[0]), abs=0.01)


def test_the_rating_of_a_pair_with_draws_is_the_ratio_of_its_wins():
    # With two players the model has as many parameters as there are results, so chances are the observed frequencies.
    log = matches(*[("ab", [1, 2])] * 60, *[("ba", [1, 2])] * 20, *[("ab", [1.5, 1.5])] * 40)
    assert values(log, "b", ghost_matches=0)["a"] == pytest.approx(POINTS * math.log(60 / 20), abs=1e-4)


def test_a_shared_first_place_rates_its_players_alike_and_above_the_loser():
    log = matches(*[("abc", [1.5, 1.5, 3])] * 5, *[("abc", [3, 1.5, 1.5])] * 2, *[("abc", [1.5, 3, 1.5])] * 2)
    found = values(log, "c")
    assert found["a"] == pytest.approx(found["b"], abs=1e-6) and found["a"] > 50


def test_who_never_loses_has_a_finite_rating_that_more_matches_raise():
    few, many = (values(matches(*[("ab", [1, 2])] * count), "b")["a"] for count in (5, 50))
    assert 0 < few < many < 2000
    # By symmetry a is as far above the ghost as b is below it: 5 (1 - p(2x)) + g (1 - 2 p(x)) = 0.
    x = few / POINTS / 2
    ahead, above = (1 / (1 + math.exp(-log)) for log in (2 * x, x))
    assert 5 * (1 - ahead) + GHOST_MATCHES * (1 - 2 * above) == pytest.approx(0, abs=1e-6)


def test_matches_that_are_all_drawn_rate_their_players_alike():
    assert values(matches(*[("ab", [1.5, 1.5])] * 30), "a") == pytest.approx({"a": 0, "b": 0}, abs=1e-6)


@given(st.permutations(range(24)))
def test_the_order_of_matches_and_of_seats_does_not_matter(order):
    log = matches(*((p, [1, 2, 3.5, 3.5]) for p in map("".join, permutations("abcd"))))[:20]
    log += matches(*[("abcd", [1, 2, 3, 4])] * 4)
    shuffled = [Match(players=log[i].players[::-1], places=log[i].places[::-1]) for i in order]
    assert values(shuffled, "a") == pytest.approx(values(log, "a"), abs=1e-3)


def test_intervals_contain_the_truth_and_shrink_with_more_matches():
    truth = np.array([0.0, 0.6, 1.2, -0.5])
    few, many = (rate(drawn_matches(truth, 3, count), "0", seed=1) for count in (60, 960))
    inside = [many[str(i)].low <= POINTS * truth[i] <= many[str(i)].high for i in range(4)]
    assert all(inside)
    assert [*many["0"]] == [0, 0, 0]
    ratio = (few["2"].high - few["2"].low) / (many["2"].high - many["2"].low)
    assert 2.5 < ratio < 6  # 4, that of the square roots
    assert list(many) == ["2", "1", "0", "3"]  # the best first


def test_too_many_seats_with_shared_places_are_refused_before_memory_is_full():
    players = tuple("abcdefghijklmnopqrst")
    matches = [
        Match(players=players, places=tuple(np.random.default_rng(i).integers(1, 4, 20).tolist())) for i in range(9)
    ]
    with pytest.raises(ConfigError, match=r"with 20 seats, and places that up to \d+ share, .* rate fewer matches"):
        rate(matches, "a")


def test_an_anchor_that_has_not_played_is_refused():
    with pytest.raises(ValueError, match="the anchor 'z' has played no match; players are a, b"):
        rate(matches(("ab", [1, 2])), "z")


def test_pairs_and_seats_count_a_shared_place_half():
    log = matches(("aab", [1, 2.5, 2.5]), ("bca", [3, 1, 2]))
    found = payoff(log, ["a", "b"])
    assert found.met.tolist() == [[0, 3], [3, 0]] and found.ahead.tolist() == [[0, 2.5], [0.5, 0]]
    assert np.isnan(found.share[0, 0]) and found.share[0, 1] == pytest.approx(2.5 / 3)
    assert seat_shares(log).tolist() == [0.5, 0.5, 0]
    assert seat_shares(matches(("ab", [1.5, 1.5]))).tolist() == [0.5, 0.5]


def test_equal_scores_share_the_mean_of_their_places():
    assert places_of(np.array([3.0, 5.0, 3.0 + 1e-9, -1.0])).tolist() == [2.5, 1.0, 2.5, 4.0]


def test_a_log_is_read_back_and_a_damaged_row_is_named(tmp_path):
    assert read_matches(tmp_path) == []
    log = [Match(players=("ä", "b"), places=(1.5, 1.5), seed=2**63, arena=3, episode=4)]
    write_matches(tmp_path, log)
    assert read_matches(tmp_path) == log
    for row, problem in {
        '{"players": ["a"], "places": [1]}': "players: ",
        '{"players": ["a", "b"], "places": [1]}': "2 players have 1 places",
        '{"players": ["a", "b"], "places": [1, NaN]}': "places.1",
        '{"players": ["a", "b"], "pla': "Invalid JSON: ",
    }.items():
        (tmp_path / "matches.jsonl").write_text(f"{log[0].model_dump_json()}\n{row}\n")
        with pytest.raises(CheckpointError, match=r"matches.jsonl, line 2, is no match: .*; delete it") as caught:
            read_matches(tmp_path)
        assert problem in str(caught.value)
