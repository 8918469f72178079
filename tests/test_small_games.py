"""The small built-in games: what pays, what ends, what is masked, who waits; and each is learned as configured.

That they keep the contract over a real server is the conformance kit's business, in test_check.py.
"""

from pathlib import Path

import numpy as np
import pytest

from joybridge.config.config import load_config
from joybridge.games.archer.game import ARROWS, DRAW, DROP, FLIGHT, LOOSE, PULLS, RADIUS, REST, TURN, Archer
from joybridge.games.archer.game import DECISIONS as ARCHER_DECISIONS
from joybridge.games.marble.game import DECISIONS, FASTEST, PULL, RING, RING_DECISIONS, ROLLS, Marble
from joybridge.games.noughts.game import Noughts, outcome
from joybridge.games.orchard.game import APPLES, COLUMNS, PAUSE, Orchard
from joybridge.games.recall.game import ANSWERS, BACK, COLORS, Recall
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.train import train
from joybridge.simulator import option

LEFT, STAY, RIGHT = range(3)


def begin(game, seed=0, **state):
    """Return an arena after its reset, with these attributes changed, and what reset returned."""
    arena = game()
    arena.rng = np.random.default_rng(seed)
    options = arena.option = {option.name: option.default_choice for option in game.options}
    arena.parameter = {one.name: one.default_value for one in game.describe(options).parameters}
    first = arena.reset()
    for name, value in state.items():
        assert hasattr(arena, name)
        setattr(arena, name, value)
    return arena, first


def until_the_end(arena, timestep, choose):
    """Play an episode with the actions that `choose` makes of timesteps; return the rewards by channel, and the end."""
    total: dict[str, float] = {}
    while not (timestep.terminated or timestep.truncated):
        timestep = arena.step(choose(timestep))
        total = {name: total.get(name, 0.0) + value for name, value in timestep.rewards.items()}
    return total, timestep


# ---------------------------------------------------------------------------------------------------------- orchard


@pytest.mark.parametrize(
    ("column", "lid", "paid"),
    [
        (3, 0, {"apple": 1.0, "sting": 0.0, "shut": 0.0}),
        (3, 1, {"apple": 0.0, "sting": 0.0, "shut": 1.0}),  # it bounces off the lid
        (4, 0, {"apple": 0.0, "sting": 0.0, "shut": 0.0}),
    ],
)
def test_an_apple_pays_in_the_open_basket_under_it(column, lid, paid):
    orchard, _ = begin(Orchard, decisions=PAUSE - 1, apples=[column, 6])
    timestep = orchard.step({"walk": STAY, "lid": lid})
    assert timestep.rewards == paid and orchard.caught == paid["apple"]
    assert orchard.apples[0] == 6  # the higher one is now the lower one


def test_an_apple_pays_only_when_it_has_fallen():
    orchard, _ = begin(Orchard, apples=[3, 3])
    paid = [orchard.step({"walk": STAY, "lid": 0}).rewards["apple"] for _ in range(PAUSE)]
    assert paid == [0.0] * (PAUSE - 1) + [1.0]


@pytest.mark.parametrize(("lid", "stings"), [(0, 1.0), (1, 0.0)])
def test_a_wasp_stings_where_the_lid_is_open(lid, stings):
    orchard, _ = begin(Orchard, wasp=True)
    timestep = orchard.step({"walk": STAY, "lid": lid})
    assert timestep.rewards == {"apple": 0.0, "sting": stings, "shut": float(lid)} and orchard.stings == stings


def test_the_basket_walks_a_column_at_a_time_and_stays_under_the_tree():
    orchard, _ = begin(Orchard)
    places = []
    for walk in [LEFT, LEFT, STAY, LEFT, LEFT, RIGHT, *[RIGHT] * COLUMNS]:
        timestep = orchard.step({"walk": walk, "lid": 0})
        places.append(orchard.place)
        assert timestep.observation["apples"][0] == (orchard.apples[0] - orchard.place) / (COLUMNS - 1)
    assert places == [2, 1, 1, 0, 0, 1, 2, 3, 4, 5, 6, 6, 6]


@pytest.mark.parametrize("seed", range(20))
def test_every_apple_can_be_caught_and_every_wasp_shut_out(seed):
    def perfect(timestep):
        way = timestep.observation["apples"][0]
        return {"walk": STAY + int(np.sign(way)), "lid": int(timestep.observation["wasp"][0])}

    orchard, first = begin(Orchard, seed)
    paid, end = until_the_end(orchard, first, perfect)
    assert end.truncated and end.metrics == {"caught": 1.0, "stings": 0} and paid["apple"] == APPLES
    assert 5 < paid["shut"] < 25 and paid["sting"] == 0.0  # some of the forty decisions in which wasps come


