"""Shooting Birds plays the same bytes again: seeds, arenas, snapshots, and golden hashes."""

import hashlib
import math
from itertools import product
from typing import Any

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.simulator.randomness import BLOCK
from tests.support.shooting_birds import HIT, MISS, new_game, play, saved


def test_an_arena_plays_the_same_bytes_alone_as_among_3_or_64():
    three, many = play(new_game(3), 250), play(new_game(64), 250)
    for arena in (0, 1, 2):
        alone = play(new_game(1, first_arena=arena), 250)[0].tobytes()
        assert three[arena].tobytes() == alone and many[arena].tobytes() == alone
    for first in (20, 63):
        assert play(new_game(1, first_arena=first), 250)[0].tobytes() == many[first].tobytes()


def test_the_same_seed_gives_the_same_bytes_and_another_seed_or_arena_others():
    first = play(new_game(3), 100)
    assert play(new_game(3), 100).tobytes() == first.tobytes()
    assert play(new_game(3, seed=6), 100).tobytes() != first.tobytes()
    assert len({arena.tobytes() for arena in first}) == 3


def test_reset_with_a_seed_gives_the_bytes_of_a_new_game_with_that_seed():
    game = new_game(3, seed=1, first_arena=4, locomotion="unit_circle", level="2")
    play(game, 150)
    game.reset(9, {})
    assert play(game, 150).tobytes() == play(new_game(3, seed=9, first_arena=4, level="2"), 150).tobytes()


@pytest.mark.parametrize("rules", ["original", "corrected"])
def test_a_restored_game_continues_to_the_same_bytes(rules):
    game = new_game(5, rules=rules, parameters={"bird_speed": 1.5})
    game.arenas.tick = 1900
    play(game, 60)
    state = saved(game)
    wanted = play(game, 200, begin=60)  # into the next episode
    other = new_game(5, rules=rules, seed=99)
    other.restore(state)
    assert play(other, 200, begin=60).tobytes() == wanted.tobytes()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("level", level) for level in (-1, 7, 9)),
        *(("fixed_level", level) for level in (-2, 7)),
        *(("ammo", ammo) for ammo in (-1, 9)),
        *(("tick", tick) for tick in (-1, 2001)),
        *product(("x", "y", "vx", "vy", "heading"), (math.nan, -math.inf)),
        *(("bird_speed", speed) for speed in (-0.1, 4.1, math.nan)),
    ],
)
def test_restore_refuses_a_crosshair_gun_episode_or_parameter_that_cannot_be(field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas[field][1] = value
    refuses(game, "outside", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


@pytest.mark.parametrize(
    ("field", "value"),
    [("kind", -1), ("kind", 3), ("kind", 7), *product(("x", "y", "z", "vx", "vy", "phase"), (math.nan, math.inf))],
)
def test_restore_refuses_a_bird_that_cannot_be(field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas.birds[field][1, 7] = value
    refuses(game, "outside", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("cursor", -1),
        ("cursor", BLOCK + 1),
        ("block", -1),
        ("episodes", 0),
    ],
)
def test_restore_refuses_random_streams_and_numbers_of_episodes_that_cannot_be(part, value):
    game = new_game(2)
    values = game.save()[part].copy()
    values[-1] = value
    refuses(game, "outside", **{part: values})


def test_restore_refuses_arenas_in_different_ticks_of_their_episodes():
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas.tick[1] = 1999
    refuses(game, "tick", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


def refuses(game: ShootingBirds, because: str, **parts: Array) -> None:
    """Check that a game refuses its own state with some parts changed, and plays on as if nothing had been."""
    play(game, 5)
    state = saved(game)
    with pytest.raises(ValueError, match=because):
        game.restore({**state, **parts})
    now = saved(game)
    assert all(now[name].tobytes() == state[name].tobytes() for name in state)


GOLDEN = {
    "original": "0cb994be5e85c09c5727b31c4989452fb2c3882cc6ff5d70323f83b8d3b322ec",
    "corrected": "3e65ce1a6bedaee65a8babf577d93ef560b57272032504582657df95712a4a38",
}


@pytest.mark.parametrize("rules", GOLDEN)
def test_a_seeded_run_gives_the_bytes_it_always_gave(rules):
    game = new_game(5, rules=rules, seed=2024)
    game.arenas.tick = 1800
    values = play(game, 300)
    assert (values[:, :, -6:] != 0).sum(axis=(0, 1)).min() >= 5  # every channel is in play
    assert hashlib.sha256(values.tobytes()).hexdigest() == GOLDEN[rules]


def digest_of_a_short_run() -> str:
    """Return the hash of a run that shoots, reloads, sinks into walls and replaces birds within 30 steps."""
    values = []
    for rules in ("original", "corrected"):
        game = new_game(2, rules=rules)
        arenas: Any = game.arenas
        arenas.x, arenas.y = [17.0, -17.3], [9.0, -9.6]
        arenas.birds.x[:, :4], arenas.birds.y[:, :4] = arenas.x[:, None], arenas.y[:, None]
        arenas.birds.x[:, 4] = 21.0
        values.append(play(game, 30))
        assert values[-1][:, :, -6 + HIT].sum() > 0 and values[-1][:, :, -6 + MISS].sum() < 0
    return hashlib.sha256(np.concatenate(values).tobytes()).hexdigest()
