"""Parameters that are drawn at each episode: how they are distributed, and that nothing but their numbers matters."""

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.games.archer.game import Archer
from joybridge.games.beastly_rivals.game import BeastlyRivals
from joybridge.games.beastly_rivals_full.game import BeastlyRivalsFull
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.simulator import BatchedGame, draw_parameters, parameter
from joybridge.simulator.catalog import Catalog
from joybridge.simulator.game_adapter import batched
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb

PARAMETERS = [parameter("first", -5.0, 5.0, 0.0), parameter("second", 0.001, 1000.0, 1.0)]


def uniform(low, high):
    return pb.Distribution(uniform=pb.Interval(low=low, high=high))


def log_uniform(low, high):
    return pb.Distribution(log_uniform=pb.Interval(low=low, high=high))


def choice(*values):
    return pb.Distribution(choice=pb.Values(values=values))


def key(seed=1, arena=0):
    return np.array([seed, arena], np.uint64)


def drawn(distribution, count=4000, name="second"):
    episodes = (draw_parameters({name: distribution}, PARAMETERS, key(), number) for number in range(count))
    return np.array([values[name] for values in episodes])


# ------------------------------------------------------------------------------------------------ the distributions


def test_uniform_values_fill_their_interval_evenly():
    values = drawn(uniform(2.0, 10.0))
    assert 2.0 <= values.min() < 2.05 and 9.95 < values.max() <= 10.0
    assert values.mean() == pytest.approx(6.0, abs=0.15) and np.mean(values < 4.0) == pytest.approx(0.25, abs=0.03)


def test_the_logarithm_of_log_uniform_values_fills_its_interval_evenly():
    logarithms = np.log10(drawn(log_uniform(0.001, 1000.0)))
    assert -3.0 <= logarithms.min() < -2.98 and 2.98 < logarithms.max() <= 3.0
    assert logarithms.mean() == pytest.approx(0.0, abs=0.1)
    assert np.mean(logarithms < -1.5) == pytest.approx(0.25, abs=0.03)


def test_a_choice_has_each_value_as_often_as_it_stands_there():
    values, counts = np.unique(drawn(choice(1.0, 7.0, 7.0)), return_counts=True)
    assert values.tolist() == [1.0, 7.0] and counts[1] / counts.sum() == pytest.approx(2 / 3, abs=0.03)


@pytest.mark.parametrize("other", [(key(2), 0), (key(1, 1), 0), (key(1, 2**32), 0), (key(), 1)])
def test_each_seed_arena_and_episode_draws_values_of_its_own(other):
    distributions = {"first": uniform(-5.0, 5.0), "second": uniform(0.001, 1000.0)}
    one = draw_parameters(distributions, PARAMETERS, key(), 0)
    assert one == draw_parameters(distributions, PARAMETERS, key(), 0)
    two = draw_parameters(distributions, PARAMETERS, *other)
    assert one["first"] != two["first"] and one["second"] != two["second"]


def test_a_value_does_not_depend_on_which_other_parameters_are_drawn():
    alone = draw_parameters({"second": uniform(1.0, 2.0)}, PARAMETERS, key(), 3)
    both = draw_parameters({"first": choice(1.0), "second": uniform(1.0, 2.0)}, PARAMETERS, key(), 3)
    assert alone == {"second": both["second"]}


# --------------------------------------------------------------------------------------------------------- the games

MATCH = {option.name: option.default_choice for option in BeastlyRivalsFull.options} | {"lives": "0"}
AXES = {"locomotion": "axes"}
GAMES: dict[str, tuple[type[BatchedGame], dict[str, str], str]] = {
    "shooting_birds": (ShootingBirds, choose_options(ShootingBirds.options, AXES, "shooting_birds"), "bird_speed"),
    "beastly_rivals": (BeastlyRivals, choose_options(BeastlyRivals.options, AXES, "beastly_rivals"), "beast_speed"),
    "beastly_rivals_full": (BeastlyRivalsFull, {**MATCH, "pauses": "short"}, "ball_speed"),
    "archer": (batched(Archer), {"observation": "state"}, "size"),
}


