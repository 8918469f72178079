"""The rules of Beastly Rivals Onslaught, number by number and tick by tick."""

import math

import numpy as np
import pytest

from joybridge.games.beastly_rivals import rules as r
from joybridge.games.beastly_rivals.game import CHANNELS
from joybridge.games.beastly_rivals.pitches import make_pitches
from joybridge.simulator.randomness import open_streams, reserve

SURVIVAL, DEATH, EARLY_BLINK = range(3)
BODIES = ("cursor", "character", "beast", "sphere")
NEAR = 1e-12


class Scene:
    """One arena with everything at rest and out of everything's way, and its ticks."""

    def __init__(self, rules=r.ORIGINAL, **places):
        self.rules, self.streams, self.number = rules, open_streams(1, 0, 1), 0
        self.arenas = np.zeros(1, r.ARENA).view(np.recarray)
        self.arenas.beast_speed = 1.0
        self.world = r.World(rules, make_pitches(1), False)
        r.begin(self.arenas, self.streams, self.world)
        self.arena = self.arenas[0]
        self.put(**{"cursor": (0, 0), "character": (5, 0), "beast": (-5, 0), "sphere": (0, -7), **places})

    def put(self, **places):
        for body, (x, z) in places.items():
            self[body].x, self[body].z = x, z

    def __getitem__(self, body):
        return self.arena[body]

    def tick(self, count=1, velocity=(0.0, 0.0), move=0, blink=0):
        """Advance by some ticks and return the sum of their rewards."""
        rewards = np.zeros((1, len(CHANNELS)))
        for _ in range(count):
            reserve(self.streams, r.MOST_DRAWS)
            action = np.array([velocity], float), np.array([move], np.int32), np.array([blink], np.int32)
            r.tick(self.arenas, self.streams, self.world, self.number % r.DECISION_TICKS, *action, rewards)
            self.number += 1
        return rewards[0]

    def decide(self, **action):
        assert self.number % r.DECISION_TICKS == 0
        return self.tick(r.DECISION_TICKS, **action)

    def begin_episode(self):
        reserve(self.streams, r.MOST_DRAWS)
        r.begin_episodes(self.arenas, self.streams, self.world, np.ones(1, bool))

    def speed(self, body):
        return math.hypot(self[body].vx, self[body].vz)


# ------------------------------------------------------------------------------------ cursor and character


def test_cursor_rests_7_0545_from_the_centre_and_is_pulled_there_over_several_ticks():
    scene = Scene(cursor=(0, 7.5))
    scene.tick()
    assert scene["cursor"].z == pytest.approx(7.5 * 7.125 / math.sqrt(7.5**2 + 1), abs=NEAR)
    scene.tick(100)
    assert scene["cursor"].z == pytest.approx(7.0545, abs=5e-5)


def test_cursor_keeps_its_velocity_at_the_boundary_and_is_seen_one_tick_outside():
    scene = Scene()
    scene.tick(60, velocity=(20.0, 0.0))
    assert scene["cursor"].vx == 20.0
    assert 7.0545 + 0.4 < scene["cursor"].x < 7.125 + 0.4


@pytest.mark.parametrize("distance", [6.0, 0.5, 0.01])
def test_character_approaches_at_a_speed_that_counts_its_height(distance):
    scene = Scene(character=(distance, 0))
    scene.tick(move=1)
    assert scene["character"].vx == pytest.approx(-4.0 * distance / math.sqrt(distance**2 + 0.09), abs=NEAR)
    assert scene["character"].x == pytest.approx(distance + 0.02 * scene["character"].vx, abs=NEAR)


def test_character_never_arrives_in_the_original_and_arrives_in_the_corrected_game():
    original, corrected = Scene(character=(1, 0)), Scene(r.CORRECTED, character=(1, 0))
    original.tick(40, move=1)
    before = original["character"].x
    original.tick(move=1)
    assert original["character"].x / before == pytest.approx(1 - 4 * 0.02 / 0.3, abs=1e-4)
    assert original.arena.moving
    corrected.tick(5, move=1)
    assert corrected["character"].x == pytest.approx(1 - 5 * 0.08, abs=NEAR)
    corrected.tick(8, move=1)
    assert corrected["character"].x == pytest.approx(0.0, abs=NEAR)