# ----------------------------------------------------------------------------------------------------------- marble


def test_a_tilt_pulls_and_the_marble_keeps_rolling():
    marble, _ = begin(Marble)
    first = marble.step({"tilt_x": 1.0, "tilt_y": -0.5})
    np.testing.assert_allclose(first.observation["marble"], [PULL, -PULL / 2])
    second = marble.step({"tilt_x": 0.0, "tilt_y": 0.0})
    np.testing.assert_allclose(second.observation["speed"], np.array([PULL, -PULL / 2]) * ROLLS / FASTEST)
    np.testing.assert_allclose(second.observation["marble"], np.array([PULL, -PULL / 2]) * (1 + ROLLS))
    np.testing.assert_allclose(second.observation["ring"], marble.ring - marble.place)


def test_a_marble_over_the_edge_is_lost():
    marble, first = begin(Marble)
    _, end = until_the_end(marble, first, lambda _: {"tilt_x": -1.0, "tilt_y": 0.0})
    assert end.terminated and end.metrics["lost"] == 1.0
    assert end.observation["marble"][0] == -1.0 and marble.decisions < DECISIONS


def test_a_marble_at_rest_is_paid_by_how_near_the_ring_is_until_time_is_up():
    marble, first = begin(Marble)
    rings, paid, inside = [], [], 0
    for _ in range(DECISIONS):
        rings.append(marble.ring)
        end = marble.step({"tilt_x": 0.0, "tilt_y": 0.0})
        paid.append(end.rewards["reward"])
        inside += np.hypot(*rings[-1]) < RING
    np.testing.assert_allclose(paid, [max(0.0, 1 - np.hypot(*ring)) for ring in rings])
    assert len({tuple(ring) for ring in rings}) == DECISIONS / RING_DECISIONS
    assert end.truncated and end.metrics == {"inside": inside / DECISIONS, "lost": 0.0}
    assert not first.observation["marble"].any()


@pytest.mark.parametrize("seed", range(5))
def test_a_steady_hand_brings_the_marble_into_each_ring(seed):
    def steady(timestep):
        tilt = (2.0 * timestep.observation["ring"] - 8.0 * FASTEST * timestep.observation["speed"]).clip(-1, 1)
        return {"tilt_x": tilt[0], "tilt_y": tilt[1]}

    marble, first = begin(Marble, seed)
    _, end = until_the_end(marble, first, steady)
    assert end.truncated and end.metrics["inside"] > 0.5


# ----------------------------------------------------------------------------------------------------------- archer


def loose_an_arrow(archer):
    """Draw the string and loose; return the timesteps of each decision until the arrow has landed."""
    choices = [DRAW] * PULLS + [LOOSE] + [REST] * (FLIGHT - 1)
    return [archer.step({"turn": 0.0, "string": choice}) for choice in choices]


def test_the_string_allows_what_it_can_do():
    archer, first = begin(Archer)
    masks = [first.masks["string"], *(timestep.masks["string"] for timestep in loose_an_arrow(archer))]
    drawing, drawn = [True, True, False], [True, False, True]
    assert masks == [drawing] * PULLS + [drawn] + [drawing] * FLIGHT


@pytest.mark.parametrize(("beside", "paid"), [(0.0, 1.0), (0.9, 1.0), (-0.9, 1.0), (1.1, 0.0), (-1.1, 0.0)])
def test_a_balloon_pays_if_it_is_where_the_arrow_arrives(beside, paid):
    lands = 0.8 - DROP * sum(range(1, FLIGHT + 1))
    archer, _ = begin(Archer, slope=0.8, balloon=lands + beside * RADIUS, rise=0.0)
    timesteps = loose_an_arrow(archer)
    assert [timestep.rewards["reward"] for timestep in timesteps] == [0.0] * (len(timesteps) - 1) + [paid]
    assert archer.hits == paid and (archer.balloon == 0.0) == bool(paid)  # another one where it was hit


def test_the_bow_turns_within_its_reach():
    archer, _ = begin(Archer, slope=0.1)
    seen = [archer.step({"turn": turn, "string": REST}).observation["bow"][0] for turn in (-1.0, 0.5, *[1.0] * 9)]
    assert seen[0] == 0.0 and seen[1] == pytest.approx(TURN / 2 / 1.25) and seen[-1] == 1.0


