"""The suites of `joybridge compare --suite`, and their tasks."""

from collections.abc import Mapping
from typing import NamedTuple

from joybridge.config.metrics import HELD_OUT

ALL_IN_THE_LOSS = "policy.only_with=false"  # of tasks whose choices have parameters of their own


class Task(NamedTuple):
    """A task of a suite."""

    config: str  # the name of an installed configuration
    overrides: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()  # of the configuration, one at a time, KEY=VALUE each
    layouts: tuple[str, ...] = ()
    metric: str = "reward"  # of the episodes at the end, with the most probable actions
    aim: str = ""  # what is good, for people
    gym: str = ""  # the environment, if the game is one

    @property
    def scored(self) -> str:
        """Return the column that is the score of a run."""
        return f"{HELD_OUT}{self.metric}"


class Suite(NamedTuple):
    """Tasks that are compared in the same way."""

    tasks: Mapping[str, Task]
    beside: str = ""  # another trainer
    aims: str = ""  # head of their column; "": there are none


MISSES = "bucket-21, misses as in the original: layout=bucket-21 policy.reward_weights.miss=1"  # of Goal


def _hybrid(name: str, aim: str, layout: str, *changes: str, metric: str = "success") -> Task:
    return Task(f"hybrid_suite/{name}", (), (ALL_IN_THE_LOSS, f"layout={layout}", *changes), metric=metric, aim=aim)


def _hard_move(actuators: int, stretch: str) -> Task:
    layouts, aim = ("hybrid", "hybrid, power=bucket-5"), f"0.85 / {stretch}"
    return Task("hybrid_suite/hard_move", (f"options.actuators={actuators}",), (), layouts, "success", aim)


SUITES = {
    "hybrid": Suite(
        {
            "platform": _hybrid("platform", "0.90 / 0.98", "bucket-11", metric="reward"),
            "goal": _hybrid("goal", "0.50 / 0.78", "bucket-21", MISSES),
            "hard_goal": _hybrid("hard_goal", "0.40 / 0.60", "bucket-21", MISSES),
            "catch_point": _hybrid("catch_point", "0.85 / 0.93", "bucket-16"),
            "moving": _hybrid("moving", "0.90 / 0.98", "bucket-11"),
            "sliding": _hybrid("sliding", "0.80 / 0.95", "bucket-11"),
            **{f"hard_move-{n}": _hard_move(n, "0.94" if n == 4 else "0.95") for n in (4, 6, 8, 10)},
        },
        aims="pass / stretch",
    ),
    "classic": Suite(
        {
            "cartpole": Task("classic/cartpole", gym="CartPole-v1"),
            "acrobot": Task("classic/acrobot", gym="Acrobot-v1"),
            "pendulum": Task("classic/pendulum", gym="Pendulum-v1"),
            "lunarlander": Task("classic/lunarlander", gym="LunarLander-v3"),
            "lunarlander_continuous": Task("classic/lunarlander_continuous", gym="LunarLanderContinuous-v3"),
            "bipedalwalker": Task("classic/bipedalwalker", gym="BipedalWalker-v3"),
            "halfcheetah": Task("classic/halfcheetah", gym="HalfCheetah-v5"),
            "hopper": Task("classic/hopper", gym="Hopper-v5"),
            "walker2d": Task("classic/walker2d", gym="Walker2d-v5"),
            "ant": Task("classic/ant", gym="Ant-v5"),
        },
        beside="sb3",
    ),
}
