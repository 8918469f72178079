"""Robot Soccer Goal, and Hard Goal (Li et al. 2022), which divides its shots into ten: spec, sensors and decisions."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from joybridge.games.hybrid_suite import soccer as s
from joybridge.games.hybrid_suite.suite_game import METRICS, SuiteGame
from joybridge.simulator import (
    ActArrays,
    Array,
    axis,
    behavior,
    branch,
    channel,
    check_range,
    option,
    parameter,
    sensor,
)
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import reserve
from joybridge.v1 import bridge_pb2 as pb

PICTURE = (480, 480)  # width, height
MAX_PLAYER_SPEED, MAX_BALL_SPEED = 1.0, 3.0  # units of their sensors

PARAMETERS = [parameter("noise", 0.0, 1.0, 1.0, "factor on the noise of kicks and steps")]

MOTION = ["x", "y", "velocity x", "velocity y"]
SENSORS = [
    sensor(
        "player",
        [5],
        description="the player, in units of the field, of the top speed and of pi",
        elements=[*MOTION, "angle"],
    ),
    sensor("keeper", [5], description="the keeper, likewise", elements=[*MOTION, "angle"]),
    sensor("ball", [4], description="the ball, likewise", elements=MOTION),
    sensor(
        "line",
        [3],
        description="the line from the keeper to the ball: its direction, and where it meets the line of the goal",
        elements=["x", "y", "place"],
    ),
]

KICK_AXES = [
    axis("kick_x", 0.0, 2 * s.LENGTH, "x that a kick aims at", only_with=("act", "kick")),
    axis(
        "kick_y",
        -s.HALF_WIDTH,
        s.HALF_WIDTH,
        "y that a kick aims at; the original ignores it",
        only_with=("act", "kick"),
    ),
]

# Hard Goal: the parts of the goal's line that its shots aim at, as shares of the half goal. In the original, the middle
# one is a point.
SECTORS = {
    "original": [(-1.0, -0.6), (-0.6, -0.2), (0.2, 0.2), (0.2, 0.6), (0.6, 1.0)],
    "corrected": [(-1.0, -0.6), (-0.6, -0.2), (-0.2, 0.2), (0.2, 0.6), (0.6, 1.0)],
}


class Goal(SuiteGame):
    """A striker that dribbles and shoots past a keeper."""

    name = "goal"
    description = "Kick the ball ahead or shoot at the goal past a keeper: three actions with parameters of their own."
    options = (
        option(
            "rules",
            ["original", "corrected"],
            description="original: the published program with its quirks; corrected: a kick goes where it aims, misses "
            "cost the same on both sides, and the line from the keeper to the ball is limited to the goal",
        ),
    )
    arena_dtype: ClassVar[np.dtype[np.void]] = s.ARENA
    parameters, sensors = PARAMETERS, SENSORS
    channels: ClassVar[list[pb.RewardChannel]] = [
        channel("goal", description="50 for a goal"),
        channel("miss", description="minus the distance of the ball from the goal, at the end without one"),
    ]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for the action, and axes for what each aims at."""
        striker = behavior(
            "striker",
            description="scores, or else ends with the ball near the goal",
            sensors=SENSORS,
            axes=[*KICK_AXES, *cls.shot_axes()],
            branches=[branch("act", cls.actions())],
            channels=cls.channels,
            metrics=METRICS,
        )
        return cls.record_spec(striker, picture=PICTURE)

    @classmethod
    def actions(cls) -> Sequence[str]:
        """Return the choices of the branch: the kick and the shots."""
        return ["kick", "left", "right"]

    @classmethod
    def shot_axes(cls) -> list[pb.Axis]:
        """Return the axis of each shot."""
        return [
            axis(shot, -s.GOAL_HALF, s.GOAL_HALF, "y that this shot aims at", only_with=("act", shot))
            for shot in ("left", "right")
        ]

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.quirks = options["rules"] == "original"
        self.rules = s.ORIGINAL if self.quirks else s.CORRECTED
        super().__init__(options, parameters, arenas, first_arena, seed)

    def begin_where(self, which: Array) -> None:
        """Put all at their places."""
        reserve(self.streams, s.MAX_TICK_DRAWS)  # as many as decisions, whose calls go on while any arena is busy
        s.begin_episodes(self.arenas, self.streams, which)

    def aims(self, act: ActArrays) -> tuple[Array, Array, Array]:
        """Return what each arena does: KICK, LEFT or RIGHT, and the point that it aims at, float64 [arenas] each."""
        action, axes = act.choices[:, 0].copy(), act.axes.astype(np.float64)
        y = np.where(action == s.KICK, axes[:, 1], axes[np.arange(len(axes)), 1 + action])
        return action, axes[:, 0].copy(), y

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Kick and go after the ball, or shoot."""
        action, x, y = self.aims(act)
        self.fields["ticks"], self.fields["busy"] = 0, True
        reserve(self.streams, s.MAX_TICK_DRAWS)
        while s.advance(self.arenas, self.streams, self.rules, action, x, y, rewards):
            reserve(self.streams, s.MAX_TICK_DRAWS)

    def by_channel(self, rewards: Array) -> Array:
        """Return what is paid for goals, and for misses."""
        return np.stack([np.maximum(rewards, 0.0), np.minimum(rewards, 0.0)], axis=1).astype(np.float32)

    def distance(self) -> Array:
        """Return how far every ball is from the goal."""
        ball = self.fields["ball"]
        ahead, beside = np.maximum(s.LENGTH - ball["x"], 0.0), np.maximum(np.abs(ball["y"]) - s.GOAL_HALF, 0.0)
        return np.sqrt(ahead * ahead + beside * beside)

    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor."""
        _observe(self.arenas, 2.0 * s.GOAL_HALF if self.quirks else s.GOAL_HALF, *values)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.hybrid_suite.drawing import draw_goal  # imported here because only pictures need pygame

        return draw_goal(arena, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        super().check_arenas(arenas)
        check_range("decisions", arenas["decisions"], 0, s.DECISIONS - 1)
        for body in ("player", "keeper", "ball"):
            for field in ("x", "y", "angle"):
                check_range(f"{body} {field}", arenas[body][field], -1e3, 1e3)
            for field in ("vx", "vy"):
                check_range(f"{body} {field}", arenas[body][field], -s.BALL.top, s.BALL.top)
        check_range("ticks", arenas["ticks"], 0, s.MAX_TICKS)
        check_range("busy", arenas["busy"].view(np.uint8), 0, 0)


class HardGoal(Goal):
    """The same with ten shots, each at a part of the goal."""

    name = "hard_goal"
    description = "Goal with ten shots, each at a fifth of the goal: eleven actions with twelve parameters."

    @classmethod
    def actions(cls) -> Sequence[str]:
        """Return the choices of the branch: the kick and the shots."""
        return ["kick", *_shots()]

    @classmethod
    def shot_axes(cls) -> list[pb.Axis]:
        """Return the axis of each shot."""
        place = "place in this shot's part of the goal, from high to low y"
        return [axis(shot, description=place, only_with=("act", shot)) for shot in _shots()]

    def aims(self, act: ActArrays) -> tuple[Array, Array, Array]:
        """Return what each arena does, and the point that it aims at."""
        choice, axes = act.choices[:, 0], act.axes.astype(np.float64)
        low, high = np.array(SECTORS["original" if self.quirks else "corrected"])[(choice - 1) % 5].T
        place = axes[np.arange(len(axes)), 1 + choice]
        share = (low + high) / 2 + place * (low - high) / 2
        action = np.where(choice == 0, s.KICK, np.where(choice < 6, s.LEFT, s.RIGHT))
        return action, axes[:, 0].copy(), np.where(choice == 0, axes[:, 1], s.GOAL_HALF * share)


def _shots() -> list[str]:
    return [f"{side}_{number}" for side in ("left", "right") for number in range(1, 6)]


@compiled
def _observe(arenas, highest, player, keeper, ball, line):
    """Write the sensors of every arena. highest: y of the goal's line to which the last element is limited."""
    for i in range(len(arenas)):
        arena = arenas[i]
        _observe_motion(arena.player, MAX_PLAYER_SPEED, player[i])
        _observe_motion(arena.keeper, MAX_PLAYER_SPEED, keeper[i])
        _observe_motion(arena.ball, MAX_BALL_SPEED, ball[i])
        player[i, 4], keeper[i, 4] = arena.player.angle / np.pi, arena.keeper.angle / np.pi
        dx, dy = arena.ball.x - arena.keeper.x, arena.ball.y - arena.keeper.y
        distance = max(np.sqrt(dx * dx + dy * dy), 1e-12)
        line[i, 0], line[i, 1] = dx / distance, dy / distance
        if dx == 0.0:
            place = -s.GOAL_HALF if dy > 0.0 else s.GOAL_HALF
        else:
            place = min(max(dy / dx * (s.LENGTH - arena.ball.x) + arena.ball.y, -s.GOAL_HALF), highest)
        line[i, 2] = 2.0 * (place + s.GOAL_HALF) / (highest + s.GOAL_HALF) - 1.0


@compiled
def _observe_motion(body, top_speed, values):
    """Write place and velocity of a body, in ±1 on the field."""
    values[0], values[1] = 2.0 * body.x / s.LENGTH - 1.0, body.y / s.HALF_WIDTH
    values[2], values[3] = body.vx / top_speed, body.vy / top_speed
