"""Shooting Birds: its spec, its sensors, and one step of many arenas."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from joybridge.games import level_sets
from joybridge.games.locomotion import LOCOMOTION_OPTION, LOCOMOTIONS
from joybridge.games.pictures import Eye, Field, View
from joybridge.games.pointer_game import PointerGame
from joybridge.games.shooting_birds import camera, foes, generator, nearest, picture
from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.levels import FLIGHTS, LEVELS, OBSTACLES, build_obstacles, placements_of
from joybridge.games.shooting_birds.sensing import NOTHING, OBSTACLE, RAYS, cast_rays, front
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
from joybridge.simulator.randomness import reserve
from joybridge.v1 import bridge_pb2 as pb

REACH_X, REACH_Y = 17.715, 10.215  # position of the crosshair when it rests against a wall: units of its sensor
PICTURE = (640, 400)  # width, height

OPTIONS = [
    option(
        "rules",
        ["original", "corrected"],
        description="original: the paper's game with all its quirks; corrected: a hit pays for the size of the bird "
        "that was hit, the ammo sensor is a ratio, positions are relative to the arena's center",
    ),
    LOCOMOTION_OPTION,
    option(
        "level",
        ["random", *map(str, range(LEVELS))],
        description="the obstacles: a random level in each episode, or always the same",
    ),
    level_sets.LEVELS_OPTION,
    foes.BIRDS_OPTION,
    nearest.OPTION,
    *camera.OPTIONS,
    *SIGHT_OPTIONS,
]

PARAMETERS = [
    parameter("bird_speed", 0.0, 4.0, 1.0, "factor on the speed of new birds"),
    *foes.PARAMETERS,
    *level_sets.PARAMETERS,
]

NUMBERS = [
    sensor("gun", [2], 0.0, 2.0, "the gun", elements=["loaded", "ammo"]),
    sensor(
        "crosshair",
        [5],
        -2.0,
        2.0,
        "position and velocity of the crosshair",
        elements=["x", "y", "direction x", "direction y", "speed"],
    ),
    sensor(
        "rays",
        [RAYS, 3],
        -1.0,
        2.0,
        "twelve rays, 30° apart, counter-clockwise from +x; -1: nothing hit",
        elements=[f"{30 * k}° {what}" for k in range(RAYS) for what in ("bird", "bird's size", "obstacle")],
    ),
    sensor(
        "hovered",
        [1],
        -1.0,
        2.0,
        "what is in front under the crosshair: 1 bird, -1 obstacle, 0 nothing",
        elements=["hovered"],
    ),
]

MORE_NUMBERS = {  # what writes the values of the sensors that options add, by their names
    nearest.SENSOR.name: nearest.write_nearest,
    camera.POSITION.name: camera.write_position,
    camera.HINTS.name: camera.write_hints,
}

CHANNELS = [
    channel("hit", 1.0, "+0.25, +0.75 or +2 for a large, medium or small bird shot"),
    channel("miss", 1.0, "-0.1 for a shot at an obstacle or at nothing"),
    channel("dry_shot", 1.0, "-1 for a shot with an empty gun"),
    channel("reload", 1.0, "minus the fraction of the magazine that is thrown away"),
    channel("aimed_hit", 0.0, "+0.25, +0.75 or +2 for a shot aimed at a bird, by its true size"),
    channel("aimed_miss", 0.0, "-0.1 for a shot aimed at anything else"),
]

METRICS = [
    metric("click_accuracy", "hits / shots; 0 without shots"),
    metric("shots", "shots with ammo"),
    metric("hits", "birds shot"),
    metric("reloads", "reloads, of empty and other magazines"),
]


class ShootingBirds(PointerGame):
    """A crosshair, ten birds, and trees and barns in front of them. One behavior, one agent per arena."""

    name = "shooting_birds"
    description = "Aim a crosshair at birds that fly past trees and barns, shoot, and mind the ammo."
    version = "1"
    options = OPTIONS
    arena_dtype: ClassVar[np.dtype[np.void]] = r.ARENA
    parameters, channels, field = PARAMETERS, CHANNELS, picture.FIELD

    @classmethod
    def numbers(cls, options: Mapping[str, str]) -> list[pb.Sensor]:
        """Return the sensors of the observation "state", without that of the locomotion."""
        moves = options["camera"] != "fixed"
        return [
            *NUMBERS,
            *([nearest.SENSOR] if options["nearest_birds"] == "shown" else []),
            *([camera.POSITION] if moves and options["camera_position"] == "shown" else []),
            *([camera.HINTS] if moves and options["hints"] == "on" else []),
        ]

    @classmethod
    def views(cls, options: Mapping[str, str]) -> dict[str, View]:
        """Return the images that agents observe, by the names of their sensors."""
        seen = super().views(options)
        if options["camera"] == "fixed":
            return seen
        return {name: replace(view, on_camera=not view.centered) for name, view in seen.items()}

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec. The option `locomotion` changes the device, `observation` the sensors."""
        locomotion = LOCOMOTIONS[options["locomotion"]]
        hunter = behavior(
            "hunter",
            description="the crosshair and the gun",
            sensors=cls.sensors(options),
            axes=[*locomotion.axes, *([camera.SCROLL] if options["camera"] == "axis" else [])],
            branches=[
                *locomotion.branches,
                *([camera.GRAB] if options["camera"] == "drag" else []),
                button("shoot", "shoot at what is under the crosshair"),
                button("reload", "fill the magazine, after the shot if both are pressed"),
            ],
            channels=CHANNELS,
            metrics=[*METRICS, *([] if options["camera"] == "fixed" else [camera.METRIC])],
        )
        return cls.record_spec(
            hunter,
            tick_seconds=r.TICK,
            max_episode_decisions=r.EPISODE_TICKS,
            max_arenas=cls.max_arenas(options),
            picture=PICTURE,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        rules = r.ORIGINAL if options["rules"] == "original" else r.CORRECTED
        fixed_level = r.ANY_LEVEL if options["level"] == "random" else int(options["level"])
        device = camera.CAMERAS.index(options["camera"])
        self.screens = 1 if device == camera.FIXED else camera.SCREENS
        obstacles = OBSTACLES if self.screens == 1 else build_obstacles(self.screens, camera.SCREEN_WIDTH)
        self.world = r.World(rules, obstacles, FLIGHTS, foes.HABITS.index(options["birds"]), fixed_level, device)
        self.generated = generator.make_room(arenas, self.screens) if options["levels"] == "generated" else None
        if self.generated:
            self.world = self.world._replace(
                obstacles=self.generated.obstacles, flights=self.generated.flights, fixed_level=r.GENERATED
            )
        super().__init__(options, parameters, arenas, first_arena, seed)

    def begin(self) -> None:
        """Fill all arenas as at the start of the program, with a first episode each."""
        r.begin(self.arenas, self.streams, self.world)
        self._make_levels()
        if self.screens > 1 and not self.generated:
            self.look_at_ground(range(LEVELS))
        if self.generated:
            r.populate(self.arenas, self.streams, self.world)

    def begin_episodes(self) -> None:
        """Begin a new episode in every arena; the birds fly on."""
        reserve(self.streams, self.world.draws)
        r.begin_episodes(self.arenas, self.streams)
        self._make_levels()

    def show_levels(self, numbers: Array) -> None:
        """Go on in the generated levels of these numbers, one per arena."""
        self.fields["number"] = numbers
        self._make_levels()

    def _make_levels(self) -> None:
        """Make the levels that the arenas play, if they are not those of the paper's game."""
        if self.generated:
            generator.generate(self.fields["number"], self.generated)
            self.look_at_ground(range(len(self.arenas)))

    def own_field(self, arenas: int) -> Field | None:
        """Return what images show where every arena has a level of its own, or the field has several screens."""
        if not self.generated and self.screens == 1:
            return None
        beyond = camera.MAX_CAMERA_X if self.screens > 1 else 0.0
        return picture.field_of(self.world.obstacles, arenas if self.generated else LEVELS, beyond)

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `save` returned. Raises ValueError for a state that the game cannot be in."""
        super().restore(state)
        if self.generated:
            self.fields["level"] = np.arange(len(self.arenas))
        self._make_levels()

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one tick. All episodes end together, truncated."""
        (act,) = acts
        arenas = self.arenas
        velocity = self.locomotion.velocity(act, self.fields["heading"]) * r.TOP_SPEED
        shoot, reload = act.choices[:, -2:].T.copy()
        if self.world.camera == camera.AXIS:
            self.fields["scroll"] = act.axes[:, -1]
        elif self.world.camera == camera.DRAG:
            self.fields["scroll"] = act.choices[:, -3]
        rewards = np.zeros((len(arenas), len(CHANNELS)))
        reserve(self.streams, self.world.draws)
        r.tick(arenas, self.streams, self.world, velocity, shoot, reload, rewards)
        observations = self.observations(arenas)
        truncated = self.fields["tick"] >= r.EPISODE_TICKS
        step = StepArrays(observations, rewards.astype(np.float32), np.zeros(len(arenas), bool), truncated)
        if truncated.any():  # then all are: the arenas' episodes have the same tick
            step.ended = np.arange(len(arenas), dtype=np.int32)
            step.final_observations = observations
            step.metrics = self._metrics()
            step.parameters = self.played_parameters(step.ended)
            self.draw_parameters(step.ended)
            r.begin_episodes(arenas, self.streams)
            self._make_levels()
            step.observations = self.observations(arenas)
        return [step]

    def write_numbers(self, arenas: Array, *values: Array) -> None:
        """Write the values of every sensor of numbers."""
        _observe(arenas, self.world, *values[: len(NUMBERS)])
        for described, written in zip(self._numbers[len(NUMBERS) :], values[len(NUMBERS) :], strict=True):
            MORE_NUMBERS[described.name](arenas, self.world, written)

    def paint(self, arenas: Array, eye: Eye, cursor: bool, images: Array) -> None:
        """Paint what the agents see."""
        picture.paint(arenas, self.screens > 1, eye, cursor, images)

    def _metrics(self) -> Array:
        shots, hits, reloads = self.arenas.shots, self.arenas.hits, self.arenas.reloads
        values = [hits / np.maximum(shots, 1), shots, hits, reloads]
        if self.screens > 1:
            values.append(self.arenas.empty / self.arenas.tick)
        return np.stack(values, axis=1).astype(np.float32)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.shooting_birds.drawing import (  # imported here because only pictures need pygame
            Scene,
            draw,
        )

        level = int(arena.level)
        placements = placements_of(level, self.screens, camera.SCREEN_WIDTH)
        if self.generated:
            placements = self.generated.placed(level)
        return draw(arena, self.world.obstacles, Scene(placements, self.screens), *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        check_range("level", arenas["level"], 0, 2**31 if self.generated else LEVELS - 1)
        check_range("number", arenas["number"], 0, level_sets.SET_SIZE * len(level_sets.SETS) - 1)
        check_range("wait of a bird", arenas["birds"]["wait"], 0, 10**6)
        check_range("ammo", arenas["ammo"], 0, r.MAGAZINE)
        check_range("tick", arenas["tick"], 0, r.EPISODE_TICKS - 1)
        if (arenas["tick"] != arenas["tick"][0]).any():
            raise ValueError("tick differs between arenas, but all episodes begin and end together")
        check_range("fixed level", arenas["fixed_level"], self.world.fixed_level, self.world.fixed_level)
        check_range("bird size", arenas["birds"]["kind"], 0, 2)
        check_range("habit of a bird", arenas["birds"]["habit"], 0, foes.BLINKING)
        check_range("timer of a bird", arenas["birds"]["timer"], -foes.DASH_TICKS, 10**6)
        farthest = camera.MAX_CAMERA_X if self.screens > 1 else 0.0
        check_range("camera", arenas["camera"], -farthest, farthest)
        check_range("scroll", arenas["scroll"], -1.0, 1.0)
        check_range("ticks without a bird in view", arenas["empty"], 0, r.EPISODE_TICKS)
        for field in ("x", "y", "vx", "vy", "heading"):
            check_range(field, arenas[field], -1e6, 1e6)
        for field in ("x", "y", "z", "vx", "vy", "phase", "speed", "bound", "aim_x", "aim_y"):
            check_range(f"bird {field}", arenas["birds"][field], -1e6, 1e6)


@compiled
def _observe(arenas, world, gun, crosshair, rays, hovered):
    """Write the sensors of every arena."""
    rules, obstacles = world.rules, world.obstacles
    for i in range(len(arenas)):
        arena = arenas[i]
        gun[i, 0] = 1.0 if arena.ammo > 0 else 0.0
        gun[i, 1] = arena.ammo // r.MAGAZINE if rules.whole_magazines else arena.ammo / r.MAGAZINE
        speed = np.sqrt(arena.vx * arena.vx + arena.vy * arena.vy)
        moving = speed > 1e-5
        crosshair[i, 0] = (arena.x - arena.camera - rules.origin_x) / REACH_X
        crosshair[i, 1] = arena.y / REACH_Y
        crosshair[i, 2] = arena.vx / speed if moving else 0.0
        crosshair[i, 3] = arena.vy / speed if moving else 0.0
        crosshair[i, 4] = speed / r.TOP_SPEED
        cast_rays(arena, obstacles, rays[i])
        if world.camera != camera.FIXED:
            camera.end_rays_at_border(arena, rays[i])
        target = front(arena, obstacles)
        hovered[i, 0] = -1.0 if target == OBSTACLE else (0.0 if target == NOTHING else 1.0)