def test_balloons_that_get_away_are_followed_by_others():
    archer, _ = begin(Archer, rise=0.06)
    rises = set()
    for _ in range(100):
        archer.step({"turn": 0.0, "string": REST})
        assert 0.0 <= archer.balloon <= 1.0
        rises.add(archer.rise)
    assert len(rises) > 1


def test_the_episode_ends_when_the_last_arrow_has_landed():
    archer, _ = begin(Archer, arrows=1, slope=0.8, balloon=0.6, rise=0.0, hits=4)
    *before, end = loose_an_arrow(archer)
    assert not any(timestep.terminated or timestep.truncated for timestep in before)
    assert before[-1].masks["string"] == [True, False, False]  # no arrow is left to draw
    assert end.terminated and end.metrics == {"hits": 5, "accuracy": 5 / ARROWS}


def test_an_archer_that_rests_runs_out_of_time():
    archer, first = begin(Archer)
    paid, end = until_the_end(archer, first, lambda _: {"turn": 0.0, "string": REST})
    assert end.truncated and archer.decisions == ARCHER_DECISIONS
    assert paid == {"reward": 0.0} and end.metrics == {"hits": 0, "accuracy": 0.0}


# ---------------------------------------------------------------------------------------------------------- noughts


def play(fields):
    """Play a game by the fields of both players in turn; return the arena, its opener and all timesteps."""
    arena, first = begin(Noughts)
    opener, timesteps = arena.mover, [first]
    for field in fields:
        junk = {"field": 0}  # whatever an agent that waits says does not matter
        timesteps.append(arena.step([{"field": field} if agent == arena.mover else junk for agent in (0, 1)]))
    return arena, opener, timesteps


def test_the_players_take_turns_and_taken_fields_are_masked():
    _, opener, timesteps = play([4, 0, 8])
    for count, pair in enumerate(timesteps):
        mover = (opener + count) % 2
        assert pair[mover].deciding and not pair[1 - mover].deciding and not pair[1 - mover].masks
        free = [field for field, allowed in enumerate(pair[mover].masks["field"]) if allowed]
        assert free == [field for field in range(9) if field not in [4, 0, 8][:count]]
        assert not pair[0].rewards and not pair[1].rewards


def test_each_sees_the_board_from_its_own_side():
    _, opener, timesteps = play([4, 0])
    own, other = timesteps[-1][opener].observation, timesteps[-1][1 - opener].observation
    assert own["own"] == other["other"] == [0, 0, 0, 0, 1, 0, 0, 0, 0]
    assert own["other"] == other["own"] == [1, 0, 0, 0, 0, 0, 0, 0, 0]


ROWS_OF_THREE = [(0, 1, 2), (3, 4, 5), (6, 7, 8), (0, 3, 6), (1, 4, 7), (2, 5, 8), (0, 4, 8), (2, 4, 6)]


@pytest.mark.parametrize("row", ROWS_OF_THREE)
def test_three_in_a_row_win(row):
    others = [field for field in range(9) if field not in row][:2]
    _, opener, timesteps = play([row[0], others[0], row[1], others[1], row[2]])
    assert [pair[0].terminated for pair in timesteps] == [False] * 5 + [True]
    assert timesteps[-1][opener].rewards == {"reward": 1.0} and timesteps[-1][1 - opener].rewards == {"reward": -1.0}
    assert timesteps[-1][opener].metrics["drawn"] == timesteps[-1][1 - opener].metrics["drawn"] == 0.0


def test_a_full_board_is_a_draw_and_perfect_play_is_sound():
    _, _, timesteps = play([4, 0, 8, 2, 1, 7, 6, 3, 5])
    for end in timesteps[-1]:
        assert end.terminated and end.rewards["reward"] == 0.0
        assert end.metrics == {"sound": 1.0, "drawn": 1.0}


def test_a_move_that_gives_the_game_away_is_not_sound():
    # The answer to a corner must be the centre, an edge loses; after that every move but one was the best.
    _, opener, timesteps = play([0, 1, 4, 8, 3, 5, 6])
    assert timesteps[-1][opener].rewards == {"reward": 1.0}
    assert timesteps[-1][opener].metrics["sound"] == 1.0
    assert timesteps[-1][1 - opener].metrics["sound"] == pytest.approx(2 / 3)


