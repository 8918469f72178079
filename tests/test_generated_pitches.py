"""Pitches of Beastly Rivals that are made from a number: passages, what blocks, what is sensed, and the same bytes."""

import hashlib
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import check_spec, choose_options
from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals import pitches as p
from joybridge.games.beastly_rivals.game import BeastlyRivals
from joybridge.games.level_sets import SETS
from tests.support.sweeps import sweep

BATCH = 10_000
GOLDEN = {"state": "f8ce885f6470554a", "all": "3ca3aab508806ce9"}


def options(**others: str) -> dict[str, str]:
    chosen = {"levels": "generated", "locomotion": "axes", **others}
    return choose_options(BeastlyRivals.options, chosen, "beastly_rivals")


def new_game(arenas: int = 1, first_arena: int = 0, seed: int = 5, **others: str) -> Any:
    return BeastlyRivals(options(**others), {}, arenas, first_arena, seed)


def made(numbers: Array) -> p.Pitches:
    pitches = p.make_pitches(len(numbers))
    p.generate(numbers, np.arange(len(numbers)), pitches)
    return pitches


def check_pitches(numbers: Array) -> None:
    """Check that the center is free, that passages are wide enough, and that the slow sphere is in its bounds."""
    pitches = made(numbers)
    edges, pillars = pitches.edges, pitches.pillars
    there = np.arange(p.MAX_EDGES) < pitches.edge_counts[:, None]
    assert edges[there][:, 2].min() >= 4.2 and abs(np.hypot(*edges[there].T[:2]) - 1.0).max() < 1e-9
    standing = np.arange(p.MAX_PILLARS) < pitches.pillar_counts[:, None]
    distance = np.hypot(pillars[..., 0], pillars[..., 1])
    assert (distance - pillars[..., 2])[standing].min() >= 1.5
    assert (7.125 - distance - pillars[..., 2])[standing].min() >= 0.9
    along = edges[:, :, None, 0] * pillars[:, None, :, 0] + edges[:, :, None, 1] * pillars[:, None, :, 1]
    gaps = edges[:, :, None, 2] - along - pillars[:, None, :, 2]
    assert gaps[there[:, :, None] & standing[:, None, :]].min() >= 0.9 - 1e-9
    apart = np.hypot(*np.moveaxis(pillars[:, :, None, :2] - pillars[:, None, :, :2], -1, 0))
    apart -= pillars[:, :, None, 2] + pillars[:, None, :, 2]
    both = standing[:, :, None] & standing[:, None, :] & ~np.eye(p.MAX_PILLARS, dtype=bool)
    assert apart[both].min() >= 0.9 - 1e-9
    assert (pitches.sphere >= (1.5, 0.4)).all() and (pitches.sphere <= (3.5, 0.8)).all()


def test_pitches_have_passages_and_a_free_center():
    for level_set in SETS.values():
        check_pitches(np.arange(level_set.start, level_set.start + BATCH))


@pytest.mark.nightly
def test_a_million_pitches_have_passages_and_a_free_center():
    for first in range(0, 1_000_000, BATCH):
        check_pitches(np.arange(first, first + BATCH))


def test_a_pitch_depends_on_its_number_alone():
    among, alone = made(np.array([3, 70, 2_999_999])), made(np.array([70]))
    assert all(many[1].tobytes() == one[0].tobytes() for many, one in zip(among, alone, strict=True))
    pitches = made(np.arange(BATCH))
    assert set(np.unique(pitches.edge_counts)) == {0, 1, 2, 3, 4}
    assert set(np.unique(pitches.pillar_counts)) == {0, 1, 2, 3, 4, 5}


def test_every_choice_of_sight_has_a_well_formed_spec_that_the_game_keeps():
    for observation in ("state", "all"):
        spec = BeastlyRivals.describe(options(observation=observation))
        check_spec(spec)
        (seen,) = new_game(2, observation=observation).observe()
        for sensor, values in zip(spec.behaviors[0].sensors, seen.observations, strict=True):
            assert values.shape == (2, *sensor.shape)


