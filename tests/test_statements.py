"""The paper's statements about behavior: measures on made-up plays in which they are true or false, and verdicts."""

import math

import numpy as np
import pytest

from joybridge.contract.spec import choose_options
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.levels import OBSTACLES
from tools.paper.behavior import Trace, triangles
from tools.paper.birds import POINTS, Field, dense_hits, half_hidden_hits, hide, measure_birds, side_changes
from tools.paper.statements import STATEMENTS, Figures, judge_statement
from tools.paper.statistics import FAILS, HOLDS, UNDECIDED, UNTESTED
from tools.paper.triangles import is_triangle, laps

pytestmark = pytest.mark.no_cover  # of tools, which are not measured

SECONDS = 0.12


def polygon(corners, per_side) -> np.ndarray:
    """Return one lap on a polygon, so many decisions per side."""
    ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return np.concatenate([np.linspace(a, b, per_side, endpoint=False) for a, b in ends])


def ellipse(per_lap) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, per_lap, endpoint=False)
    return np.stack([3 * np.cos(angle), np.sin(angle)], axis=1)


TRIANGLE, SQUARE, ELLIPSE = (
    polygon([(0, 0), (5, 0), (1, 4)], 8),
    polygon([(0, 0), (3, 0), (3, 3), (0, 3)], 6),
    ellipse(24),
)


# ------------------------------------------------------------------------------------------------------- triangles


@pytest.mark.parametrize(("lap", "answer"), [(TRIANGLE, True), (SQUARE, False), (ELLIPSE, False)])
def test_a_lap_is_a_triangle_whatever_its_place_direction_and_slant(lap, answer):
    random = np.random.default_rng(1)
    for _ in range(20):
        slanted = lap @ random.normal(size=(2, 2)) + random.normal(size=2) * 5
        assert is_triangle(slanted) is answer and is_triangle(slanted[::-1]) is answer
    shaken = [bool(is_triangle(lap + random.normal(scale=0.1, size=lap.shape))) for _ in range(50)]
    assert abs(np.mean(shaken) - answer) < 0.2


def test_a_triangle_with_one_round_side_is_still_one_and_half_a_disc_is_none():
    arc = np.linspace(0, np.pi, 25)
    disc = np.stack([np.cos(arc), np.sin(arc)], axis=1)
    assert is_triangle(np.concatenate([[(0.0, -0.6)], disc[8:17]])) is True
    assert is_triangle(disc[::2]) is False


def test_laps_are_whole_turns_and_a_straight_path_has_neither_laps_nor_a_shape():
    line = np.outer(np.arange(200.0), (1.0, 2.0))
    assert is_triangle(line) is None and list(laps(line, SECONDS)) == []
    assert list(laps(TRIANGLE, SECONDS)) == []  # too short to have a center
    found = list(laps(np.tile(SQUARE, (10, 1)), SECONDS))
    assert len(found) == 9 and {len(lap) for lap in found[2:-2]} == {25}


def trace(path, lanes=3) -> Trace:
    """Return episodes of one time limit, in which the cursor follows a path [decisions, 2] in units of the sensor."""
    cursor = np.repeat(path[:, None], lanes, axis=1)
    ended = np.zeros((len(path), lanes), bool)
    ended[-1] = True
    return Trace(SECONDS, {"cursor": cursor}, {}, ended, {})


def test_triangles_are_told_apart_early_and_late():
    path = np.concatenate([np.tile(ELLIPSE, (20, 1)), np.tile(SQUARE, (20, 1)), np.tile(TRIANGLE, (20, 1))])
    assert triangles(trace(path)) == {"early_triangles": 0.0, "late_triangles": 1.0}
    assert triangles(trace(path[::-1])) == {"early_triangles": 1.0, "late_triangles": 0.0}
    assert triangles(trace(path, lanes=2)) == {"early_triangles": None, "late_triangles": None}
    died = trace(path)
    died.ended[800] = True  # the second episode has no last third
    assert triangles(died)["late_triangles"] is None


