"""Beastly Rivals Onslaught as the service runs it: its spec, and the step of many arenas."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals import rules as r
from joybridge.simulator import BatchedGame, button, check_range, pointer, quiet_step
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, open_streams, reserve, restore_streams, save_streams
from joybridge.v1 import bridge_pb2 as pb

PLACE_UNIT, FAR_UNIT = 7.0, 10.0  # units of the position sensors: of what stays on the pitch, of what need not
PICTURE_WIDTH, PICTURE_HEIGHT = 640, 480

OPTIONS = [
    pb.Option(
        name="rules",
        description="original: the paper's game with every quirk; corrected: a blink is tried once per decision, "
        "the character arrives where it goes, episodes begin at rest, and overlaps at their beginning count",
        choices=["original", "corrected"],
        default_choice="original",
    ),
    pointer.OPTION,
    pb.Option(
        name="slow_character",
        description="whether the slow sphere slows the character, too; off in the original's game of two agents",
        choices=["on", "off"],
        default_choice="on",
    ),
]

PARAMETERS = [
    pb.Parameter(
        name="beast_speed",
        description="factor on the beast's speed: at the start, its growth and its limit",
        low=0.0,
        high=1.5,
        default_value=1.0,
    )
]


def _sensor(name: str, description: str, elements: list[str], low: list[float], high: list[float]) -> pb.Sensor:
    return pb.Sensor(
        name=name,
        description=description,
        dtype=pb.DTYPE_FLOAT32,
        shape=[len(elements)],
        elements=elements,
        low=low,
        high=high,
    )


# Cursor, character and sphere may be a little outside the pitch's boundary when they are observed. The beast
# is not confined at all: its bounds are several times what it reaches.
SENSORS = [
    _sensor("blink", "the character's blink", ["cooldown", "ready"], [0.0], [1.0]),
    _sensor("cursor", "the cursor's own motion", ["x", "z", "velocity x", "velocity z"], [-1.1], [1.1]),
    _sensor("character", "the character's motion", ["x", "z", "velocity x", "velocity z"], [-1.1], [1.1]),
    _sensor(
        "beast",
        "the beast, and where the character is as seen from it",
        ["character x", "character z", "x", "z", "velocity x", "velocity z", "speed", "accuracy"],
        [-10.0, -10.0, -10.0, -10.0, -1.6, -1.6, 0.0, 0.0],
        [10.0, 10.0, 10.0, 10.0, 1.6, 1.6, 1.6, 1.0],
    ),
    _sensor(
        "slow_sphere",
        "where the character is as seen from the slow sphere's center, and the sphere's motion",
        ["character x", "character z", "velocity x", "velocity z"],
        [-2.2, -2.2, -1.1, -1.1],
        [2.2, 2.2, 1.1, 1.1],
    ),
]

CHANNELS = [
    pb.RewardChannel(name="survival", description="+0.01 per tick", default_weight=1),
    pb.RewardChannel(name="death", description="-1 when the beast touches the character", default_weight=1),
    pb.RewardChannel(
        name="early_blink", description="-0.025 per tick in which a blink is tried too early", default_weight=1
    ),
]

METRICS = [
    pb.Metric(name="survival", description="decisions lived; the paper's logs show one fewer"),
    pb.Metric(name="blinks", description="successful blinks"),
    pb.Metric(name="clicks", description="decisions with move or blink pressed"),
    pb.Metric(name="slow_share", description="share of the ticks in which the slow sphere slowed the character"),
]


class BeastlyRivals(BatchedGame):
    """A character led by a cursor, a beast that hunts it, a sphere that slows. One behavior, one agent per arena."""

    name: ClassVar[str] = "beastly_rivals"
    options: ClassVar[list[pb.Option]] = OPTIONS
    description: ClassVar[str] = "Lead a character away from a beast that grows faster: click to walk, blink to escape."

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec; `locomotion` changes the device, and `steer` adds a sensor."""
        locomotion = pointer.LOCOMOTIONS[options["locomotion"]]
        survivor = pb.Behavior(
            name="survivor",
            description="the cursor, and the character that it leads; the ground is x-z, so the pointer's y is z",
            agents_per_arena=1,
            sensors=SENSORS + ([pointer.HEADING_SENSOR] if options["locomotion"] == "steer" else []),
            device=pb.Device(
                axes=locomotion.axes,
                branches=[
                    *locomotion.branches,
                    button("move", "send the character to the cursor"),
                    button("blink", "put the character at the cursor; a success ends the walk"),
                ],
            ),
            channels=CHANNELS,
            metrics=METRICS,
        )
        return pb.GameSpec(
            name=cls.name,
            description=cls.description,
            options=OPTIONS,
            parameters=PARAMETERS,
            behaviors=[survivor],
            decision_interval=r.DECISION_TICKS,
            tick_seconds=r.TICK,
            max_episode_decisions=r.CLOCK_TICKS // r.DECISION_TICKS,
            max_arenas=4096,
            picture=pb.PictureSize(width=PICTURE_WIDTH, height=PICTURE_HEIGHT),
            snapshot_bytes_per_arena=r.ARENA.itemsize + 64,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        rules = r.ORIGINAL if options["rules"] == "original" else r.CORRECTED
        self.rules = rules._replace(slow_character=options["slow_character"] == "on")
        self.steers = options["locomotion"] == "steer"
        self.locomotion = pointer.LOCOMOTIONS[options["locomotion"]]
        self.first_arena = first_arena
        self.arenas = np.zeros(arenas, r.ARENA).view(np.recarray)
        self.fields = self.arenas.view(np.ndarray)  # the same memory: looking up a recarray's attributes is slow
        self.streams: Streams
        self._begin(seed, parameters)

    def _begin(self, seed: int, parameters: Mapping[str, float]) -> None:
        self._set(parameters)
        self.streams = open_streams(seed, self.first_arena, len(self.arenas))
        r.begin(self.arenas, self.streams, self.rules)

    def _set(self, parameters: Mapping[str, float]) -> None:
        self.rules = self.rules._replace(beast_speed=parameters.get("beast_speed", self.rules.beast_speed))

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin new episodes everywhere, and the clock; see BatchedGame."""
        if seed is not None:
            self._begin(seed, parameters)
            return
        self._set(parameters)
        self.arenas.clock = 0
        self._begin_episodes(np.ones(len(self.arenas), bool))

    def _begin_episodes(self, which: Array) -> None:
        reserve(self.streams, r.MOST_DRAWS)
        r.begin_episodes(self.arenas, self.streams, self.rules, which)

    def observe(self) -> list[StepArrays]:
        """Return the present observations, with zero rewards and no ends."""
        return [quiet_step(self._observations(), len(CHANNELS))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision.

        A death restarts its arena alone, inside the running clock; at the clock's end all start over.
        """
        (act,) = acts
        arenas = self.arenas
        velocity = self.locomotion.velocity(act, self.fields["heading"]) * r.TOP_SPEED
        move, blink = np.ascontiguousarray(act.choices[:, -2:].T)
        rewards = np.zeros((len(arenas), len(CHANNELS)))
        reserve(self.streams, r.MOST_DRAWS)
        r.decide(arenas, self.streams, self.rules, velocity, move, blink, rewards)
        observations = self._observations()
        terminated = self.fields["dead"].copy()
        truncated = (self.fields["clock"] >= r.CLOCK_TICKS) & ~terminated
        step = StepArrays(observations, rewards.astype(np.float32), terminated, truncated)
        ends = terminated | truncated
        if ends.any():
            step.ended = np.flatnonzero(ends).astype(np.int32)
            step.final_observations = [sensor[ends] for sensor in observations]
            step.metrics = self._metrics()[ends]
            self._begin_episodes(ends)
            step.observations = self._observations()
        return [step]

    def _observations(self) -> list[Array]:
        sensors = [np.empty((len(self.arenas), *sensor.shape), np.float32) for sensor in SENSORS]
        _observe(self.arenas, *sensors)
        return [*sensors, pointer.observe_heading(self.fields["heading"])] if self.steers else sensors

    def _metrics(self) -> Array:
        arenas = self.arenas
        slow_share = arenas.slow_ticks / arenas.tick
        survival = arenas.tick // r.DECISION_TICKS
        return np.stack([survival, arenas.blinks, arenas.clicks, slow_share], axis=1).astype(np.float32)

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena."""
        from joybridge.games.beastly_rivals.drawing import draw  # pygame stays off the stepping path

        return draw(self.arenas[arena], PICTURE_WIDTH, PICTURE_HEIGHT)

    def save(self) -> dict[str, Array]:
        """Return arenas and random streams."""
        return {
            "arenas": np.frombuffer(self.arenas.tobytes(), np.uint8).reshape(len(self.arenas), -1),
            **save_streams(self.streams),
            "beast_speed": np.array([self.rules.beast_speed]),
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take back what `save` returned. Raises ValueError for a state that no game can be in."""
        arenas = np.frombuffer(state["arenas"].tobytes(), r.ARENA)
        for body in ("cursor", "character", "beast", "sphere"):
            for field in ("x", "z", "vx", "vz"):
                check_range(f"{body} {field}", arenas[body][field], -1e6, 1e6)
        for field in ("goal_x", "goal_z", "heading"):
            check_range(field, arenas[field], -1e6, 1e6)
        for field in ("moving", "character_slow", "beast_slow", "dead", "character_inside", "beast_inside", "touching"):
            check_range(field, arenas[field].view(np.uint8), 0, 1)
        for field in ("tick", "clock", "blinks", "clicks", "slow_ticks"):
            check_range(field, arenas[field], 0, r.CLOCK_TICKS)
        check_range("cooldown", arenas["cooldown"], 0, r.COOLDOWN_TICKS)
        check_range("timer", arenas["timer"], 0.0, r.SPHERE_TURN_SECONDS + 1.0)
        check_range("speed", arenas["speed"], 0.0, r.SPEED_LIMIT * PARAMETERS[0].high)
        check_range("accuracy", arenas["accuracy"], 0.0, r.ACCURACY_LIMIT)
        check_range("beast_speed", state["beast_speed"], PARAMETERS[0].low, PARAMETERS[0].high)
        restore_streams(self.streams, state)
        self.arenas[:] = arenas
        self._set({"beast_speed": float(state["beast_speed"][0])})


@compiled
def _observe(arenas, blink, cursor, character, beast, slow_sphere):
    """Write the sensors of every arena."""
    for i in range(len(arenas)):
        arena = arenas[i]
        blink[i, 0] = arena.cooldown / r.COOLDOWN_TICKS
        blink[i, 1] = 1.0 if arena.cooldown == 0 else 0.0
        _observe_motion(arena.cursor, PLACE_UNIT, r.TOP_SPEED, cursor[i])
        _observe_motion(arena.character, PLACE_UNIT, r.CHARACTER_SPEED, character[i])
        beast[i, 0] = (arena.character.x - arena.beast.x) / FAR_UNIT
        beast[i, 1] = (arena.character.z - arena.beast.z) / FAR_UNIT
        _observe_motion(arena.beast, FAR_UNIT, r.SPEED_LIMIT, beast[i, 2:6])
        beast[i, 6] = arena.speed / r.SPEED_LIMIT
        beast[i, 7] = arena.accuracy / r.ACCURACY_LIMIT
        slow_sphere[i, 0] = (arena.character.x - arena.sphere.x) / PLACE_UNIT
        slow_sphere[i, 1] = (arena.character.z - arena.sphere.z) / PLACE_UNIT
        slow_sphere[i, 2] = arena.sphere.vx / r.SPHERE_SPEED
        slow_sphere[i, 3] = arena.sphere.vz / r.SPHERE_SPEED


@compiled
def _observe_motion(body, place_unit, speed_unit, values):
    """Write position and velocity of a body into `values` [4], in the given units."""
    values[0], values[1] = body.x / place_unit, body.z / place_unit
    values[2], values[3] = body.vx / speed_unit, body.vz / speed_unit