def test_pillars_block_character_and_beast_and_edges_hold_the_cursor():
    game, random = new_game(200), np.random.default_rng(0)
    ends = 0
    for k in range(400):
        act = ActArrays(
            random.uniform(-1.0, 1.0, (200, 2)).astype(np.float32), random.integers(0, 2, (200, 2)).astype(np.int32)
        )
        ends += game.step([act])[0].terminated.sum()
        pitches = game.world.pitches
        for body, radius in (("character", 0.28125), ("beast", 0.1925)):
            places = game.arenas[body]
            dx = places["x"][:, None] - pitches.pillars[..., 0]
            dz = places["z"][:, None] - pitches.pillars[..., 1]
            free = np.hypot(dx, dz) - pitches.pillars[..., 2] - radius
            standing = np.arange(p.MAX_PILLARS) < pitches.pillar_counts[:, None]
            assert free[standing].min() > -1e-9, (k, body)
        cursor = game.arenas.cursor
        beyond = pitches.edges[..., 0] * cursor["x"][:, None] + pitches.edges[..., 1] * cursor["z"][:, None]
        there = np.arange(p.MAX_EDGES) < pitches.edge_counts[:, None]
        assert (beyond - pitches.edges[..., 2])[there].max() < 0.5  # two edges may meet in a sharp corner
    assert ends > 50


def test_rays_from_the_character_meet_pillars_and_edges():
    pitches, rays = p.make_pitches(1), np.zeros((p.RAYS, 2), np.float32)
    pitches.edges[0, 0], pitches.edge_counts[0] = (0.0, 1.0, 5.0), 1
    pitches.pillars[0, 0], pitches.pillar_counts[0] = (-3.0, 0.0, 0.5), 1
    p.cast_rays(0.0, 0.0, 0, pitches, rays)
    assert rays[6].tolist() == pytest.approx([2.5 / 7.0, -1.0])  # the boundary is 7.125 away
    assert rays[3].tolist() == pytest.approx([-1.0, 5.0 / 7.0])
    assert (np.delete(rays[:, 0], 6) == -1.0).all()
    p.cast_rays(-3.0, 0.2, 0, pitches, rays)
    assert (rays[[1, 2, 4, 5], 0] < 0.2).all()


def test_an_arena_plays_the_same_bytes_alone_as_among_others():
    among = sweep(new_game(4, observation="all"), 150)
    assert sweep(new_game(1, first_arena=2, observation="all"), 150) == among[2:3]
    assert len(set(among)) == 4


def test_a_restored_game_continues_on_the_same_pitches_to_the_same_bytes():
    game = new_game(3, observation="all")
    sweep(game, 50)
    state = {name: values.copy() for name, values in game.save().items()}
    wanted = sweep(game, 150)
    other = new_game(3, seed=99, observation="all")
    other.restore(state)
    assert sweep(other, 150) == wanted


@pytest.mark.parametrize("observation", GOLDEN)
def test_a_seeded_run_gives_the_bytes_it_always_gave(observation):
    seen = sweep(new_game(3, observation=observation), 200)
    assert hashlib.sha256("".join(seen).encode()).hexdigest()[:16] == GOLDEN[observation]


def digest_of_a_short_run() -> str:
    """Return the hash of a run on pitches."""
    return "".join(sweep(new_game(2), 30))


def test_a_picture_shows_the_pitch():
    game = new_game(2)
    first = game.draw(0)
    game.show_levels(game.arenas.number[::-1].copy())
    assert (game.draw(0) != first).any(axis=2).mean() > 0.02


def test_a_snapshot_moves_nobody_also_in_the_corners():
    game, other = new_game(64), new_game(64, seed=6)
    rng = np.random.default_rng(0)
    for number in range(400):
        if number % 20 == 0:
            axes = np.sign(rng.uniform(-1, 1, (64, 2))).astype(np.float32)  # into the borders
        game.step([ActArrays(axes, np.ones((64, 2), np.int32))])
        if number % 4 == 0:
            other.restore(game.save())
            assert other.arenas.tobytes() == game.arenas.tobytes()