# ------------------------------------------------------------------------------------------------------------ birds


def field(decisions=400, birds=2, **changes) -> Field:
    """Return a field of one arena with small birds far apart that are in full view and are never hit."""
    centers = np.zeros((decisions, 1, birds, 2))
    centers[..., 0] = np.linspace(-15, 15, birds)
    made = {
        "crosshair": np.tile([5.0, 0.0], (decisions, 1, 1)),
        "birds": centers,
        "size": np.full((decisions, 1, birds), 2),
        "hidden": np.zeros((decisions, 1, birds)),
        "hit": np.full((decisions, 1), -1),
    }
    return Field(**(made | changes))


def crossing(cleared_stay, stay) -> Field:
    """Return a crosshair that changes sides again and again, and stays for so many decisions on each kind of side."""
    x: list[float] = []
    bird: list[float] = []
    for visit in range(100):
        side, cleared = (-1) ** visit, visit % 4 >= 2
        decisions = cleared_stay if cleared else stay
        x += [9.0 * side] * decisions
        bird += [-8.0 * side if cleared else 8.0 * side] * decisions
    made = field(len(x), birds=1)
    made.crosshair[:, 0, 0], made.birds[:, 0, 0, 0] = x, bird
    return made


@pytest.mark.parametrize(("cleared_stay", "stay", "times"), [(2, 10, 5.0), (10, 10, 1.0), (10, 2, 0.2)])
def test_side_changes_are_counted_per_time_with_and_without_birds_on_the_side(cleared_stay, stay, times):
    assert side_changes(crossing(cleared_stay, stay)) == pytest.approx(times, rel=0.05)


