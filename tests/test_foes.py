"""How birds fly under the option `birds`: turns, reactions, blinks, and the same bytes after a snapshot."""

import hashlib
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import check_spec, choose_options
from joybridge.games.shooting_birds import foes
from joybridge.games.shooting_birds.game import ShootingBirds

AWAY = 1000.0
GOLDEN = {
    "jinking": "e64bdb668329fb87",
    "dodging": "ab6039b838209c89",
    "blinking": "be00ef9b60b1b5dd",
    "mixed": "9277820e01c45a54",
}


def new_game(birds: str, arenas: int = 1, seed: int = 5, parameters: dict[str, float] | None = None) -> ShootingBirds:
    options = choose_options(ShootingBirds.options, {"birds": birds, "locomotion": "axes"}, "shooting_birds")
    return ShootingBirds(options, parameters or {}, arenas, 0, seed)


def rest(game: ShootingBirds, steps: int = 1) -> Any:
    """Play without an action; return the records of the birds after each step, [steps, arenas, birds]."""
    lanes, seen = len(game.arenas), []
    for _ in range(steps):
        game.step([ActArrays(np.zeros((lanes, 2), np.float32), np.zeros((lanes, 2), np.int32))])
        seen.append(game.arenas.birds.copy())
    return np.stack(seen)


def sweep(game: ShootingBirds, steps: int) -> str:
    """Play random actions; return the digest of what is observed and paid."""
    random, digest, lanes = np.random.default_rng(3), hashlib.sha256(), len(game.arenas)
    for _ in range(steps):
        axes = random.uniform(-1.0, 1.0, (lanes, 2)).astype(np.float32)
        (step,) = game.step([ActArrays(axes, random.integers(0, 2, (lanes, 2)).astype(np.int32))])
        for values in (*step.observations, step.rewards):
            digest.update(values.tobytes())
    return digest.hexdigest()[:16]


def one_bird(birds: str, x: float, y: float, parameters: dict[str, float] | None = None) -> ShootingBirds:
    """Return a game with the crosshair in the middle and one large bird at (x, y), bound for the right at 2 / s."""
    game = new_game(birds, parameters=parameters)
    arenas: Any = game.arenas
    arenas.x = arenas.y = 0.0
    arenas.birds.y[0, 1:] = AWAY
    bird = arenas.birds[0, 0:1]
    bird["x"], bird["y"], bird["kind"], bird["habit"] = x, y, 0, foes.HABITS.index(birds)
    bird["vx"], bird["vy"], bird["speed"], bird["bound"], bird["aim_x"], bird["aim_y"] = 2.0, 0.0, 2.0, 1.0, 1.0, 0.0
    return game


@pytest.mark.parametrize("birds", foes.HABITS)
def test_every_way_to_fly_keeps_to_its_spec_and_to_the_sky(birds):
    game = new_game(birds, arenas=20)
    check_spec(ShootingBirds.describe(choose_options(ShootingBirds.options, {"birds": birds}, "shooting_birds")))
    seen = rest(game, 1500)
    assert (abs(seen["x"]) <= 20.4).all() and (abs(seen["y"]) <= 10.2).all()
    habits = set(np.unique(seen["habit"]))
    assert habits == ({0, 1, 2, 3} if birds == "mixed" else {foes.HABITS.index(birds)})


def test_a_jinking_bird_turns_by_no_more_than_the_turn_rate_and_keeps_its_speed():
    game = new_game("jinking", arenas=30, parameters={"turn_rate": 4.0})
    seen = rest(game, 300)
    speed = np.hypot(seen["vx"], seen["vy"])
    stayed = (abs(np.diff(seen["x"], axis=0)) < 1.0) & (abs(seen["y"][1:]) < 9.3)
    assert (abs(np.diff(speed, axis=0))[stayed] < 1e-9).all()
    heading = np.arctan2(seen["vy"], seen["vx"])
    turned = abs((np.diff(heading, axis=0) + np.pi) % (2 * np.pi) - np.pi)[stayed]
    assert turned.max() <= 4.0 * 0.02 + 1e-9 and np.mean(turned > 0.079) > 0.1


def test_a_jinking_bird_goes_on_to_its_side():
    seen = rest(new_game("jinking", arenas=30), 400)
    assert (seen["vx"] * seen["bound"] > 0).mean() > 0.95


@pytest.mark.parametrize(("delay", "begins"), [(0.0, 1), (0.1, 6), (0.3, 16)])
def test_a_dodging_bird_flees_after_its_reaction_delay(delay, begins):
    game = one_bird("dodging", -2.0, 0.5, {"reaction_delay": delay, "turn_rate": 50.0})
    seen = rest(game, 30)[:, 0, 0]
    speed = np.hypot(seen["vx"], seen["vy"])
    assert np.flatnonzero(speed > 2.1)[0] + 1 == begins
    flight = seen[begins + 5]
    assert flight["vx"] < 0 and flight["vy"] > 0  # away from the crosshair, although it is bound for the right
    assert np.hypot(flight["vx"], flight["vy"]) == pytest.approx(8.0)


def test_a_dodging_bird_goes_on_as_before_when_it_has_fled():
    game = one_bird("dodging", -6.5, 0.5, {"reaction_delay": 0.0, "turn_rate": 50.0})
    seen = rest(game, 30)[:, 0, 0]
    assert seen["vx"][28] == pytest.approx(2.0) and seen["vy"][28] == pytest.approx(0.0)


@pytest.mark.parametrize(("radius", "notices"), [(2.9, False), (3.1, True), (0.0, False)])
def test_a_dodging_bird_notices_the_crosshair_within_the_reaction_radius(radius, notices):
    game = one_bird("dodging", 3.0, 0.0, {"reaction_radius": radius, "reaction_delay": 0.0})
    assert (rest(game, 2)[1, 0, 0]["timer"] != 0) == notices


@pytest.mark.parametrize("period", [0.5, 2.0])
def test_a_blinking_bird_is_elsewhere_once_per_blink_period_on_average(period):
    seen = rest(new_game("blinking", arenas=40, parameters={"blink_period": period, "bird_speed": 0.2}), 1000)
    jumps = np.maximum(abs(np.diff(seen["x"], axis=0)), abs(np.diff(seen["y"], axis=0)))
    inside = (abs(seen["x"][1:]) < 19.0) & (jumps < 10.0)
    assert jumps[inside].max() <= 4.1
    assert 400 * 20 / (jumps[inside] > 0.15).sum() == pytest.approx(period, rel=0.15)


@pytest.mark.parametrize("birds", foes.HABITS[1:])
def test_a_restored_game_with_such_birds_continues_to_the_same_bytes(birds):
    game = new_game(birds, arenas=3)
    sweep(game, 200)
    state = {name: values.copy() for name, values in game.save().items()}
    wanted = sweep(game, 200)
    other = new_game(birds, arenas=3, seed=99)
    other.restore(state)
    assert sweep(other, 200) == wanted


@pytest.mark.parametrize("birds", GOLDEN)
def test_a_seeded_run_with_such_birds_gives_the_bytes_it_always_gave(birds):
    assert sweep(new_game(birds, arenas=4, seed=2024), 600) == GOLDEN[birds]


def test_the_parameters_of_straight_birds_change_nothing():
    plain = sweep(new_game("straight", arenas=2), 100)
    others = {"turn_rate": 1.0, "reaction_radius": 9.0, "reaction_delay": 0.5, "blink_period": 0.2}
    assert sweep(new_game("straight", arenas=2, parameters=others), 100) == plain
    assert sweep(new_game("mixed", arenas=2, parameters=others), 100) != sweep(new_game("mixed", arenas=2), 100)
