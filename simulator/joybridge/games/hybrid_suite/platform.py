"""Platform (Masson, Ranchod and Konidaris 2016): run, hop or leap over two gaps and past two enemies.

The rules are those of the program gym-platform. A decision is a whole run of one second, or a whole jump. Its reward is
the progress, so a return of 1 is the goal.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.games.hybrid_suite.platform_rules import (
    ARENA,
    DECISIONS,
    END,
    ENEMY_SPEED,
    ENEMY_START,
    GAPS,
    LEFT,
    MAX_SPEED_X,
    MAX_SPEED_Y,
    MAX_TICK_DRAWS,
    PLAYER_WIDTH,
    TOP,
    WIDTHS,
    advance,
)
from joybridge.games.hybrid_suite.suite_game import CHANNELS, METRICS, SuiteGame
from joybridge.simulator import ActArrays, Array, axis, behavior, branch, check_range, parameter, sensor
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import reserve
from joybridge.v1 import bridge_pb2 as pb

PICTURE = (640, 240)  # width, height

PARAMETERS = [parameter("noise", 0.0, 1.0, 1.0, "factor on the noise of motions and jumps")]

SENSORS = [
    sensor("player", [2], 0.0, 1.0, "the player", elements=["x", "velocity x"]),
    sensor("enemy", [2], 0.0, 1.0, "the enemy of the player's platform", elements=["x", "velocity x"]),
    sensor(
        "platforms",
        [5],
        0.0,
        1.0,
        "the player's platform and what follows it",
        elements=["width", "next width", "gap", "left", "height difference"],
    ),
]


class Platform(SuiteGame):
    """A player that jumps from platform to platform."""

    name = "platform"
    description = "Run, hop or leap over two gaps: three actions, each with a strength of its own."
    arena_dtype = ARENA
    parameters, sensors = PARAMETERS, SENSORS

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for the action and an axis for the strength of each."""
        player = behavior(
            "player",
            description="the reward is the share of the way that a decision has covered",
            sensors=SENSORS,
            axes=[
                axis("run", 0.0, 30.0, "push of a run, px/s per tick", only_with=("move", "run")),
                axis("hop", 0.0, 720.0, "length that a hop aims at, px", only_with=("move", "hop")),
                axis("leap", 0.0, 430.0, "length that a leap aims at, px", only_with=("move", "leap")),
            ],
            branches=[branch("move", ["run", "hop", "leap"])],
            channels=CHANNELS,
            metrics=METRICS,
        )
        return cls.record_spec(player, max_episode_decisions=DECISIONS, picture=PICTURE)

    def begin_where(self, which: Array) -> None:
        """Put the player at the left end.

        Nothing there is random, but an unused number keeps episodes after a reset from having the noise of the last.
        """
        reserve(self.streams, MAX_TICK_DRAWS)
        self.streams.cursor[which] += 1
        fields = self.fields
        for name, value in (("x", 0.0), ("y", TOP), ("vx", 0.0), ("vy", 0.0), ("busy", False)):
            fields[name][which] = value
        fields["enemy_x"][which], fields["enemy_v"][which] = ENEMY_START, -ENEMY_SPEED

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Run or jump."""
        move = act.choices[:, 0].copy()
        strength = act.axes[np.arange(len(move)), move].astype(np.float64)
        fields = self.fields
        fields["start"], fields["ticks"], fields["busy"] = fields["x"], 0, True
        reserve(self.streams, MAX_TICK_DRAWS)
        while advance(self.arenas, self.streams, move, strength, rewards):
            reserve(self.streams, MAX_TICK_DRAWS)

    def distance(self) -> Array:
        """Return how far every player is from the goal, px."""
        return END - self.fields["x"]

    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor."""
        _observe(self.arenas, *values)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.hybrid_suite.drawing import (
            draw_platform,
        )  # imported here because only pictures need pygame

        return draw_platform(arena, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        super().check_arenas(arenas)
        check_range("decisions", arenas["decisions"], 0, DECISIONS - 1)
        check_range("x", arenas["x"], 0.0, END)
        check_range("y", arenas["y"], TOP, 2.0 * MAX_SPEED_Y)
        check_range("vx", arenas["vx"], 0.0, MAX_SPEED_X)
        check_range("vy", arenas["vy"], -MAX_SPEED_Y, MAX_SPEED_Y)
        check_range("enemy_x", arenas["enemy_x"], 0.0, END)
        check_range("enemy_v", arenas["enemy_v"], -ENEMY_SPEED, ENEMY_SPEED)
        check_range("start", arenas["start"], 0.0, END)
        check_range("ticks", arenas["ticks"], 0, 2**31)
        check_range("busy", arenas["busy"].view(np.uint8), 0, 0)


@compiled
def _observe(arenas, player, enemy, platforms):
    """Write the sensors of every arena."""
    for i in range(len(arenas)):
        arena = arenas[i]
        near = 1 if arena.x > LEFT[1] else 0
        here = 0 if arena.x < LEFT[1] else 1 if arena.x < LEFT[2] else 2
        player[i, 0], player[i, 1] = (arena.x + PLAYER_WIDTH) / (END + PLAYER_WIDTH), arena.vx / MAX_SPEED_X
        enemy[i, 0] = arena.enemy_x[near] / END
        enemy[i, 1] = (arena.enemy_v[near] + ENEMY_SPEED) / (2.0 * ENEMY_SPEED)
        platforms[i, 0] = WIDTHS[here] / WIDTHS[1]
        platforms[i, 1] = (WIDTHS[here + 1] if here < 2 else 0.0) / WIDTHS[1]
        platforms[i, 2] = GAPS[here] / GAPS[1]
        platforms[i, 3] = LEFT[here] / END
        platforms[i, 4] = 0.0
