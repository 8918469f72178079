"""Programs written with pygame as games: they run as they are, with exact seeds, snapshots, rewards and fences."""

import hashlib
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_game
from joybridge.simulator.listing import listing
from tests.support.servers import ROOT

CATCH = f"{ROOT / 'tests/support/pygame_programs/catch.py'} 'reward=Score: (\\d+)'"
SPEC = r"""catch: .*
  option decision_interval: 4 | 1 | 2 | 8 (default 4)
  option screen: 64 | 48 | 84 | 128 (default 64)
  option colors: rgb | gray (default rgb)
  option pointer: position | velocity (default position)
  option fovea: none | 32 | 64 (default none)
  behavior player: 1 agent per arena
    sensors: screen [55, 74, 3] uint8
    axes: pointer_x -1..1, pointer_y -1..1
    branches: mouse_left (released | pressed), key_LEFT (released | pressed), key_RIGHT (released | pressed)
    rewards: score (weight 1)"""


@pytest.fixture(scope="module")
def catch():
    game: Any = load_game(f"pygame:{CATCH}")
    yield game
    game.processes.end()


def opened(game, arenas=1, seed=0, **options):
    chosen = choose_options(game.options, options, game.name)
    return closing(game(chosen, {}, arenas, 0, seed))


def program(tmp_path, source, settings=""):
    """Return the game of a program with this source."""
    path = tmp_path / "program.py"
    path.write_text(source)
    return load_game(f"pygame:{path} {settings}")


def random_act(game, rng, arenas=1):
    device = game.describe(choose_options(game.options, {}, game.name)).behaviors[0].device
    choices = [[rng.integers(len(branch.choices)) for branch in device.branches] for _ in range(arenas)]
    axes = rng.uniform(-1, 1, (arenas, len(device.axes)))
    return [ActArrays(axes.astype(np.float32), np.array(choices, np.int32).reshape(arenas, -1))]


def played(playing, game, decisions, rng, arenas=1):
    """Return a hash of everything that some random decisions give, and the reward."""
    digest, reward = hashlib.sha256(), 0.0
    for _ in range(decisions):
        (step,) = playing.step(random_act(game, rng, arenas))
        for array in (*step.observations, step.rewards, step.terminated, step.truncated):
            digest.update(array.tobytes())
        reward += step.rewards.sum()
    digest.update(playing.draw(arenas - 1).tobytes())
    return digest.hexdigest(), reward


def test_the_spec_says_what_the_program_reads_and_shows(catch):
    spec = catch.describe(choose_options(catch.options, {}, catch.name))
    first, *rest = listing([spec]).splitlines()
    assert first.startswith("catch: ") and rest == SPEC.splitlines()[1:]
    assert spec.tick_seconds == pytest.approx(1 / 50)
    assert (spec.picture.width, spec.picture.height) == (320, 240)


def test_the_same_seed_and_decisions_give_the_same_bytes(catch):
    hashes = []
    for seed in (1, 1, 2):
        with opened(catch, 2, seed) as playing:
            hashes.append(played(playing, catch, 60, np.random.default_rng(0), 2))
    assert hashes[0] == hashes[1] != hashes[2]
    assert hashes[0][1] > 0  # something was caught, and its text was read


def test_an_arena_is_the_same_alone_and_among_others(catch):
    act = random_act(catch, np.random.default_rng(3))
    with opened(catch, 3) as three:
        (among,) = three.step([ActArrays(*(np.repeat(part, 3, 0) for part in (act[0].axes, act[0].choices)))])
    for arena in range(3):
        options = choose_options(catch.options, {}, catch.name)
        with closing(catch(options, {}, 1, arena, 0)) as alone:
            (step,) = alone.step(act)
        assert np.array_equal(step.observations[0][0], among.observations[0][arena])


def test_a_snapshot_continues_like_the_original_over_2000_frames(catch):
    rng = np.random.default_rng(5)
    with opened(catch) as original, opened(catch) as forked, opened(catch) as repeated:
        played(original, catch, 40, rng)
        state = original.save()
        forked.restore(state)
        catch.processes.forget_branches()
        repeated.restore(state)
        results = {played(one, catch, 500, np.random.default_rng(6)) for one in (original, forked, repeated)}
    assert len(results) == 1
