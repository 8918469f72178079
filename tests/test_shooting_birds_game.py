"""Shooting Birds as the service runs it: spec, episodes, baseline and pictures."""

import math
from itertools import product
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays, Codec
from joybridge.contract.spec import check_spec
from joybridge.games.locomotion import LOCOMOTIONS
from joybridge.games.shooting_birds.game import CHANNELS, OPTIONS, ShootingBirds
from tests.support.shooting_birds import DEFAULTS, NEAR, STILL, WEIGHTS, action, neutral, new_game, play
from tests.support.wire import pack_step

# --------------------------------------------------------------------------------------------------- spec


@pytest.mark.parametrize("locomotion", LOCOMOTIONS)
def test_every_choice_of_options_has_a_well_formed_spec_that_its_game_keeps(locomotion):
    by_name = {option.name: option for option in OPTIONS}
    assert list(by_name) == list(DEFAULTS) and {n: o.default_choice for n, o in by_name.items()} == DEFAULTS
    for rules, level in product(by_name["rules"].choices, by_name["level"].choices):
        options = {**DEFAULTS, "rules": rules, "locomotion": locomotion, "level": level}
        spec = ShootingBirds.describe(options)
        check_spec(spec)
        (behavior,) = spec.behaviors
        game = new_game(3, **options)
        for values in (game.observe(), game.step([action(3, *neutral(behavior))])):
            for sensor, observed in zip(behavior.sensors, values[0].observations, strict=True):
                assert observed.shape == (3, *sensor.shape) and observed.dtype == np.float32
            assert values[0].rewards.shape == (3, len(behavior.channels)) and values[0].rewards.dtype == np.float32
            Codec(behavior, 3).unpack_step(pack_step(values[0]))


def test_one_decision_is_one_tick_of_0_02_s_and_an_episode_2000_of_them():
    spec = ShootingBirds.describe(DEFAULTS)
    assert (spec.decision_interval, spec.tick_seconds, spec.max_episode_decisions) == (1, 0.02, 2000)


def test_the_original_observes_44_values_with_an_agent_of_2_axes_and_2_buttons():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    assert [list(sensor.shape) for sensor in behavior.sensors] == [[2], [5], [12, 3], [1]]
    assert sum(math.prod(sensor.shape) for sensor in behavior.sensors) == 44
    assert [axis.name for axis in behavior.device.axes] == ["angle", "speed"]
    assert [branch.name for branch in behavior.device.branches] == ["shoot", "reload"]
    assert behavior.agents_per_arena == 1


def test_the_reward_is_the_sum_of_hits_misses_dry_shots_and_reloads():
    assert [(channel.name, channel.default_weight) for channel in CHANNELS] == list(
        zip(("hit", "miss", "dry_shot", "reload", "aimed_hit", "aimed_miss"), WEIGHTS, strict=True)
    )


def test_observations_keep_to_their_bounds():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    values, begin = play(new_game(16), 400), 0
    for sensor in behavior.sensors:
        part = values[:, :, begin : begin + math.prod(sensor.shape)]
        assert part.min() >= sensor.low[0] and part.max() <= sensor.high[0], sensor.name
        begin += part.shape[2]


# ----------------------------------------------------------------------------------------------- episodes


def test_all_arenas_are_truncated_together_after_every_2000_decisions_and_never_terminated():
    game, cut = new_game(3), []
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    for decision in range(1, 4001):
        (step,) = game.step([action(3, (0.3, 0.05), (decision % 90 == 0, decision % 700 == 0))])
        assert not step.terminated.any() and step.truncated.all() == step.truncated.any()
        if step.truncated.any():
            cut.append(decision)
            assert step.ended.tolist() == [0, 1, 2]
            Codec(behavior, 3).unpack_step(pack_step(step))
        else:
            assert len(step.ended) == 0 and step.final_observations is None and step.metrics is None
    assert cut == [2000, 4000]


def last_step(game: ShootingBirds, axes: tuple[float, ...] = STILL) -> Any:
    """Return the step that ends the present episode."""
    game.arenas.tick = 1999
    (step,) = game.step([action(len(game.arenas), axes)])
    assert step.truncated.all()
    return step


def test_the_last_step_brings_the_end_of_one_episode_and_the_beginning_of_the_next():
    game, other = new_game(3), new_game(3)
    step = last_step(game, (0.1, 0.2))
    (unbroken,) = other.step([action(3, (0.1, 0.2))])
    for final, wanted in zip(step.final_observations, unbroken.observations, strict=True):
        assert final.tobytes() == wanted.tobytes()
    for first, wanted in zip(step.observations, game.observe()[0].observations, strict=True):
        assert first.tobytes() == wanted.tobytes()
    assert (step.observations[1][:, :2] != step.final_observations[1][:, :2]).all()
    assert not (game.arenas.tick.any() or game.arenas.shots.any())