def test_character_walks_on_to_the_last_goal_and_stands_without_one():
    scene = Scene()
    scene.tick()
    assert scene.speed("character") == 0.0
    scene.tick(move=1)
    scene.tick(10, velocity=(20.0, 0.0))
    assert (scene.arena.goal_x, scene.arena.goal_z) == (0.0, 0.0)
    assert scene["character"].vx < -3.9


def test_goal_follows_the_cursor_during_a_decision():
    scene = Scene()
    scene.decide(velocity=(10.0, 0.0), move=1)
    assert scene.arena.goal_x == pytest.approx(5 * 0.2, abs=NEAR)  # the cursor's place before the sixth tick


# -------------------------------------------------------------------------------------------------- blink


def test_blink_jumps_stops_the_walk_and_is_ready_again_after_200_ticks():
    scene = Scene(cursor=(1, 2))
    early = scene.tick(move=1, blink=1)[EARLY_BLINK]
    assert (scene["character"].x, scene["character"].z) == (1.0, 2.0)
    assert early == 0.0 and not scene.arena.moving and scene.arena.cooldown == 199
    scene.put(cursor=(0, 3))
    scene.tick(198)
    assert scene.tick(blink=1)[EARLY_BLINK] == -0.025  # 199 ticks after the jump
    assert scene.tick(blink=1)[EARLY_BLINK] == 0.0
    assert scene.arena.blinks == 2 and scene["character"].z == 3.0
    scene.tick(250)
    assert scene.arena.cooldown == 0


@pytest.mark.parametrize(("rules", "success", "failure"), [(r.ORIGINAL, -0.125, -0.15), (r.CORRECTED, 0.0, -0.025)])
def test_a_blink_decision_pays_for_the_ticks_in_which_it_is_too_early(rules, success, failure):
    scene = Scene(rules)
    assert scene.decide(blink=1) == pytest.approx([0.06, 0.0, success], abs=NEAR)
    assert scene.decide(blink=1) == pytest.approx([0.06, 0.0, failure], abs=NEAR)


def test_move_pressed_with_blink_walks_again_from_the_second_tick_on():
    scene = Scene()
    scene.decide(velocity=(5.0, 0.0), move=1, blink=1)
    assert scene.arena.moving and 0.0 < scene["character"].x < scene["cursor"].x


# -------------------------------------------------------------------------------------------------- beast


def test_beast_at_rest_starts_straight_at_the_character():
    scene = Scene(beast=(0, 0), character=(3, 4))
    scene.tick()
    planar = 0.8 * 5 / math.hypot(5, 0.125)  # the rest of 0.8 points upwards and is lost
    assert scene["beast"].vx == pytest.approx(0.6 * planar, abs=NEAR)
    assert scene["beast"].vz == pytest.approx(0.8 * planar, abs=NEAR)


@pytest.mark.parametrize(("speed", "accuracy"), [(0.8, 0.01), (4.0, 0.186), (8.5, 0.6)])
def test_beast_turns_by_accuracy_over_speed(speed, accuracy):
    scene = Scene(beast=(0, 0), character=(0, 6))
    scene["beast"].vx, scene.arena.speed, scene.arena.accuracy = speed, speed, accuracy
    scene.tick()
    up = 0.125 / math.hypot(6, 0.125)
    wanted = np.array([speed - accuracy, accuracy * 6 / math.hypot(6, 0.125), accuracy * up])
    wanted *= speed / np.linalg.norm(wanted)
    assert (scene["beast"].vx, scene["beast"].vz) == pytest.approx(wanted[:2], abs=NEAR)


def test_beast_grows_to_4_after_3200_and_to_8_5_after_7700_ticks_and_never_to_full_accuracy():
    scene = Scene()
    scene.tick(3200)
    assert (scene.arena.speed, scene.arena.accuracy) == pytest.approx((4.0, 0.186), abs=1e-9)
    scene.tick(4499)
    assert scene.arena.speed == pytest.approx(8.499, abs=1e-9)
    scene.tick(4301)
    assert scene.arena.speed == 8.5 and scene.arena.accuracy == pytest.approx(0.67, abs=1e-9)


