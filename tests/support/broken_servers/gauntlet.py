"""The game on which every rule can be tried."""

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.simulator import (
    BatchedGame,
    axis,
    behavior,
    branch,
    button,
    channel,
    check_range,
    draw_parameters,
    image,
    option,
    parameter,
    sensor,
    spec,
)

LENGTH, PRESSES, GEAR, DRAWS = range(4)  # columns of Gauntlet.counts
LONGEST = 9


class Gauntlet(BatchedGame):
    """Well-behaved, with all that a game can have: three devices, masks, lanes that wait, pictures, snapshots."""

    name = "gauntlet"
    description = "Move a point, change gears, and be judged every other time."

    options = (option("size", ["small", "large"]),)

    @classmethod
    def describe(cls, options):
        sensors = [
            sensor("place", [2], -9.0, 9.0),
            sensor("count", [1], dtype="int32"),
            image("image", 2, 2 if options["size"] == "small" else 5),
            sensor("lamps", [3], dtype="bool"),
        ]
        player = behavior(
            "player",
            sensors=sensors,
            axes=[axis("x", kind="velocity", way="right"), axis("force", 0.5, 2.0, only_with=("gear", "high"))],
            branches=[branch("gear", ["low", "middle", "high"], keys=["1", "", "3"]), button("press", key="space")],
            channels=[channel("gain"), channel("cost", 0.5)],
            metrics=["length", "presses"],
        )
        judge = behavior("judge", sensors=[sensor("lead", [1])], branches=[button("verdict")], agents=2)
        runner = behavior(
            "runner",
            sensors=[sensor("track", [1])],
            axes=[axis("pace")],
            metrics=["pace"],
            scripts={"walker": "a quarter of the way", "sprinter": "all of it"},
        )
        return spec(
            cls,
            [player, judge, runner],
            parameters=[parameter("drift", 0.0, 2.0, 1.0)],
            tick_seconds=0.05,
            decision_interval=2,
            max_episode_decisions=LONGEST,
            max_arenas=16,
            snapshot_bytes_per_arena=96,
            picture=(8, 6),
            parameters_per_episode=True,
        )

    def __init__(self, options, parameters, arenas, first_arena, seed):
        self.cells = 2 if options["size"] == "small" else 5
        self.arenas, self.first_arena = arenas, first_arena
        self.drift = np.ones(arenas)
        self.parameters = self.describe(options).parameters
        self.reset(seed, parameters)

    def reset(self, seed, parameters):
        self.drift[:] = parameters.get("drift", self.drift)
        if seed is not None:
            self.seed = seed
            self.episodes = np.zeros(self.arenas, np.int64)
            self.counts = np.zeros((self.arenas, 4), np.int64)
        self.place = np.zeros((self.arenas, 2))
        self.earned = np.zeros((self.arenas, 2), np.float32)
        for arena in range(self.arenas):
            self.begin(arena)

    def begin(self, arena):
        self.drift[arena] = self.drawn(arena).get("drift", self.drift[arena])
        self.episodes[arena] += 1
        self.counts[arena, :DRAWS] = 0
        self.place[arena] = self.draws(arena)

    def drawn(self, arena):
        """Return the parameters of the next episode that are drawn."""
        if not self.distributions:
            return {}
        key = np.array([self.seed, self.first_arena + arena], np.uint64)
        return draw_parameters(self.distributions, self.parameters, key, self.episodes[arena])

    def draws(self, arena):
        """Return two random numbers that depend on the seed, the arena and how many there were before."""
        self.counts[arena, DRAWS] += 1
        return np.random.default_rng([self.seed, self.first_arena + arena, self.counts[arena, DRAWS]]).normal(size=2)

    def observe(self):
        return [self.part(index, None) for index in range(3)]

    def step(self, acts):
        player, judge, runner = acts
        self.tick_pictures = [] if self.drawn_by_tick is None else [self.draw(self.drawn_by_tick)]
        if runner.scripts is not None:
            paces = np.choose(runner.scripts, [runner.axes[:, 0], 0.25, 1.0])
            runner = ActArrays(paces[:, None].astype(np.float32), runner.choices)
        self.counts[:, LENGTH] += 1
        self.counts[:, PRESSES] += player.choices[:, 1]
        self.counts[:, GEAR] = player.choices[:, 0]
        moves = np.stack([self.draws(arena) for arena in range(self.arenas)])
        self.place += moves * self.drift[:, None] + player.axes[:, :1] * self.force(player) + runner.axes
        self.place = np.clip(self.place, -9.0, 9.0)
        self.earned += judge.choices.reshape(self.arenas, 2)
        far = np.abs(self.place).max(axis=1) > 5.0
        late = ~far & (self.counts[:, LENGTH] == self.longest)
        ended = np.flatnonzero(far | late)
        last = [self.observations(index) for index in range(3)]
        rewards = [
            np.stack([self.place[:, 0], -0.25 * player.choices[:, 1]], axis=1).astype(np.float32),
            self.earned.reshape(-1, 1).copy(),
            self.place[:, 1:].astype(np.float32),
        ]
        metrics = [self.counts[ended, :2].astype(np.float32), None, runner.axes[ended]]
        self.played = self.drift[ended, None].astype(np.float32)
        for arena in ended:
            self.begin(arena)
        due = (far | late) | self.judging()
        rewards[1][~np.repeat(due, 2)] = 0.0
        self.earned[due] = 0.0
        return [self.part(index, (rewards[index], far, late, ended, last[index], metrics[index])) for index in range(3)]

    longest = LONGEST

    def force(self, player):
        return np.where(player.choices[:, :1] == 2, player.axes[:, 1:], 1.0)

    def judging(self):
        return self.counts[:, LENGTH] % 2 == 1

    def observations(self, index):
        gears = self.counts[:, GEAR : GEAR + 1]
        if index == 1:
            return [np.repeat(self.place[:, :1], 2, axis=0).astype(np.float32)]
        if index == 2:
            return [self.place[:, 1:].astype(np.float32)]
        picture = np.broadcast_to(gears.astype(np.uint8)[:, :, None, None], (self.arenas, 2, self.cells, 1))
        return [self.place.astype(np.float32), self.counts[:, :1].astype(np.int32), picture, gears == np.arange(3)]

    def part(self, index, happened):
        agents = 2 if index == 1 else 1
        lanes = self.arenas * agents
        step = StepArrays(
            self.observations(index),
            np.zeros((lanes, 2 if index == 0 else 1), np.float32),
            np.zeros(lanes, bool),
            np.zeros(lanes, bool),
        )
        if index == 0:
            gear = self.counts[:, GEAR : GEAR + 1]
            step.masks = [abs(np.arange(3) - gear) <= 1, np.ones((lanes, 2), bool)]
        if index == 1:
            step.deciding = np.repeat(self.judging(), 2)
        if happened:
            rewards, far, late, ended, last, metrics = happened
            step.rewards = rewards
            step.terminated, step.truncated = np.repeat(far, agents), np.repeat(late, agents)
            step.ended = (ended[:, None] * agents + np.arange(agents)).reshape(-1).astype(np.int32)
            if len(ended):
                step.final_observations, step.metrics = [values[step.ended] for values in last], metrics
                if self.distributions:
                    step.parameters = np.repeat(self.played, agents, axis=0)
        return step

    def draw(self, arena):
        picture = np.zeros((6, 8, 3), np.uint8)
        picture[:] = self.counts[arena, :3]
        picture[0, 0] = list(np.float32(self.place[arena, 0]).tobytes()[:3])
        return picture

    def save(self):
        of_episodes = {"seed": np.array([self.seed], np.uint64), "drift": self.drift, "episodes": self.episodes}
        return {"place": self.place, "counts": self.counts, "earned": self.earned, **of_episodes}

    def restore(self, state):
        self.check(state)
        self.place, self.counts, self.earned = (state[name].copy() for name in ("place", "counts", "earned"))
        self.seed, self.drift, self.episodes = int(state["seed"][0]), state["drift"].copy(), state["episodes"].copy()

    def check(self, state):
        """Raise ValueError for numbers that no session has saved."""
        for name, low, high in (
            ("place", -9, 9),
            ("counts", 0, 2**40),
            ("earned", 0, LONGEST),
            ("drift", 0, 2),
            ("episodes", 0, 2**40),
        ):
            check_range(name, state[name], low, high)