def test_a_new_episode_keeps_birds_and_their_clock_and_is_seen_with_the_old_velocity():
    game, other = new_game(3), new_game(3)
    step = last_step(game, (0.1, 0.2))
    other.step([action(3, (0.1, 0.2))])
    assert game.arenas.birds.tobytes() == other.arenas.birds.tobytes()
    assert game.arenas.clock.tolist() == [1, 1, 1]
    assert (step.observations[1][:, 2:] == step.final_observations[1][:, 2:]).all()
    assert step.observations[1][:, 4] == pytest.approx([0.2] * 3, abs=NEAR)


def test_metrics_are_accuracy_shots_hits_and_reloads_of_the_episode():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    assert [metric.name for metric in behavior.metrics] == ["click_accuracy", "shots", "hits", "reloads"]
    game = new_game(2)
    game.arenas.shots, game.arenas.hits, game.arenas.reloads = [8, 0], [2, 0], [3, 1]
    assert last_step(game).metrics.tolist() == [[0.25, 8, 2, 3], [0, 0, 0, 1]]
    assert last_step(game).metrics.tolist() == [[0, 0, 0, 0]] * 2


def test_a_level_option_fixes_the_level_of_every_episode_and_random_does_not():
    game = new_game(64, level="3")
    for begin in (lambda: None, lambda: last_step(game), lambda: game.reset(None, {}), lambda: game.reset(8, {})):
        begin()
        assert (game.arenas.level == 3).all()
    assert set(new_game(64).arenas.level) == set(range(7))


def test_bird_speed_is_a_factor_on_the_speed_of_birds_to_come():
    slow, fast = new_game(64), new_game(64, parameters={"bird_speed": 3.0})
    assert (fast.arenas.birds.vx == 3 * slow.arenas.birds.vx).all()
    before = fast.arenas.birds.vx.copy()
    fast.reset(None, {"bird_speed": 0.5})
    assert (fast.arenas.birds.vx == before).all()
    fast.arenas.birds.x = 21.0
    fast.step([action(64)])
    speeds = abs(fast.arenas.birds.vx)
    assert 0.75 <= speeds.min() < 0.8 and 2.9 < speeds.max() <= 3.0


def test_reset_begins_new_episodes_among_the_same_birds():
    game = new_game(5)
    play(game, 20)
    birds, place = game.arenas.birds.tobytes(), game.arenas.x.copy()
    game.reset(None, {})
    assert game.arenas.birds.tobytes() == birds and (game.arenas.x != place).all()
    assert not game.arenas.tick.any() and game.arenas.clock.tolist() == [20] * 5


# -------------------------------------------------------------------------------- baseline and pictures


def test_random_buckets_earn_about_minus_645_and_hit_with_0_75_percent():
    game, random = new_game(63, seed=1), np.random.default_rng(0)
    game.arenas.level = np.arange(63) % 7
    reward = np.zeros(63)
    for _ in range(2000):
        axes = (random.integers(11, size=(63, 2)) / 5 - 1).astype(np.float32)
        button = random.integers(3, size=63)  # shoot, reload or neither
        (step,) = game.step([ActArrays(axes, np.stack([button == 0, button == 1], axis=1).astype(np.int32))])
        reward += step.rewards @ WEIGHTS
    assert reward.mean() == pytest.approx(-645, abs=20)
    assert step.metrics is not None
    assert step.metrics[:, 0].mean() == pytest.approx(0.0075, abs=0.0015)


@pytest.mark.parametrize("level", range(7))
def test_every_level_is_drawn_as_a_picture_of_the_specs_size(level):
    game = new_game(level=str(level))
    size = ShootingBirds.describe(DEFAULTS).picture
    picture = game.draw(0)
    assert picture.shape == (size.height, size.width, 3) and picture.dtype == np.uint8
    other = new_game(level=str((level + 1) % 7))
    other.arenas.birds, other.arenas.x, other.arenas.y = game.arenas.birds, game.arenas.x, game.arenas.y
    assert (other.draw(0) != picture).any(axis=2).mean() > 0.05


@pytest.mark.parametrize("change", ["birds", "crosshair", "ammo"])
@pytest.mark.promise("D4")
def test_a_picture_shows_the_state_of_its_arena_and_leaves_it_alone(change):
    game = new_game(2)
    arenas: Any = game.arenas
    arenas.birds.x[1, 0], arenas.birds.y[1, 0] = -2.0, 9.0
    arenas.birds.kind[1, 0], arenas.birds.z[1, 0] = 0, -0.15
    arenas.x, arenas.y, arenas.ammo = 3.0, -3.0, 5
    before, state = game.draw(1), arenas.tobytes()
    assert (game.draw(1) == before).all() and arenas.tobytes() == state
    if change == "birds":
        arenas.birds.x[1, 0] += 0.5
    elif change == "crosshair":
        arenas.x[1] += 0.5
    else:
        arenas.ammo[1] -= 1
    assert (game.draw(1) != before).any()