@pytest.mark.parametrize(("distance", "dies"), [(0.738, True), (0.7384, False)])
def test_beast_kills_from_a_planar_distance_of_0_738(distance, dies):
    scene = Scene(beast=(3, 3), character=(3, 3 + distance))
    assert scene.tick()[DEATH] == (-1.0 if dies else 0.0)
    assert scene.arena.dead == dies


def test_a_touch_is_noticed_in_the_tick_after_it_and_paid_once_until_they_part():
    scene = Scene(beast=(0, 0), character=(0.745, 0))
    assert scene.tick()[DEATH] == 0.0  # in this tick the beast moves 0.016 closer
    assert scene.tick(6)[DEATH] == -1.0
    scene.put(beast=(3, 0))
    scene.tick()
    scene.put(beast=(0.5, 0))
    assert scene.tick(3)[DEATH] == -1.0


def test_the_ticks_after_a_death_run_and_pay():
    scene = Scene(beast=(5.1, 0))
    assert scene.decide() == pytest.approx([0.06, -1.0, 0.0], abs=NEAR)
    assert scene.arena.tick == 6 and scene.arena.speed == pytest.approx(0.806, abs=NEAR)


# -------------------------------------------------------------------------------------------- slow sphere


@pytest.mark.parametrize(("distance", "inside"), [(3.2674, True), (3.2677, False)])
def test_character_is_inside_the_sphere_within_3_2675(distance, inside):
    scene = Scene(sphere=(5 - distance, 0))
    scene.tick()
    assert scene.arena.character_slow == inside


@pytest.mark.parametrize(("offset", "inside"), [(3.467, True), (3.468, False), (-2.917, True), (-2.918, False)])
def test_beast_is_inside_the_sphere_when_its_box_is(offset, inside):
    scene = Scene(beast=(0, 0), character=(1e4, 0), sphere=(offset, 0))  # so far away, the box is not tilted
    scene.tick()
    assert scene.arena.beast_slow == inside


@pytest.mark.parametrize(("distance", "share"), [(0.6, 0.5), (1.5, 0.5), (2.4, 0.8), (3.1, 1.0)])
def test_sphere_slows_the_character_by_its_distance_unless_that_is_off(distance, share):
    for rules, expected in ((r.ORIGINAL, share), (r.ORIGINAL._replace(slow_character=False), 1.0)):
        scene = Scene(rules, sphere=(5 - distance, 0))
        scene.tick()  # notices that it is inside; the next one is slow
        scene.tick(move=1)
        assert scene.speed("character") == pytest.approx(expected * 20 / math.sqrt(25.09), abs=NEAR)
        assert scene.arena.slow_ticks == (expected < 1.0)


@pytest.mark.parametrize(("distance", "share"), [(0.6, 0.5), (1.2, 0.5), (2.1, 0.8), (2.8, 1.0)])
def test_sphere_slows_the_beast_by_its_distance_and_a_tenth_less(distance, share):
    scene = Scene(sphere=(-5 + distance, 0))
    scene.tick()
    distance -= scene["beast"].x + 5
    scene.tick()
    assert scene.speed("beast") == pytest.approx(0.801 * min(max(distance / 3 + 0.1, 0.5), 1.0), rel=1e-6)
    assert scene.speed("beast") == pytest.approx(0.801 * share, abs=0.006)


def test_slowing_ends_where_the_sphere_does():
    scene = Scene(sphere=(5, 0))
    scene.tick()
    assert scene.arena.character_slow
    scene.put(sphere=(0, -7))
    scene.tick()
    assert not scene.arena.character_slow


def test_sphere_turns_in_tick_152_and_then_every_151():
    scene, turns, before = Scene(), [], (0.0, 0.0)
    for number in range(1, 1000):
        scene.tick()
        now = (scene["sphere"].vx, scene["sphere"].vz)
        if now != before:
            turns.append(number)
        before = now
    assert turns == [152, 303, 454, 605, 756, 907]


