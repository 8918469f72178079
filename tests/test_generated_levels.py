"""Levels of Shooting Birds that are made from a number: what they hold, which are played, and who can play them."""

import hashlib
from typing import Any

import numpy as np
import pytest

from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.level_sets import SETS
from joybridge.games.shooting_birds import generator, script
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.simulator.compiled import compiled
from tests.support.sweeps import sweep

CELLS = 152  # of a quarter of a unit, along the screen
BATCH = 10_000
GOLDEN = {"state": "5a9157f78e69ab37", "all": "db06101a3533fd41"}


def new_game(
    arenas: int = 1, first_arena: int = 0, seed: int = 5, first: int = 0, count: int = 1000, **options: str
) -> Any:
    chosen = choose_options(
        ShootingBirds.options, {"levels": "generated", "locomotion": "axes", **options}, "shooting_birds"
    )
    return ShootingBirds(chosen, {"first_level": first, "level_count": count}, arenas, first_arena, seed)


def levels_of(numbers: Array) -> generator.Generated:
    levels = generator.make_room(len(numbers))
    generator.generate(numbers, levels)
    return levels


@compiled
def _open_cells(obstacles):
    """Return how many cells along each level no obstacle covers at any height, int64 [levels]."""
    free = np.empty(len(obstacles.box_count), np.int64)
    for i in range(len(free)):
        covered = np.zeros(CELLS, np.bool_)
        for j in range(obstacles.box_count[i]):
            box = obstacles.boxes[i, j]
            covered[int((box[0] + 19.0) * 4) : int((box[2] + 19.0) * 4) + 1] = True
        for j in range(obstacles.disc_count[i]):
            disc = obstacles.discs[i, j]
            covered[int((disc[0] - disc[2] + 19.0) * 4) : int((disc[0] + disc[2] + 19.0) * 4) + 1] = True
        free[i] = CELLS - covered.sum()
    return free


def check_levels(numbers: Array) -> None:
    """Check that each level has obstacles, at least a quarter of open sky less what rounding takes, and birds."""
    levels = levels_of(numbers)
    boxes, discs = levels.obstacles.boxes, levels.obstacles.discs
    assert (levels.obstacles.box_count + levels.obstacles.disc_count > 0).all()
    assert (levels.obstacles.box_count <= boxes.shape[1]).all() and (
        levels.obstacles.disc_count <= discs.shape[1]
    ).all()
    used = np.arange(boxes.shape[1]) < levels.obstacles.box_count[:, None]
    assert abs(boxes[used][:, [0, 2]]).max() <= 19.0 and set(np.unique(boxes[used][:, 4])) <= {0.0, 1.1}
    used = np.arange(discs.shape[1]) < levels.obstacles.disc_count[:, None]
    assert (abs(discs[used][:, 0]) + discs[used][:, 2]).max() <= 19.0 and discs[used][:, 2].min() > 0.0
    assert _open_cells(levels.obstacles).min() >= CELLS // 4 - 2 * generator.MAX_COLUMNS
    flights = levels.flights
    used = np.arange(3) < flights["line_count"][:, None]
    lines = flights["lines"][used]
    assert flights["line_count"].min() >= 1 and (lines[:, 1] - lines[:, 0]).min() >= 0.79
    assert lines.min() >= -8.0 and lines.max() <= 8.0
    assert (
        flights["large"].min() > 0.0 and (flights["large"] < flights["medium"]).all() and flights["medium"].max() < 1.0
    )
    assert flights["slowest"].min() >= 1.0 and flights["fastest"].max() <= 8.0
    assert ((flights["fastest"] - flights["slowest"]) >= 1.0).all() and 0.0 <= flights["pause"].min() <= 1.5


def test_levels_have_obstacles_open_sky_and_birds():
    for level_set in SETS.values():
        check_levels(np.arange(level_set.start, level_set.start + BATCH))


@pytest.mark.nightly
def test_a_million_levels_have_obstacles_open_sky_and_birds():
    for first in range(0, 1_000_000, BATCH):
        check_levels(np.arange(first, first + BATCH))


def test_a_level_depends_on_its_number_alone():
    among, alone = levels_of(np.array([3, 70, 2_999_999])), levels_of(np.array([70]))
    for many, one in zip(
        (*among.obstacles, among.flights, among.placements),
        (*alone.obstacles, alone.flights, alone.placements),
        strict=True,
    ):
        assert many[1].tobytes() == one[0].tobytes()


