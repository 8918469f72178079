"""Beastly Rivals Onslaught: its spec, its sensors, and one step of many arenas."""

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.games import level_sets
from joybridge.games.beastly_rivals import picture, pitches
from joybridge.games.beastly_rivals import rules as r
from joybridge.games.locomotion import LOCOMOTION_OPTION, LOCOMOTIONS
from joybridge.games.pictures import Eye, Field
from joybridge.games.pointer_game import PointerGame
from joybridge.games.sight import SIGHT_OPTIONS
from joybridge.simulator import (
    ActArrays,
    Array,
    StepArrays,
    behavior,
    button,
    channel,
    check_range,
    metric,
    option,
    parameter,
    sensor,
)
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams
from joybridge.v1 import bridge_pb2 as pb

GOLDEN_RATIO = (1.0 + math.sqrt(5.0)) / 2.0  # its multiples, without their integers, are spread evenly over 0..1
PLACE_UNIT, FAR_UNIT = 7.0, 10.0  # units of position sensors: of bodies on the pitch, and of those that may leave it
PICTURE = (640, 480)  # width, height

OPTIONS = [
    option(
        "rules",
        ["original", "corrected"],
        description="original: the paper's game with all its quirks; corrected: a blink is tried once per decision, "
        "the character stops at its goal, episodes begin at rest, and overlaps at their beginning count",
    ),
    LOCOMOTION_OPTION,
    option(
        "slow_character",
        ["on", "off"],
        description="whether the slow sphere also slows the character; off in the original's game of two agents",
    ),
    option(
        "clock",
        ["together", "spread"],
        description="together: the clocks of all arenas begin at 0, as in the original; spread: each arena's clock "
        "begins at another time, so an update sees all phases of the game, and an arena's first episodes are shorter",
    ),
    level_sets.LEVELS_OPTION,
    *SIGHT_OPTIONS,
]

PARAMETERS = [
    parameter("beast_speed", 0.0, 1.5, 1.0, "factor on the beast's speed: its initial value, growth and limit"),
    *level_sets.PARAMETERS,
]

MOTION = ["x", "z", "velocity x", "velocity z"]

# Cursor, character and sphere may be slightly outside the pitch's boundary when they are observed. The beast is not
# confined; its bounds are several times the values that it reaches.
NUMBERS = [
    sensor("blink", [2], 0.0, 1.0, "the character's blink", elements=["cooldown", "ready"]),
    sensor("cursor", [4], -1.1, 1.1, "position and velocity of the cursor", elements=MOTION),
    sensor("character", [4], -1.1, 1.1, "position and velocity of the character", elements=MOTION),
    sensor(
        "beast",
        [8],
        [-10.0, -10.0, -10.0, -10.0, -1.6, -1.6, 0.0, 0.0],
        [10.0, 10.0, 10.0, 10.0, 1.6, 1.6, 1.6, 1.0],
        "the beast, and the character's position relative to it",
        elements=["character x", "character z", *MOTION, "speed", "accuracy"],
    ),
    sensor(
        "slow_sphere",
        [4],
        [-2.2, -2.2, -1.1, -1.1],
        [2.2, 2.2, 1.1, 1.1],
        "the character's position relative to the slow sphere's center, and the sphere's velocity",
        elements=["character x", "character z", "velocity x", "velocity z"],
    ),
]

PITCH = [  # also sensed on generated pitches
    sensor(
        "surroundings",
        [pitches.RAYS, 2],
        -1.0,
        1.0,
        "twelve rays of 7 units from the character, 30° apart, counter-clockwise from +x; -1: nothing hit",
        elements=[f"{30 * k}° {what}" for k in range(pitches.RAYS) for what in ("pillar", "edge")],
    ),
    sensor(
        "sphere_radius", [1], 0.0, 2.0, "radius of the slow sphere, as a share of the original one", elements=["radius"]
    ),
]

CHANNELS = [
    channel("survival", 1.0, "+0.01 per tick"),
    channel("death", 1.0, "-1 when the beast touches the character"),
    channel("early_blink", 1.0, "-0.025 per tick in which a blink is tried too early"),
]

