"""The rules of the complete Beastly Rivals Onslaught, number by number and tick by tick."""

import numpy as np
import pytest

from joybridge.games.beastly_rivals_full import players as commands
from joybridge.games.beastly_rivals_full import rules as r
from joybridge.games.beastly_rivals_full.ball import throw
from joybridge.games.beastly_rivals_full.beast import gap
from joybridge.games.beastly_rivals_full.geometry import SEATS, inside, project, unit
from joybridge.games.beastly_rivals_full.state import ARENA, CHANNELS, HUNT, OVER, START, Rules
from joybridge.simulator.randomness import open_streams, reserve

ORIGINAL = Rules(True, True, True, True, False, 2, 2, 300, 150, 150)
BEAST = {"x": 0.0, "z": 0.0, "fx": 0.0, "fz": 1.0, "gx": 0.0, "gz": 1.0, "speed": 10.0, "turning": 50.0}


def near(value):
    return pytest.approx(value, abs=1e-3)


class Scene:
    """One match in which players sit on known seats. If it is bare, no ball comes and nobody is revived."""

    def __init__(self, players=2, seats=None, bare=True, **rules):
        self.rules, self.streams = ORIGINAL._replace(players=players, **rules), open_streams(1, 0, 1)
        self.arenas = np.zeros(1, ARENA).view(np.recarray)
        for parameter in ("beast_speed", "beast_turning", "ball_speed"):
            self.arenas[parameter] = 1.0
        r.begin_episodes(self.arenas, self.streams, self.rules, np.ones(1, bool))
        self.arena, self.beast, self.ball = self.arenas[0], self.arenas[0].beast, self.arenas[0].ball
        self.gained = np.zeros((players, CHANNELS))
        self.kill_tick = 0
        for i, seat in enumerate(seats or range(players)):
            self.put(i, *SEATS[seat])
            self[i].fx, self[i].fz = unit(-self[i].x, -self[i].z, 0.0, 1.0)
        if bare:
            self.arena.phase, self.arena.phase_tick = HUNT, 0

    def __getitem__(self, i):
        return self.arena.players[i]

    def put(self, i, x, z):
        self[i].x, self[i].z = x, z

    def hunt(self, i, **beast):
        """Let player i carry the ball, and the beast hunt it from the center or from another place."""
        self.arena.carrier = self.arena.target = i
        for name, value in (BEAST | beast).items():
            self.beast[name] = value

    def draw(self, *chances):
        """Determine the next random numbers."""
        self.streams.values[0, self.streams.cursor[0] :][: len(chances)] = chances

    def to(self, tick):
        while self.arena.tick < tick:
            self.step()

    def step(self):
        reserve(self.streams, r.MAX_DRAWS)
        deaths = sum(self[i].deaths for i in range(self.rules.players))
        r.tick(self.arena, self.streams, 0, self.rules, self.gained)
        if sum(self[i].deaths for i in range(self.rules.players)) > deaths:
            self.kill_tick = self.arena.tick

    def until(self, condition, limit=2000):
        """Advance until a condition holds and return the tick of that."""
        while not condition():
            assert self.arena.tick < limit
            self.step()
        return int(self.arena.tick)

    def catch(self):
        return self.until(lambda: self.arena.carrier >= 0)

    def throw(self):
        return self.until(lambda: self.ball.flying)

    def kill(self):
        return self.until(lambda: self.kill_tick > 0)


# ------------------------------------------------------------------------------------------------------- the beast


def test_speed_and_turning_grow_and_end_alternating_around_their_limits():
    scene = Scene()
    scene.arena.target = 0
    for tick, speed, turning in (
        (1, 10.012, 50.025),
        (500, 16.0, 66.6539),
        (1000, 22.0, 99.9308),
        (1725, 30.7, 361.0429),
        (1726, None, 360.0),
        (1727, None, 361.296),
        (5417, 75.004, None),
        (5418, 75.0, None),
        (5419, 75.012, None),
    ):
        scene.to(tick)
        assert speed is None or scene.beast.speed == near(speed)
        assert turning is None or scene.beast.turning == near(turning)


def test_corrected_speed_and_turning_end_at_their_limits():
    scene = Scene(overshoots=False)
    scene.arena.target = 0
    scene.to(5500)
    assert (scene.beast.speed, scene.beast.turning) == (75.0, 360.0)