def test_levels_differ():
    levels = levels_of(np.arange(BATCH))
    assert len({row.tobytes() for row in levels.placements}) == BATCH
    assert set(np.unique(levels.counts)) == {2, 3, 4, 5}


def test_the_sets_of_levels_are_disjoint_and_of_a_million_levels_each():
    numbers = [number for level_set in SETS.values() for number in (level_set.start, level_set.stop)]
    assert numbers == [0, 1_000_000, 1_000_000, 2_000_000, 2_000_000, 3_000_000]


@pytest.mark.parametrize(
    ("first", "count"), [(0, 7), (43, 1), (1_000_000, 1000), (999_990, 1000), (2_000_000, 1_000_000)]
)
def test_an_episode_plays_one_of_the_chosen_levels_and_never_leaves_their_set(first, count):
    game = new_game(300, first=first, count=count)
    seen = set()
    for _ in range(5):
        seen |= set(game.arenas.number.tolist())
        game.reset(None, {})
    (level_set,) = (numbers for numbers in SETS.values() if first in numbers)
    wanted = {level_set.start + (first - level_set.start + k) % len(level_set) for k in range(count)}
    assert seen <= wanted and (count > 100 or seen == wanted)


def test_birds_enter_on_the_lines_of_their_level_and_after_pauses():
    game = new_game(200, count=1_000_000)
    lines, birds = game.world.flights["lines"], game.arenas.birds
    on_line = (birds["y"][:, :, None] >= lines[:, None, :, 0]) & (birds["y"][:, :, None] <= lines[:, None, :, 1])
    assert on_line.any(axis=2).all()
    waiting = birds["wait"] > 0
    assert 0.5 < waiting.mean() < 1.0 and (birds["x"][waiting] == 1000.0).all()
    for _ in range(200):
        game.step([script.act(game.arenas, game.world)])
    assert (game.arenas.birds["wait"] > 0).mean() < 0.5


def test_an_arena_plays_the_same_bytes_alone_as_among_others():
    among = sweep(new_game(4, observation="all"), 60)
    assert sweep(new_game(1, first_arena=2, observation="all"), 60) == among[2:3]
    assert len(set(among)) == 4


def test_a_restored_game_continues_in_the_same_levels_to_the_same_bytes():
    game = new_game(3, observation="all")
    game.arenas.tick = 1900
    sweep(game, 50)
    state = {name: values.copy() for name, values in game.save().items()}
    wanted = sweep(game, 100)
    other = new_game(3, seed=99, observation="all")
    other.restore(state)
    assert sweep(other, 100) == wanted


@pytest.mark.parametrize("observation", GOLDEN)
def test_a_seeded_run_gives_the_bytes_it_always_gave(observation):
    game = new_game(3, observation=observation, birds="mixed", count=1_000_000)
    game.arenas.tick = 1950
    assert hashlib.sha256("".join(sweep(game, 100)).encode()).hexdigest()[:16] == GOLDEN[observation]


@pytest.mark.parametrize("number", [-1, 3_000_000])
def test_restore_refuses_a_level_that_is_not_in_any_set(number):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas.number[1] = number
    with pytest.raises(ValueError, match="number is outside"):
        game.restore({**game.save(), "arenas": np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1)})


def test_a_picture_shows_the_level():
    game = new_game(2)
    game.arenas.birds = game.arenas.birds[0]
    for field in ("x", "y", "ammo"):
        game.arenas[field] = game.arenas[field][0]
    assert (game.draw(0) != game.draw(1)).any(axis=2).mean() > 0.05


def play_levels(first: int, ticks: int) -> Array:
    """Return what the scripted player earns in 1000 levels from `first` on."""
    game = new_game(1000, first=first, count=1000)
    game.show_levels(first + np.arange(1000))
    return script.play(game, ticks)


def test_the_scripted_player_hits_birds_in_each_of_1000_levels():
    assert play_levels(0, 500).min() > 2.0


@pytest.mark.nightly
@pytest.mark.parametrize("level_set", ["training", "test"])
def test_the_scripted_player_earns_60_in_each_of_1000_levels(level_set):
    assert play_levels(SETS[level_set].start, 2000).min() >= 60.0


def digest_of_a_short_run() -> str:
    """Return the hash of a run in generated levels, with birds of every habit and a camera."""
    game = new_game(2, birds="mixed", camera="edge", hints="on")
    game.arenas.x, game.arenas.y = game.arenas.birds.x[:, 0], game.arenas.birds.y[:, 0]  # a bird sees the crosshair
    return "".join(sweep(game, 60))