METRICS = [
    metric("survival", "decisions survived; the paper's logs show one fewer"),
    metric("blinks", "successful blinks"),
    metric("clicks", "decisions with move or blink pressed"),
    metric("slow_share", "fraction of the ticks in which the slow sphere slowed the character"),
]


class BeastlyRivals(PointerGame):
    """A character led by a cursor, a beast that hunts it, a sphere that slows. One behavior, one agent per arena."""

    name = "beastly_rivals"
    description = "Lead a character away from a beast that grows faster: click to walk, blink to escape."
    version = "1"
    options = OPTIONS
    arena_dtype: ClassVar[np.dtype[np.void]] = r.ARENA
    parameters, channels, field = PARAMETERS, CHANNELS, picture.FIELD

    @classmethod
    def numbers(cls, options: Mapping[str, str]) -> list[pb.Sensor]:
        """Return the sensors of the observation "state", without that of the locomotion."""
        return [*NUMBERS, *PITCH] if options["levels"] == "generated" else NUMBERS

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec. The option `locomotion` changes the device, `observation` the sensors."""
        locomotion = LOCOMOTIONS[options["locomotion"]]
        survivor = behavior(
            "survivor",
            description="the cursor, and the character that it leads; the ground is x-z, so the pointer's y is z",
            sensors=cls.sensors(options),
            axes=locomotion.axes,
            branches=[
                *locomotion.branches,
                button("move", "send the character to the cursor"),
                button("blink", "put the character at the cursor; success ends its walk"),
            ],
            channels=CHANNELS,
            metrics=METRICS,
        )
        return cls.record_spec(
            survivor,
            decision_interval=r.DECISION_TICKS,
            tick_seconds=r.TICK,
            max_episode_decisions=r.CLOCK_TICKS // r.DECISION_TICKS,
            max_arenas=cls.max_arenas(options),
            picture=PICTURE,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        rules = r.ORIGINAL if options["rules"] == "original" else r.CORRECTED
        rules = rules._replace(slow_character=options["slow_character"] == "on")
        generated = options["levels"] == "generated"
        self.world = r.World(rules, pitches.make_pitches(arenas if generated else 1), generated)
        self.first_clock = np.zeros(arenas, np.int64)
        if options["clock"] == "spread":
            shares = np.arange(first_arena, first_arena + arenas) * GOLDEN_RATIO % 1.0
            self.first_clock[:] = np.floor(shares * (r.CLOCK_TICKS // r.DECISION_TICKS)) * r.DECISION_TICKS
        super().__init__(options, parameters, arenas, first_arena, seed)

    def begin(self) -> None:
        """Fill all arenas as at the start of the program, with a first episode each."""
        r.begin(self.arenas, self.streams, self.world)
        self._make_pitches(np.ones(len(self.arenas), bool))
        self.arenas.clock = self.first_clock

    def begin_episodes(self) -> None:
        """Begin a new episode in every arena, and set the clocks to their beginning."""
        self.arenas.clock = self.first_clock
        self._begin_episodes(np.ones(len(self.arenas), bool))

    def _begin_episodes(self, which: Array) -> None:
        r.reserve_draws(self.streams, self.world)
        r.begin_episodes(self.arenas, self.streams, self.world, which)
        self._make_pitches(which)

    def _make_pitches(self, which: Array, *, settle: bool = True) -> None:
        """Make the pitches that the arenas of `which` play on, if they are not the paper's.

        settle: bodies that are not on them are moved there, which may also move others by a rounding error.
        """
        if self.world.generated:
            rows = np.flatnonzero(which)
            pitches.generate(self.fields["number"][rows], rows, self.world.pitches)
            if settle:
                r.settle(self.arenas, self.world, which)
            self.look_at_ground(rows)

    def show_levels(self, numbers: Array) -> None:
        """Go on on the generated pitches of these numbers, one per arena."""
        self.fields["number"] = numbers
        self._make_pitches(np.ones(len(self.arenas), bool))

    def own_field(self, arenas: int) -> Field | None:
        """Return what images show where every arena has a pitch of its own."""
        return picture.field_of(self.world.pitches, arenas) if self.world.generated else None

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `save` returned. Raises ValueError for a state that the game cannot be in."""
        super().restore(state)
        if self.world.generated:
            self.fields["level"] = np.arange(len(self.arenas))
            self._make_pitches(np.ones(len(self.arenas), bool), settle=False)

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision.

        A death begins a new episode in its arena only, and the clock continues; at the clock's end a new episode begins
        in all arenas together unless their clocks are spread.
        """
        (act,) = acts
        arenas = self.arenas
        velocity = self.locomotion.velocity(act, self.fields["heading"]) * r.TOP_SPEED
        move, blink = act.choices[:, -2:].T.copy()
        rewards = np.zeros((len(arenas), len(CHANNELS)))
        r.reserve_draws(self.streams, self.world)

        def decide(arenas: Array, streams: Streams, rewards: Array, ticks: int) -> None:
            r.decide(arenas, streams, self.world, velocity, move, blink, rewards, ticks)

        self.play_ticks(r.DECISION_TICKS, decide, rewards)
        observations = self.observations(arenas)
        terminated = self.fields["dead"].copy()
        truncated = (self.fields["clock"] >= r.CLOCK_TICKS) & ~terminated
        step = StepArrays(observations, rewards.astype(np.float32), terminated, truncated)
        ends = terminated | truncated
        if ends.any():
            step.ended = np.flatnonzero(ends).astype(np.int32)
            step.final_observations = [sensor[ends] for sensor in observations]
            step.metrics = self._metrics()[ends]
            step.parameters = self.played_parameters(step.ended)
            self.draw_parameters(step.ended)
            self._begin_episodes(ends)
            first = self.observations(arenas[ends])
            for values, new in zip(observations, first, strict=True):
                values[ends] = new
        return [step]

    def write_numbers(self, arenas: Array, *values: Array) -> None:
        """Write the values of every sensor of numbers."""
        _observe(arenas, *values[: len(NUMBERS)])
        if self.world.generated:
            _observe_pitch(arenas, self.world.pitches, *values[len(NUMBERS) :])

    def paint(self, arenas: Array, eye: Eye, cursor: bool, images: Array) -> None:
        """Paint what the agents see."""
        picture.paint(arenas, self.world.pitches, eye, cursor, images)

    def _metrics(self) -> Array:
        arenas = self.arenas
        slow_share = arenas.slow_ticks / arenas.tick
        survival = arenas.tick // r.DECISION_TICKS
        return np.stack([survival, arenas.blinks, arenas.clicks, slow_share], axis=1).astype(np.float32)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.beastly_rivals.drawing import draw  # imported here because only pictures need pygame

        return draw(arena, self.world.pitches, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        check_range("level", arenas["level"], 0, 2**31 if self.world.generated else 0)
        check_range("number", arenas["number"], 0, level_sets.SET_SIZE * len(level_sets.SETS) - 1)
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
        slow_sphere[i, 2] = arena.sphere.vx / pitches.SPHERE_SPEED
        slow_sphere[i, 3] = arena.sphere.vz / pitches.SPHERE_SPEED


@compiled
def _observe_pitch(arenas, ground, surroundings, sphere_radius):
    """Write the sensors of generated pitches."""
    for i in range(len(arenas)):
        arena = arenas[i]
        pitches.cast_rays(arena.character.x, arena.character.z, arena.level, ground, surroundings[i])
        sphere_radius[i, 0] = ground.sphere[arena.level, 0] / pitches.SPHERE_RADIUS


@compiled
def _observe_motion(body, place_unit, speed_unit, values):
    """Write position and velocity of a body into `values` [4], in the given units."""
    values[0], values[1] = body.x / place_unit, body.z / place_unit
    values[2], values[3] = body.vx / speed_unit, body.vz / speed_unit