def test_parameters_scale_speed_and_turning_at_all_times():
    scene = Scene()
    scene.arena.beast_speed, scene.arena.beast_turning, scene.arena.target = 0.5, 2.0, 0
    scene.beast.speed, scene.beast.turning = 5.0, 100.0
    scene.to(500)
    assert scene.beast.speed == near(8.0) and scene.beast.turning == near(2 * 66.6539)
    scene.to(6000)
    assert scene.beast.speed == near(37.5) and 720.0 <= scene.beast.turning < 723.0


def test_a_standing_carrier_straight_ahead_dies_in_tick_115():
    scene = Scene()
    scene.hunt(0)
    assert scene.kill() == 115
    assert (scene.beast.x, scene.beast.z) == (near(0.0), near(24.5732))
    assert (scene.beast.speed, scene.beast.turning) == (near(11.38), near(53.0487))
    assert (scene[0].lives, scene[0].kills, scene[0].humiliations) == (1, -1, 1)


def test_the_beast_turns_at_a_limited_rate_and_its_body_looks_ahead_of_its_root():
    scene = Scene(seats=[2, 0])
    scene.hunt(0)
    for tick, (x, z), (fx, fz), (gx, gz) in (
        (1, (0.0035, 0.2), (0.0175, 0.9998), (0.9998, -0.0175)),
        (50, (4.3608, 8.9574), (0.773, 0.6344), (0.9563, -0.2925)),
    ):
        scene.to(tick)
        beast = scene.beast
        assert (beast.x, beast.z, beast.fx, beast.fz) == (near(x), near(z), near(fx), near(fz))
        assert (beast.gx, beast.gz) == (near(gx), near(gz))
    scene.to(100)
    assert (scene.beast.x, scene.beast.z, scene.beast.turning) == (near(14.6256), near(11.2823), near(52.6302))
    assert scene.kill() == 197
    assert (scene.beast.x, scene.beast.z) == (near(34.5746), near(0.2489))
    assert (scene.beast.speed, scene.beast.turning) == (near(12.364), near(55.4599))


@pytest.mark.parametrize(("enter_only", "kill", "x", "z"), [(True, 51, 0.3281, -26.2915), (False, 10, 0.0, -24.4108)])
def test_a_beast_that_stands_in_the_receiver_kills_only_after_it_left(enter_only, kill, x, z):
    scene = Scene(seats=[0, 4], enter_only=enter_only)
    scene.hunt(1, z=-24.0, fz=-1.0, gz=-1.0, speed=2.0)
    scene.arena.carrier, scene.arena.last = -1, 0
    for name, value in {"y": 16.0, "z": -25.0, "time": 1.0, "speed": 45.0, "flying": True}.items():
        scene.ball[name] = value
    scene.to(5)
    assert not scene[1].touching
    scene.to(6)
    assert scene[1].touching and scene.catch() == 9
    if enter_only:
        scene.to(24)
        assert scene[1].touching
        scene.to(25)
        assert not scene[1].touching
    assert scene.kill() == kill
    assert (scene.beast.x, scene.beast.z) == (near(x), near(z)) and scene[0].kills == 1


# ------------------------------------------------------------------------------------------------------- movement


def test_a_walk_speeds_up_brakes_and_stops_half_a_unit_before_its_goal():
    scene = Scene()
    scene.put(0, 0.0, 0.0)
    commands.move(scene.arena, 0, 20.0, 0.0)
    for tick, x, speed in ((1, 0, 0), (2, 0.04, 2), (5, 0.4, 8), (9, 1.42, 15), (50, 13.72, 15), (80, 19.3018, 2.8303)):
        scene.to(tick)
        assert (scene[0].x, scene[0].vx) == (near(x), near(speed))
        if tick in (2, 9):
            assert (scene[0].fx, scene[0].fz) == ((near(0.2079), near(-0.9781)) if tick == 2 else (near(1), near(0)))
    scene.to(84)
    assert scene[0].has_goal
    scene.to(85)
    assert not scene[0].has_goal
    scene.to(120)
    assert scene[0].x == near(19.5272)