def test_a_crosshair_that_does_not_look_at_the_birds_changes_sides_as_often_when_one_is_cleared():
    random = np.random.default_rng(0)
    blind = field(4000, birds=1)  # changes sides every ten decisions, wherever the bird is
    blind.crosshair[:, 0, 0] = np.where(np.arange(4000) // 10 % 2, 9.0, -9.0)
    blind.birds[:, 0, 0, 0] = np.where(np.repeat(random.integers(2, size=800), 5), 8.0, -8.0)
    assert side_changes(blind) == pytest.approx(1.0, abs=0.15)


def test_a_crosshair_in_the_middle_is_on_its_former_side():
    made = field(400, birds=1)
    made.crosshair[:, 0, 0] = np.where(np.arange(400) % 20 == 0, 2.9, -2.9)  # trembles around the middle
    assert side_changes(made) is None
    made.crosshair[200:, 0, 0] = -9.0
    made.crosshair[:200, 0, 0] = 9.0
    made.birds[:, 0, 0, 0] = -8.0
    made.birds[:100, 0, 0, 0] = 8.0
    made.crosshair[150:200, 0, 0] = 1.0  # leaves at 149, arrives at 200: one change, from a cleared side
    assert side_changes(made) is None  # nothing to compare it with: a side with birds was never left


@pytest.mark.parametrize("rate", [0, 1, 2])
def test_hits_of_half_hidden_birds_are_compared_with_those_in_full_view_of_the_same_size(rate):
    made = field(400)
    made.hidden[:, 0, 0] = 0.5  # bird 0 is half hidden, bird 1 in full view
    made.size[:200] = 1
    made.hit[10:190:20] = 1  # medium: 9 hits in full view
    made.hit[210:390:40] = 1  # small: 5
    made.hit[11 : 11 + 9 * rate] = 0
    made.hit[211 : 211 + 5 * rate] = 0
    lost = sum(made.hit[t, 0] != 1 for t in [*range(10, 190, 20), *range(210, 390, 40)])
    expected = 14 * rate / (14 - lost) if rate else 0.0
    assert half_hidden_hits(made) == pytest.approx(expected, rel=0.1)


def test_large_birds_and_those_that_are_almost_hidden_do_not_count_as_half_hidden():
    made = field(400)
    made.hidden[:, 0, 0] = 0.5
    made.hit[::2] = 1
    made.hit[1::4] = 0
    assert half_hidden_hits(made) == pytest.approx(0.5)
    made.hidden[:, 0, 0] = 0.8
    assert half_hidden_hits(made) is None
    made.hidden[:, 0, 0] = 0.5
    made.size[:] = 0
    assert half_hidden_hits(made) is None


@pytest.mark.parametrize(("crowd", "ratio"), [((1,), 1 / 3), ((1, 2, 3), 1.0), ((), 0.0)])
def test_hits_in_dense_regions_are_compared_with_those_of_birds_that_are_alone(crowd, ratio):
    made = field(400, birds=4)
    made.birds[:, 0, 0, 0] = -15.0  # alone; the other three are within 4 units
    made.birds[:, 0, 1:, 0] = 10.0, 11.0, 12.0
    made.hit[::10] = 0
    for number, bird in enumerate(crowd, 1):
        made.hit[number::10] = bird
    assert dense_hits(made) == pytest.approx(ratio)


def test_birds_out_of_reach_or_wholly_hidden_are_not_open_and_make_no_region_dense():
    made = field(400, birds=4)
    made.birds[:, 0, 1:, 0] = 10.0, 11.0, 12.0
    made.hit[::10] = 0
    made.hidden[:, 0, 3] = 1.0
    assert dense_hits(made) is None and made.open.sum(axis=-1).min() == 3
    made.hidden[:, 0, 3] = 0.9
    made.birds[:, 0, 3] = 12.0, 10.3
    assert dense_hits(made) is None and made.open.sum(axis=-1).max() == 3
    assert measure_birds(made)["dense_hits"] is None


def test_what_hides_a_bird_is_what_stops_a_shot_at_it():
    game = ShootingBirds(choose_options(ShootingBirds.options, {"level": "0"}, "shooting_birds"), {}, 1, 0, 0)
    birds, hidden = game.arenas.birds, np.zeros((1, 10))
    places = {(-12.33, 2.76): 0, (-10.27, -11.5): 0, (5.0, 0.0): 1, (9.4, -1.0): 2, (-1.0, 9.0): 3}
    birds["kind"], birds["z"] = 2, 1.85  # small ones are behind everything
    for number, (x, y) in enumerate(places):
        birds["x"][0, number], birds["y"][0, number] = x, y
    birds["x"][0, 5], birds["y"][0, 5] = 0.3, 0.0  # at the left edge of the barn's wall, which ends at 0.3
    birds["kind"][0, 6], birds["z"][0, 6] = 1, 0.85  # medium: in front of the tree
    birds["x"][0, 6], birds["y"][0, 6] = -12.33, 2.76
    birds["kind"][0, 7], birds["z"][0, 7] = 0, -0.15  # large: in front of the barn
    birds["x"][0, 7], birds["y"][0, 7] = 5.0, 0.0
    getattr(hide, "py_func", hide)(game.arenas, OBSTACLES, POINTS, hidden)  # to compile it takes seconds
    assert hidden[0, :5].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]  # tree, trunk, barn, window, sky
    assert hidden[0, 5] == pytest.approx(0.5, abs=0.1) and hidden[0, 6:8].tolist() == [0.0, 0.0]


# --------------------------------------------------------------------------------------------------------- verdicts


def policies(game, figures, timesteps=30_001_500) -> list[tuple[str, Figures]]:
    """Return policies of a game, by layout and seed, all with the same training."""
    return [(f"{game}/{name}", {"timesteps": timesteps, **figure}) for name, figure in figures.items()]


def three(key, *values) -> dict[str, dict[str, float]]:
    names = ("bucket-3-s0", "bucket-11-s0", "multiagent-s1")
    return {name: {key: value} for name, value in zip(names, values, strict=True)}