def play(name, arenas, first_arena=0, decisions=150):
    """Play alike in every arena, with Resets; return the bytes of each arena, and the parameters of ended episodes.

    A snapshot, if the game has them, is restored into another game in the middle.
    """
    game, options, varied = GAMES[name]
    (behavior,) = game.describe(options).behaviors
    device, agents = behavior.device, behavior.agents_per_arena

    def new(seed):
        made = game(options, {}, arenas, first_arena, seed)
        made.distributions = {varied: uniform(0.5, 1.5)}
        made.reset(seed, {})
        return made

    playing, played, reported = new(7), [], set()
    for number in range(decisions):
        if number == decisions // 2 and game.describe(options).snapshot_bytes_per_arena:
            state = {part: array.copy() for part, array in playing.save().items()}
            playing = new(99)
            playing.restore(state)
        if number % 40 == 39:
            playing.reset(None, {})
        axes = np.full((arenas * agents, len(device.axes)), 0.3 if number % 2 else -0.7, np.float32)
        (step,) = playing.step([ActArrays(axes, np.zeros((arenas * agents, len(device.branches)), np.int32))])
        if len(step.ended):
            reported |= {
                (int(lane) // agents + first_arena, number, float(values[0]))
                for lane, values in zip(step.ended, step.parameters, strict=True)
            }
        columns = [*step.observations, step.rewards]
        lanes = [slice(arena * agents, (arena + 1) * agents) for arena in range(arenas)]
        played.append([b"".join(column[own].tobytes() for column in columns) for own in lanes])
    return list(zip(*played, strict=True)), reported


@pytest.mark.parametrize("name", GAMES)
def test_arenas_draw_the_same_alone_and_together_and_after_a_snapshot(name):
    together, reported = play(name, 4)
    assert len(set(together)) == 4
    for first in (0, 1, 3):
        alone, own = play(name, 1, first)
        assert alone == together[first : first + 1] and own == {one for one in reported if one[0] == first}
    values = [value for _, _, value in reported]
    assert len(set(values)) == len(values) and all(0.5 <= value <= 1.5 for value in values)


def test_a_drawn_parameter_is_what_the_rules_use():
    playing = ShootingBirds(GAMES["shooting_birds"][1], {}, 50, 0, 1)
    playing.distributions = {"bird_speed": choice(0.0, 2.0)}
    playing.reset(1, {})
    speeds = abs(playing.arenas.birds.vx).max(axis=1)
    still = playing.arenas.bird_speed == 0.0
    assert 10 < still.sum() < 40 and not speeds[still].any() and (speeds[~still] > 6.0).all()


# -------------------------------------------------------------------------------------------------------- the session


def opened(**fields):
    session = Session(Catalog({"archer": batched(Archer)}))
    return session, session.answer(pb.PlayRequest(start=pb.Start(game="archer", arenas=1, **fields)))


@pytest.mark.parametrize(
    ("distribution", "reason", "problem"),
    [
        (uniform(0.5, 0.5), pb.REASON_WRONG_DISTRIBUTION, "low 0.5 and high 0.5, expected low below high"),
        (uniform(0.0, 1.0), pb.REASON_PARAMETER_OUT_OF_RANGE, "'size' got 0, expected 0.1..4"),
        (pb.Distribution(), pb.REASON_WRONG_DISTRIBUTION, "empty"),
        (choice(), pb.REASON_WRONG_DISTRIBUTION, "0 values, expected 1 to 100"),
        (choice(*[1.0] * 101), pb.REASON_WRONG_DISTRIBUTION, "101 values"),
        (choice(float("nan")), pb.REASON_PARAMETER_OUT_OF_RANGE, "got nan"),
        (log_uniform(1e-300, 1e10), pb.REASON_WRONG_DISTRIBUTION, "expected numbers whose ratio is finite"),
        (log_uniform(-1.0, 1.0), pb.REASON_WRONG_DISTRIBUTION, "low -1, expected more than 0"),
    ],
)
def test_a_distribution_that_cannot_be_drawn_from_is_refused_with_its_field(distribution, reason, problem):
    with pytest.raises(Refusal, match=problem) as refused:
        opened(distributions={"size": distribution})
    assert (refused.value.reason, refused.value.field) == (reason, "start.distributions[size]")


def test_a_refused_act_changes_nothing():
    session, _ = opened()
    with pytest.raises(Refusal):
        session.answer(pb.PlayRequest(act=pb.Act(distributions={"size": choice(2.0)})))
    assert session.game.distributions == {}