@pytest.mark.parametrize(
    ("distance", "x", "kept", "corrected"),
    [(0.4, 0, False, 0), (2.4, 0, True, 1.9272), (2.5, 2.0226, False, 2.0226), (2.6, 2.1373, False, 2.1373)],
)
def test_a_standing_player_ignores_moves_shorter_than_2_5(distance, x, kept, corrected):
    for ignores, wanted in ((True, x), (False, corrected)):
        scene = Scene(ignores_short_moves=ignores)
        scene.put(0, 0.0, 0.0)
        commands.move(scene.arena, 0, distance, 0.0)
        scene.to(200)
        assert scene[0].x == pytest.approx(wanted, abs=1e-3 if ignores else 0.1)
        assert scene[0].has_goal == (kept and ignores)


def test_players_that_walk_into_each_other_stop_each_other():
    scene = Scene()
    for i, side in ((0, -1.0), (1, 1.0)):
        scene.put(i, 10 * side, 0.0)
    for i, side in ((0, -1.0), (1, 1.0)):
        commands.move(scene.arena, i, -10 * side, 0.0)
    for tick, x in ((20, -5.28), (30, -2.28), (40, -1.9976), (200, -1.9976)):
        scene.to(tick)
        assert (scene[0].x, scene[1].x) == (near(x), near(-x))


@pytest.mark.parametrize(
    ("point", "nearest"),
    [
        ((60, 0), (46.3333, 0)),
        ((45, -40), (33.8462, -26.3463)),
        ((40, 20), (39.1667, 20)),
        ((-30, 35), (-27.3333, 31.6667)),
        ((39, 22.2), (38.9687, 22.1617)),
        ((46, 10.6), (46, 10.6)),
    ],
)
def test_points_off_the_pitch_go_to_the_nearest_walkable_one(point, nearest):
    x, z = project(float(point[0]), float(point[1]))
    assert (x, z) == (near(nearest[0]), near(nearest[1]))
    assert inside(float(point[0]), float(point[1])) == (point == nearest)


def test_a_blink_lands_after_15_ticks_and_is_possible_again_after_750():
    scene = Scene()
    assert commands.blink(scene.arena, 0, -30.0, 10.0)
    scene.to(15)
    assert (scene[0].x, scene[0].z) == (0.0, 25.0)
    scene.to(16)
    assert (scene[0].x, scene[0].z, scene[0].fx, scene[0].fz) == (-30.0, 10.0, near(-0.8944), near(-0.4472))
    scene.to(750)
    assert not commands.blink(scene.arena, 0, 0.0, 0.0)
    scene.to(751)
    assert commands.blink(scene.arena, 0, 0.0, 0.0) and scene[0].blinks == 2


# ------------------------------------------------------------------------------------------------------- the ball


def test_a_passer_turns_into_the_cone_winds_up_and_throws():
    scene = Scene()
    scene.hunt(0, x=-30.0, z=-30.0)
    commands.pass_ball(scene.arena, 0, 1)
    scene.to(13)
    assert scene[0].throw_tick == 0
    scene.to(14)
    assert scene[0].throw_tick == 44 and (scene[0].fx, scene[0].fz) == (near(0.9397), near(-0.3420))
    assert scene.throw() == 44 and scene.ball.rise == near(0.1054)
    for tick, place in ((45, (0.6882, 8.5590, 24.8455)), (54, (7.2875, 12.9412, 23.3640))):
        scene.to(tick)
        assert (scene.ball.x, scene.ball.y, scene.ball.z) == tuple(map(near, place))
    assert scene.catch() == 75 and scene.arena.carrier == 1


@pytest.mark.parametrize(
    ("charge", "flights"),
    [
        (0.0, {4: 18, 10: 20, 20: 27, 30: 36, 40: 47, 50: 57, 60: 68, 80: 90}),
        (4.0, {10: 16, 30: 29, 60: 57}),
        (8.0, {10: 14, 30: 16, 60: 29}),
        (14.82, {10: 14, 30: 14, 60: 16}),
    ],
)
def test_a_flight_takes_as_long_as_its_distance_and_charge_say(charge, flights):
    for distance, ticks in flights.items():
        scene = Scene()
        scene.put(0, -distance / 2, 0.0)
        scene.put(1, distance / 2, 0.0)
        scene.arena.hold, scene.arena.charge = (400, charge) if charge else (0, 0.0)
        throw(scene.arena, 0, 1, scene.rules)
        scene.beast.x = 1000.0
        assert scene.catch() == ticks, distance