FIGURES = {  # of each statement in turn: the figure of a policy that makes it true, and of one that makes it false
    "The crosshair moves": lambda true: {"abs_vx": 30.0 if true else 20.0, "abs_vy": 25.0},
    "The crosshair changes": lambda true: {"side_changes": 5.0 if true else 1.0},
    "Half hidden": lambda true: {"half_hidden_hits": 0.9 if true else 0.1},
    "Late in": lambda true: {"late_triangles": 0.9 if true else 0.1},
    "Most episodes": lambda true: {"clocks_survived": 0.9 if true else 0.1},
    "Commands": lambda true: {"commands_per_decision": 0.6 if true else 0.1},
}


@pytest.mark.parametrize("text", FIGURES)
def test_a_statement_holds_fails_or_is_undecided(text):
    (statement,) = [each for each in STATEMENTS if each.text.startswith(text)]

    def word(*truths):
        names = [f"bucket-3-s{seed}" for seed in range(len(truths))]
        made = {name: FIGURES[text](true) for name, true in zip(names, truths, strict=True)}
        return judge_statement(statement, policies(statement.game, made)).word

    assert word(True, True, True) == HOLDS and word(False, False, False) == FAILS
    assert word(True, False, True) == UNDECIDED
    assert word(True, True) == UNTESTED  # an interval of two policies says nothing


def test_every_statement_but_that_of_dense_regions_is_in_this_list():
    assert len(STATEMENTS) == len(FIGURES) + 1


@pytest.mark.parametrize(("threshold", "word"), [(0.3, HOLDS), (0.7, UNDECIDED), (1.5, FAILS)])
def test_dense_regions_are_skipped_if_threshold_hits_fewer_there_than_the_others(threshold, word):
    (statement,) = [each for each in STATEMENTS if each.less]
    wobble = (0.9, 1.0, 1.1)
    figures = {f"threshold-0.0-s{n}": {"dense_hits": threshold * share} for n, share in enumerate(wobble)}
    figures |= {f"bucket-11-s{n}": {"dense_hits": 0.7 * share} for n, share in enumerate(wobble)}
    assert judge_statement(statement, policies(statement.game, figures)).word == word
    del figures["threshold-0.0-s0"]
    assert judge_statement(statement, policies(statement.game, figures)).word == UNTESTED


def test_the_longest_training_of_enough_policies_counts():
    statement = STATEMENTS[1]
    early = policies(statement.game, three("side_changes", 1.0, 1.0, 1.1), 3_000_150)
    late = policies(statement.game, three("side_changes", 5.0, 5.0, 5.1))
    verdict = judge_statement(statement, early + late)
    assert (verdict.word, verdict.where) == (HOLDS, "at 30 M")
    verdict = judge_statement(statement, early + late[:2])
    assert (verdict.word, verdict.where) == (UNDECIDED, "at 3 M")  # the paper speaks of trained policies
    assert (verdict.runs, verdict.effect) == ("3", "1.03 [0.90, 1.18]")
    assert verdict.evidence.startswith("at 3 M 1.03 [0.90, 1.18] over 3 policies: bucket-11-s0 1, ")
    others = [("shooting_birds/hybrid-s0", late[0][1]), ("shooting_birds/mine", late[0][1])]  # not of the paper
    verdict = judge_statement(statement, early + late[:2] + others)
    assert verdict.where == "at 3 M"
    assert verdict.evidence.endswith("; not counted, at 30 M: bucket-11-s0 5, bucket-3-s0 5, hybrid-s0 5")
    assert judge_statement(statement, []).word == UNTESTED
    assert judge_statement(statement, policies(statement.game, three("side_changes", 0.0, 0.0, 0.0))).word == FAILS


def test_clocks_of_policies_whose_deaths_alone_were_counted_have_a_lower_bound():
    statement = next(each for each in STATEMENTS if each.text.startswith("Most episodes"))
    assert statement.figure({"episodes": 79, "survival_seconds": 70 * 240 / 79}) == pytest.approx(61 / 70)
    assert statement.figure({"episodes": 200, "survival_seconds": 70 * 240 / 200}) == 0.0
    assert statement.figure({"clocks_survived": 0.4, "episodes": 1, "survival_seconds": 240.0}) == 0.4
    assert math.isclose(statement.bound, 0.5)