def test_the_outcome_of_perfect_play_is_known():
    assert outcome(0, 0) == 0
    corner = 0b1
    assert [-outcome(corner, 1 << answer) for answer in range(1, 9)] == [-1, -1, -1, 0, -1, -1, -1, -1]
    assert outcome(0b11, 0b11000) == 1 and outcome(0b11_000_000, 0b11) == 1
    assert outcome(0b1_000_010, 0b11000) == 0  # the mover must and can block


def test_chance_says_who_begins():
    assert {begin(Noughts, seed)[0].mover for seed in range(10)} == {0, 1}


# --------------------------------------------------------------------------------------------------------- pictures


@pytest.mark.parametrize(
    ("game", "changes"),
    [
        (Orchard, [{"place": 1}, {"apples": [0, 0]}, {"wasp": True}, {"shut": True}, {"caught": 1}, {"stings": 3}]),
        (Marble, [{"place": np.array([0.5, 0.0])}, {"ring": np.zeros(2)}, {"tilt": np.array([1.0, 0.0])}]),
        (Archer, [{"slope": 1.0}, {"pulls": 2}, {"flight": 2}, {"balloon": 0.7}, {"arrows": 3}, {"hits": 1}]),
        (Noughts, [{"marks": [1, 0]}, {"marks": [0, 1]}, {"last": (7, 0)}, {"last": (0, 7)}]),
    ],
)
def test_a_picture_shows_all_that_matters(game, changes):
    pictures = [begin(game, **state)[0].draw() for state in ({}, {}, *changes)]
    assert np.array_equal(pictures[0], pictures[1])
    assert len({picture.tobytes() for picture in pictures}) == 1 + len(changes)


def test_how_a_game_ended_stays_in_sight_until_the_next_move():
    arena, _, _ = play([0, 3, 1, 4, 2])
    arena.reset()
    assert not np.array_equal(arena.draw(), begin(Noughts)[0].draw())
    arena.step([{"field": 4}] * 2)
    assert np.array_equal(arena.draw(), begin(Noughts, marks=arena.marks)[0].draw())


# ----------------------------------------------------------------------------------------------------------- recall


@pytest.mark.parametrize(("task", "back", "answers"), [("cue", 30, 1), ("echo", BACK, ANSWERS)])
def test_a_color_pays_if_it_is_named_when_it_is_asked_for(task, back, answers):
    class Task(Recall):
        options = (option("task", [task]),)

    for late, paid in ((0, 1.0), (1, None)):
        seen: list[list[float]] = []

        def answer(timestep, seen=seen, late=late):
            seen.append(list(timestep.observation["shown"]))
            asked = timestep.observation["asked"] == [1.0]
            assert asked is (len(seen) > back)
            return {"answer": seen[len(seen) - 1 - back - late].index(1.0) if asked and len(seen) > back + late else 0}

        arena, first = begin(Task, seed=3)
        total, end = until_the_end(arena, first, answer)
        assert len(seen) == back + answers and [any(shown) for shown in seen] == [True] * answers + [False] * back
        assert end.terminated and end.metrics["right"] == pytest.approx(total["reward"])
        assert total["reward"] == pytest.approx(paid) if paid else total["reward"] < 0.7


def test_all_colors_are_shown_and_drawn():
    pictures = {int(arena.colors[0]): arena.draw().tobytes() for arena, _ in (begin(Recall, n) for n in range(30))}
    assert len(set(pictures.values())) == len(pictures) == len(COLORS)


# --------------------------------------------------------------------------------------------------------- learning


@pytest.mark.slow
@pytest.mark.parametrize(
    ("game", "metric", "timesteps", "untrained", "trained"),
    [
        ("orchard", "caught", 30_000, 0.15, 0.5),
        ("marble", "inside", 40_000, 0.1, 0.3),
        ("archer", "accuracy", 50_000, 0.3, 0.45),
        ("noughts", "sound", 40_000, 0.65, 0.75),
    ],
)
@pytest.mark.promise("M2")
def test_each_is_learned_as_configured(game, metric, timesteps, untrained, trained, simulator, tmp_path):
    def score(name, *overrides):
        config = load_config(Path(__file__).parents[1] / f"configs/{game}/hybrid.yaml", overrides)
        train(config, tmp_path / name, [simulator], resume=False)
        scores = evaluate(PlaySpec(tmp_path / name, simulator, seed=5), episodes=64, say=lambda _: None)
        (means,) = (score.means for score in scores.values())
        return means[metric]

    assert score("untrained", "stop_at=1", "policy.learning_rate=1e-9") < untrained
    assert score("trained", f"stop_at={timesteps}") > trained