def test_sphere_turns_towards_a_place_on_the_pitch_with_a_fifth_of_its_velocity():
    scene = Scene(sphere=(1, 2))
    scene.tick(151)
    scene["sphere"].vx, scene["sphere"].vz = 0.0, 0.75
    scene.put(sphere=(1, 2))
    share, turn = scene.streams.values[0, scene.streams.cursor[0] :][:2]
    place = 7.5 * math.sqrt(share) * np.array([math.cos(2 * np.pi * turn), math.sin(2 * np.pi * turn)])
    wanted = 0.8 * (place - (1, 2)) / np.linalg.norm(place - (1, 2)) + (0.0, 0.2 * 0.75)
    scene.tick()
    assert (scene["sphere"].vx, scene["sphere"].vz) == pytest.approx(0.75 * wanted / np.linalg.norm(wanted), abs=1e-9)


def test_sphere_is_held_at_7_125_and_keeps_its_velocity():
    scene = Scene(sphere=(7.4, 0))
    scene["sphere"].vx = 0.75
    scene.tick()
    assert scene["sphere"].x == pytest.approx(7.125 + 0.015, abs=NEAR) and scene["sphere"].vx == 0.75


# ------------------------------------------------------------------------------------------------ episodes


def test_new_episodes_spread_the_bodies_evenly_over_the_pitch_and_begin_the_game_at_rest():
    arenas = np.zeros(4096, r.ARENA).view(np.recarray)
    arenas.beast_speed = 1.0
    r.begin(arenas, open_streams(5, 0, len(arenas)), r.World(r.ORIGINAL, make_pitches(1), False))
    for body in ("cursor", "character", "sphere"):
        radius = np.hypot(arenas[body]["x"], arenas[body]["z"])
        assert 7.4 < radius.max() <= 7.5
        assert np.mean(radius < 7.5 / math.sqrt(2)) == pytest.approx(0.5, abs=0.03)
        assert np.mean((arenas[body]["x"] > 0) & (arenas[body]["z"] > 0)) == pytest.approx(0.25, abs=0.03)
    assert not any(arenas[body][part].any() for body in BODIES for part in ("vx", "vz"))
    assert not (arenas.beast.x.any() or arenas.beast.z.any() or arenas.cooldown.any() or arenas.moving.any())
    assert (arenas.speed == 0.8).all() and (arenas.accuracy == 0.01).all()


@pytest.mark.parametrize("rules", [r.ORIGINAL, r.CORRECTED])
def test_what_a_new_episode_keeps(rules):
    scene = Scene(rules, sphere=(5, 0), beast=(5, 0.5))
    scene.tick(160, velocity=(1.0, 2.0), move=1, blink=1)
    timer, old = scene.arena.timer, {body: (scene[body].vx, scene[body].vz) for body in BODIES}
    scene.arena.touching = scene.arena.character_inside = scene.arena.beast_inside = True
    scene.arena.character_slow = scene.arena.beast_slow = scene.arena.dead = True
    scene.arena.blinks = scene.arena.clicks = scene.arena.slow_ticks = 7
    scene.begin_episode()
    keeps = rules is r.ORIGINAL
    for body in BODIES:
        kept = keeps or body == "sphere"
        assert (scene[body].vx, scene[body].vz) == (old[body] if kept else (0.0, 0.0)), body
    assert scene.arena.timer == timer and scene.arena.clock == 160 and scene.arena.tick == 0
    assert [scene.arena[f] for f in ("touching", "character_inside", "beast_inside")] == [keeps] * 3
    assert not any(scene.arena[f] for f in ("character_slow", "beast_slow", "dead", "moving", "cooldown"))
    assert not any(scene.arena[f] for f in ("blinks", "clicks", "slow_ticks"))
    assert (scene["beast"].x, scene["beast"].z, scene.arena.speed) == (0.0, 0.0, 0.8)


@pytest.mark.parametrize(("rules", "slow"), [(r.ORIGINAL, False), (r.CORRECTED, True)])
def test_inside_before_and_after_a_new_episode_slows_only_after_leaving_in_the_original(rules, slow):
    scene = Scene(rules, sphere=(5, 0))
    scene.tick()
    scene.begin_episode()
    scene.put(character=(5, 0), sphere=(5, 0), beast=(-5, 0))
    scene.tick()
    assert scene.arena.character_slow == slow
    scene.put(sphere=(0, -7))
    scene.tick()
    scene.put(sphere=(5, 0))
    scene.tick()
    assert scene.arena.character_slow
