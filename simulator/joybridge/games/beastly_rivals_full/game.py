"""The complete Beastly Rivals Onslaught: its spec, and one step of many arenas."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.games.beastly_rivals_full import rules as r
from joybridge.games.beastly_rivals_full.check import check_arenas
from joybridge.games.beastly_rivals_full.scripts import SCRIPTS
from joybridge.games.beastly_rivals_full.sensing import observe, sensors
from joybridge.games.beastly_rivals_full.state import (
    ARENA,
    DECISION_TICKS,
    MAX_DECISIONS,
    MAX_LIVES,
    MAX_PLAYERS,
    OVER,
    TICK,
    Rules,
)
from joybridge.games.locomotion import LOCOMOTION_OPTION, LOCOMOTIONS, observe_heading
from joybridge.games.record_game import RecordGame
from joybridge.simulator import (
    ActArrays,
    Array,
    StepArrays,
    behavior,
    branch,
    channel,
    metric,
    option,
    parameter,
    quiet_step,
)
from joybridge.simulator.randomness import Streams, reserve
from joybridge.v1 import bridge_pb2 as pb

PICTURE = (720, 480)  # width, height
PAUSES = {"original": (300, 150, 150), "short": (50, 25, 25)}  # ticks: before the first ball, after a death, revival

OPTIONS = [
    option("players", [str(count) for count in range(2, MAX_PLAYERS + 1)], "4", "how many players a match has"),
    option("lives", [str(count) for count in range(MAX_LIVES + 1)], "2", "deaths that a player survives"),
    option(
        "rules",
        ["original", "corrected"],
        description="original: the public game with all its quirks; corrected: each touch of a carrier kills, short "
        "moves are obeyed, a weak power shot does not slow the beast, and its limits are exact",
    ),
    LOCOMOTION_OPTION,
    option(
        "pauses",
        list(PAUSES),
        description="original: 6 s before the first ball and after a death; short: 1 s",
    ),
    option(
        "rewards",
        ["zero_sum", "separate"],
        description="zero_sum: in every channel, an agent's own reward minus the mean of the rivals' that play; "
        "separate: its own",
    ),
]

PARAMETERS = [
    parameter("beast_speed", 0.0, 1.5, 1.0, "factor on the beast's speed: its initial value, growth and limit"),
    parameter("beast_turning", 0.5, 2.0, 1.0, "factor on the beast's turning at all times"),
    parameter("ball_speed", 0.5, 2.0, 1.0, "factor on the ball's speed"),
]

CHANNELS = [
    channel("survival", 0.0, "+0.01 per tick alive"),
    channel("kill", 0.5, "+1 when a rival dies with the ball that the agent threw to it"),
    channel("death", 0.5, "-1 per death"),
    channel("humiliation", 0.25, "-1 per death with a ball that no player threw"),
    channel("placement", 2.0, "when it is decided: from +1 for the winner down to -1 for who is out first"),
    channel("ball", 0.0, "-0.01 per tick with the ball"),
]

METRICS = [
    metric("place", "1 for the winner; equal players share the mean of their places"),
    metric("won", "whether the match had a winner and it was this agent"),
    metric("kills", "deaths of rivals by its passes, minus its humiliations"),
    metric("deaths", "deaths"),
    metric("humiliations", "deaths with a ball that no player threw"),
    metric("passes", "throws"),
    metric("power_shots", "throws of a charged ball"),
    metric("blinks", "blinks"),
    metric("survival", "decisions until it was out, or until the end"),
    metric("ball_share", "fraction of the ticks alive with the ball"),
    metric("clicks", "decisions with a click"),
]


class BeastlyRivalsFull(RecordGame):
    """Two to eight players, a ball, and a beast that hunts who has it. One behavior; all its agents play one match."""

    name = "beastly_rivals_full"
    description = "Pass a ball before the beast reaches you; the last of two to eight players wins."
    options = OPTIONS
    arena_dtype: ClassVar[np.dtype[np.void]] = ARENA
    parameters, channels = PARAMETERS, CHANNELS

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec. The options `players` and `locomotion` change it."""
        locomotion, players = LOCOMOTIONS[options["locomotion"]], int(options["players"])
        rival = behavior(
            "rival",
            description="a pointer, and the player that it leads; the ground is x-z, so the pointer's y is z",
            sensors=[*sensors(players), *locomotion.sensors],
            axes=locomotion.axes,
            branches=[
                *locomotion.branches,
                branch(
                    "click",
                    ["none", "click", "double_click"],
                    "on a rival: pass the ball to it; elsewhere: walk there, or blink there if it is a double click",
                ),
            ],
            channels=CHANNELS,
            metrics=METRICS,
            scripts=SCRIPTS,
            agents=players,
        )
        return cls.record_spec(
            rival,
            decision_interval=DECISION_TICKS,
            tick_seconds=TICK,
            max_episode_decisions=MAX_DECISIONS,
            picture=PICTURE,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        players = int(options["players"])
        original = options["rules"] == "original"
        start_ticks, dead_ticks, revive_ticks = PAUSES[options["pauses"]]
        self.rules = Rules(
            enter_only=original,
            ignores_short_moves=original,
            weak_shots_slow=original,
            overshoots=original,
            zero_sum=options["rewards"] == "zero_sum",
            players=players,
            lives=int(options["lives"]),
            start_ticks=start_ticks,
            dead_ticks=dead_ticks,
            revive_ticks=revive_ticks,
        )
        self.agents = players
        self.locomotion = LOCOMOTIONS[options["locomotion"]]
        self._shapes = [(arenas * self.agents, *sensor.shape) for sensor in sensors(players)]
        super().__init__(options, parameters, arenas, first_arena, seed)

    def begin(self) -> None:
        """Begin a first match in every arena."""
        self.begin_episodes()

    def begin_episodes(self) -> None:
        """Begin a new match in every arena."""
        reserve(self.streams, r.MAX_DRAWS)
        self._begin_episodes(np.ones(len(self.arenas), bool))

    def _begin_episodes(self, which: Array) -> None:
        kept = {parameter.name: self.fields[parameter.name][which] for parameter in PARAMETERS}
        self.fields[which] = np.zeros((), ARENA)
        for name, values in kept.items():
            self.fields[name][which] = values
        r.begin_episodes(self.arenas, self.streams, self.rules, which)

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. A match ends for all its lanes at once, and the next one begins."""
        (act,) = acts
        lanes = len(self.arenas) * self.agents
        heading = self.headings()
        velocity = self.locomotion.velocity(act, heading) * r.TOP_SPEED
        scripts = np.zeros(lanes, np.int32) if act.scripts is None else act.scripts.copy()
        if self.locomotion.sensors:
            self._turn(heading, scripts)
        rewards = np.empty((lanes, len(CHANNELS)), np.float32)
        reserve(self.streams, r.MAX_DRAWS)
        clicks = act.choices[:, -1].copy()

        def decide(arenas: Array, streams: Streams, rewards: Array, ticks: int) -> None:
            r.decide(arenas, streams, self.rules, velocity, clicks, scripts, rewards, ticks)

        self.play_ticks(DECISION_TICKS, decide, rewards)
        step = StepArrays(self.observations(), rewards, np.zeros(lanes, bool), np.zeros(lanes, bool))
        over = self.fields["phase"] == OVER
        ends = over | (self.fields["tick"] >= MAX_DECISIONS * DECISION_TICKS)
        if ends.any():
            ended = np.flatnonzero(ends)
            ended_lanes = np.repeat(ends, self.agents)
            step.terminated = np.repeat(over, self.agents) | (ended_lanes & self._of_lanes("out"))
            step.truncated = ended_lanes & ~step.terminated
            step.ended = np.flatnonzero(ended_lanes).astype(np.int32)
            step.final_observations = [sensor[ended_lanes] for sensor in step.observations]
            step.metrics = self._metrics(ended)
            played = self.played_parameters(ended)
            step.parameters = None if played is None else np.repeat(played, self.agents, axis=0)
            self.draw_parameters(ended)
            self._begin_episodes(ends)
            step.observations = self.observations()
        step.deciding = self._of_lanes("alive")
        return [step]

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        step = quiet_step(self.observations(), len(CHANNELS))
        step.deciding = self._of_lanes("alive")
        return [step]

    def observations(self) -> list[Array]:
        """Return the current observations, float32 [lanes, *shape] per sensor."""
        values = [np.empty(shape, np.float32) for shape in self._shapes]
        observe(self.arenas, self.rules, self.agents, *values)
        return [*values, observe_heading(self.headings())] if self.locomotion.sensors else values

    def headings(self) -> Array:
        """Return the heading of every lane's pointer, rad."""
        return self._of_lanes("heading")

    def _turn(self, heading: Array, scripts: Array) -> None:
        """Set the headings of the pointers of living players that no script plays, rad [lanes]."""
        players = self.fields["players"][:, : self.agents]
        obeys = players["alive"] & (scripts == 0).reshape(players.shape)
        players["heading"] = np.where(obeys, heading.reshape(players.shape), players["heading"])

    def _of_lanes(self, field: str) -> Array:
        """Return a copy of a field of the players that are agents, [lanes]."""
        values: Array = self.fields["players"][field][:, : self.agents].flatten()
        return values

    def _metrics(self, ended: Array) -> Array:
        """Return the metrics of the agents of ended matches, float32 [ended lanes, metrics]."""
        players = self.fields["players"][ended, : self.agents].reshape(-1)
        tick, over = (np.repeat(self.fields[name][ended], self.agents) for name in ("tick", "phase"))
        columns = [
            players["place"],
            ~players["out"] & (over == OVER),
            *(players[name] for name in ("kills", "deaths", "humiliations", "passes", "power_shots", "blinks")),
            np.where(players["out"], players["out_tick"], tick) / DECISION_TICKS,
            players["ticks_with_ball"] / np.maximum(players["ticks_alive"], 1),
            players["clicks"],
        ]
        return np.stack(columns, axis=1).astype(np.float32)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.beastly_rivals_full.drawing import draw  # imported here because only pictures need pygame

        return draw(arena, self.rules, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        check_arenas(arenas, self.rules)