def test_the_ball_follows_a_receiver_that_runs():
    scene = Scene()
    scene.put(0, -30.0, 0.0)
    scene.put(1, 0.0, 0.0)
    commands.move(scene.arena, 1, 40.0, 0.0)
    throw(scene.arena, 0, 1, scene.rules)
    scene.beast.x = 1000.0
    assert scene.catch() == 51 and scene[1].x == near(14.02)


def test_a_power_shot_changes_the_beast_for_105_ticks():
    scene = Scene(seats=[0, 4])
    scene.hunt(0, x=-40.0, fx=-1.0, fz=0.0, gx=-1.0, gz=0.0, speed=20.0, turning=100.0)
    scene.arena.hold, scene.arena.charge = 474, 4.0
    throw(scene.arena, 0, 1, scene.rules)
    assert (scene.beast.speed, scene.beast.turning) == (near(12.0), near(60.0))
    assert (scene.ball.speed, scene.ball.rise) == (near(54.0), near(0.0760))
    scene.to(1)
    assert (scene.beast.speed, scene.beast.turning) == (near(12.012), near(60.036))
    assert scene.catch() == 47 and scene[0].power_shots == scene[0].passes == 1
    scene.to(104)
    assert (scene.beast.speed, scene.beast.turning) == (near(13.248), near(63.9905))
    assert (scene.beast.x, scene.beast.z) == (near(-48.7534), near(-19.1512))
    scene.to(105)
    assert (scene.beast.speed, scene.beast.turning) == (near(21.0), near(110.0))


def test_a_weak_power_shot_slows_the_beast_unless_it_is_corrected():
    for slow in (True, False):
        scene = Scene(seats=[0, 4], weak_shots_slow=slow)
        scene.hunt(0, x=-30.0, speed=14.5, turning=61.0)
        scene.arena.hold, scene.arena.charge = 375, 0.04
        throw(scene.arena, 0, 1, scene.rules)
        assert scene.ball.speed == 45.0 and scene.ball.rise == near(0.0912)
        if not slow:
            assert (scene.beast.speed, scene.beast.turning) == (14.5, 61.0)
            continue
        assert (scene.beast.speed, scene.beast.turning) == (near(0.087), near(0.366))
        assert scene.catch() == 57
        scene.to(104)
        assert (scene.beast.speed, scene.beast.turning) == (near(1.335), near(0.3661))
        assert (scene.beast.x, scene.beast.z) == (near(-29.9873), near(1.4663))
        scene.to(105)
        assert (scene.beast.speed, scene.beast.turning) == (near(15.225), near(67.1))


def test_the_charge_begins_in_the_375th_tick_with_the_ball():
    scene = Scene()
    scene.arena.carrier = 0
    for tick, charge in ((374, 0.0), (375, 0.04), (376, 0.08), (500, 5.04)):
        scene.to(tick)
        assert scene.arena.charge == near(charge)


def test_a_pass_to_another_rival_in_the_wind_up_changes_the_receiver_alone():
    scene = Scene(3)
    scene.arena.carrier = 0
    commands.pass_ball(scene.arena, 0, 1)
    scene.to(20)
    commands.pass_ball(scene.arena, 0, 2)
    assert scene.throw() == 44 and scene.arena.target == 2 and scene.catch() == 94


def test_a_passer_may_walk_during_its_wind_up_but_a_walk_delays_its_turn():
    scene = Scene()
    scene.arena.carrier = 0
    commands.pass_ball(scene.arena, 0, 1)
    scene.to(14)
    commands.move(scene.arena, 0, -20.0, 25.0)
    assert scene.throw() == 44 and (scene[0].x, scene[0].z) == (near(-7.72), near(25.0))
    scene = Scene()
    scene.arena.carrier = 0
    commands.pass_ball(scene.arena, 0, 1)
    commands.move(scene.arena, 0, -20.0, 25.0)
    assert scene.throw() == 147 and scene[0].x == near(-19.5272)


def test_who_dies_in_its_wind_up_does_not_throw():
    scene = Scene()
    scene.hunt(0, z=20.0)
    commands.pass_ball(scene.arena, 0, 1)
    assert scene.kill() == 22
    scene.to(200)
    assert not scene.ball.flying and scene.arena.carrier == -1 and scene[0].passes == 0


# ------------------------------------------------------------------------------------------------------- clicks


def test_what_a_click_means_depends_on_what_is_under_the_pointer():
    scene = Scene(3)
    player, rival = scene[0], (25.9, 20.9)

    def click(x, z, double=False):
        player.pointer_x, player.pointer_z = x, z
        commands.click(scene.arena, 0, double, scene.rules)

    click(*rival)
    assert player.pass_to == -1 and not player.has_goal  # without the ball
    scene.arena.carrier = 0
    click(*rival, double=True)
    assert player.pass_to == 1
    click(26.0, 21.0)
    assert player.has_goal and (player.goal_x, player.goal_z) == (26.0, 21.0)
    player.has_goal = False
    click(1.0, 24.5)
    assert not player.has_goal  # on itself
    click(60.0, 0.0, double=True)
    scene.to(16)
    assert (player.x, player.z) == (near(46.3333), near(0.0))


# ------------------------------------------------------------------------------------------------------- the match


def test_a_life_from_the_first_ball_to_the_revival():
    scene = Scene(3, bare=False)
    scene.draw(0.0, (45 + 30 + 0.5) / 90, (40 - 30 + 0.5) / 80, 0.9)
    assert scene.arena.phase == START and scene.throw() == 300 and scene.arena.target == 0
    assert scene.catch() == 331 and scene.kill() == 415
    assert (scene[0].humiliations, scene[0].lives) == (1, 1) and scene.beast.z == near(24.5732)
    assert scene.gained[0, 1 : r.BALL].tolist() == [0.0, -1.0, -1.0, 0.0]
    scene.to(714)
    assert not scene[0].alive and not scene.ball.flying
    scene.to(715)
    assert scene[0].alive and (scene[0].x, scene[0].z) == (near(29.7493), near(-29.6931))
    assert (scene[0].fx, scene[0].fz) == (near(-0.7078), near(0.7064))
    assert (scene.beast.speed, scene.beast.turning, scene.beast.z) == (10.0, 50.0, near(24.5732))
    assert scene.ball.flying and scene.arena.target == 2 and scene.catch() == 756


def test_the_death_of_the_last_rival_ends_the_match():
    scene = Scene(2, seats=[0, 1], bare=False, lives=0)
    scene.draw(0.9)
    assert scene.catch() == 337 and scene.kill() == 450 and scene.arena.phase == OVER
    assert [(scene[i].place, scene[i].kills, scene[i].out) for i in (0, 1)] == [(1, 0, False), (2, -1, True)]
    assert (scene.beast.x, scene.beast.z) == (near(24.1793), near(19.3366))
    assert (scene.beast.speed, scene.beast.turning) == (near(11.8), near(54.0518))
    assert scene.gained[:, r.PLACEMENT].tolist() == [1.0, -1.0]


def test_a_death_by_a_pass_is_credited_to_the_passer():
    scene = Scene(2, seats=[0, 4])
    scene.hunt(1, z=-15.0, fz=-1.0, gz=-1.0)
    scene.arena.last = 0
    scene.kill()
    assert [scene[i].kills for i in (0, 1)] == [1, 0] and scene[1].humiliations == 0
    assert scene.gained[:, r.KILL].tolist() == [1.0, 0.0] and scene.gained[:, r.DEATH].tolist() == [0.0, -1.0]


def test_only_who_holds_the_ball_pays_for_it():
    scene = Scene(bare=False)
    scene.to(scene.catch() + 10)
    holder = int(scene.arena.carrier)
    paid = scene[holder].ticks_with_ball
    assert paid >= 10 and scene.gained[holder, r.BALL] == pytest.approx(-0.01 * paid)
    assert scene.gained[1 - holder, r.BALL] == 0.0


def test_the_gap_is_that_to_the_box_behind_the_root():
    scene = Scene()
    scene.hunt(0)
    scene.put(0, 0.0, 0.8)  # the box ends 1.2 behind the root
    assert gap(scene.beast, scene[0]) == near(2.0)
    scene.put(0, 0.75 + 3.0, -1.2 + 4.0)
    assert gap(scene.beast, scene[0]) == near(5.0)
