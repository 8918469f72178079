"""Shooting Birds as the service runs it: its spec, and the step of many arenas."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.levels import LEVELS, OBSTACLES
from joybridge.games.shooting_birds.sensing import NOTHING, OBSTACLE, RAYS, cast_rays, front
from joybridge.simulator import BatchedGame, button, check_range, pointer, quiet_step
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, open_streams, reserve, restore_streams, save_streams
from joybridge.v1 import bridge_pb2 as pb

REACH_X, REACH_Y = 17.715, 10.215  # where the crosshair rests against a wall: the position sensor's units
PICTURE_WIDTH, PICTURE_HEIGHT = 640, 400

OPTIONS = [
    pb.Option(
        name="rules",
        description="original: the paper's game with every quirk; corrected: a hit pays by the size of the bird "
        "that was hit, the ammo sensor is a ratio, positions count from the arena's center",
        choices=["original", "corrected"],
        default_choice="original",
    ),
    pointer.OPTION,
    pb.Option(
        name="level",
        description="the obstacles: a random level each episode, or always the same",
        choices=["random", *map(str, range(LEVELS))],
        default_choice="random",
    ),
]

PARAMETERS = [
    pb.Parameter(
        name="bird_speed", description="factor on the speed of new birds", low=0.0, high=4.0, default_value=1.0
    )
]


def _sensor(name: str, description: str, shape: list[int], elements: list[str], low: float) -> pb.Sensor:
    return pb.Sensor(
        name=name,
        description=description,
        dtype=pb.DTYPE_FLOAT32,
        shape=shape,
        elements=elements,
        low=[low],
        high=[2.0],
    )


SENSORS = [
    _sensor("gun", "the gun", [2], ["loaded", "ammo"], 0.0),
    _sensor(
        "crosshair", "the crosshair's own motion", [5],
        ["x", "y", "direction x", "direction y", "speed"], -2.0,
    ),
    _sensor(
        "rays", "twelve rays, 30° apart, counter-clockwise from +x; -1: nothing met", [RAYS, 3],
        [f"{30 * k}° {what}" for k in range(RAYS) for what in ("bird", "bird's size", "obstacle")], -1.0,
    ),
    _sensor("hovered", "what is in front under the crosshair: 1 bird, -1 obstacle, 0 nothing", [1], ["hovered"], -1.0),
]  # fmt: skip

CHANNELS = [
    pb.RewardChannel(
        name="hit", description="+0.25, +0.75 or +2 for a large, medium or small bird shot", default_weight=1
    ),
    pb.RewardChannel(name="miss", description="-0.1 for a shot at an obstacle or at nothing", default_weight=1),
    pb.RewardChannel(name="dry_shot", description="-1 for a shot of an empty gun", default_weight=1),
    pb.RewardChannel(name="reload", description="minus the share of the magazine thrown away", default_weight=1),
    pb.RewardChannel(
        name="aimed_hit",
        description="+0.25, +0.75 or +2 for a shot aimed at a bird, by its true size",
        default_weight=0,
    ),
    pb.RewardChannel(name="aimed_miss", description="-0.1 for a shot aimed at anything else", default_weight=0),
]

METRICS = [
    pb.Metric(name="click_accuracy", description="hits / shots; 0 without shots"),
    pb.Metric(name="shots", description="shots with ammo"),
    pb.Metric(name="hits", description="birds shot"),
    pb.Metric(name="reloads", description="reloads, of empty and other magazines"),
]


class ShootingBirds(BatchedGame):
    """A crosshair, ten birds, and trees and barns in the way. One behavior, one agent per arena."""

    name: ClassVar[str] = "shooting_birds"
    options: ClassVar[list[pb.Option]] = OPTIONS
    description: ClassVar[str] = "Aim a crosshair at birds that fly past trees and barns, shoot, and mind the ammo."

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec; `locomotion` changes the device, and `steer` adds a sensor."""
        locomotion = pointer.LOCOMOTIONS[options["locomotion"]]
        hunter = pb.Behavior(
            name="hunter",
            description="the crosshair and the gun",
            agents_per_arena=1,
            sensors=SENSORS + ([pointer.HEADING_SENSOR] if options["locomotion"] == "steer" else []),
            device=pb.Device(
                axes=locomotion.axes,
                branches=[
                    *locomotion.branches,
                    button("shoot", "shoot at what is under the crosshair"),
                    button("reload", "fill the magazine, after the shot if both are pressed"),
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
            behaviors=[hunter],
            decision_interval=1,
            tick_seconds=r.TICK,
            max_episode_decisions=r.EPISODE_TICKS,
            max_arenas=4096,
            picture=pb.PictureSize(width=PICTURE_WIDTH, height=PICTURE_HEIGHT),
            snapshot_bytes_per_arena=r.ARENA.itemsize + 64,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.rules = r.ORIGINAL if options["rules"] == "original" else r.CORRECTED
        self.steers = options["locomotion"] == "steer"
        self.locomotion = pointer.LOCOMOTIONS[options["locomotion"]]
        self.fixed_level = -1 if options["level"] == "random" else int(options["level"])
        self.first_arena = first_arena
        self.arenas = np.zeros(arenas, r.ARENA).view(np.recarray)
        self.fields = self.arenas.view(np.ndarray)  # the same memory: looking up a recarray's attributes is slow
        self.streams: Streams
        self._begin(seed, parameters)

    def _begin(self, seed: int, parameters: Mapping[str, float]) -> None:
        self._set(parameters)
        self.streams = open_streams(seed, self.first_arena, len(self.arenas))
        r.begin(self.arenas, self.streams, self.rules, self.fixed_level)

    def _set(self, parameters: Mapping[str, float]) -> None:
        if "bird_speed" in parameters:
            self.rules = self.rules._replace(bird_speed=parameters["bird_speed"])

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin new episodes everywhere; see BatchedGame."""
        if seed is not None:
            self._begin(seed, parameters)
            return
        self._set(parameters)
        reserve(self.streams, r.MOST_DRAWS)
        r.begin_episodes(self.arenas, self.streams)

    def observe(self) -> list[StepArrays]:
        """Return the present observations, with zero rewards and no ends."""
        return [quiet_step(self._observations(), len(CHANNELS))]

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one tick; all episodes end together, truncated."""
        (act,) = acts
        arenas = self.arenas
        velocity = self.locomotion.velocity(act, self.fields["heading"]) * r.TOP_SPEED
        shoot, reload = np.ascontiguousarray(act.choices[:, -2:].T)
        rewards = np.zeros((len(arenas), len(CHANNELS)))
        reserve(self.streams, r.MOST_DRAWS)
        r.tick(arenas, self.streams, self.rules, OBSTACLES, velocity, shoot, reload, rewards)
        observations = self._observations()
        truncated = self.fields["tick"] >= r.EPISODE_TICKS
        step = StepArrays(observations, rewards.astype(np.float32), np.zeros(len(arenas), bool), truncated)
        if truncated.any():  # then all of them: arenas share one clock
            step.ended = np.arange(len(arenas), dtype=np.int32)
            step.final_observations = observations
            step.metrics = self._metrics()
            r.begin_episodes(arenas, self.streams)
            step.observations = self._observations()
        return [step]

    def _observations(self) -> list[Array]:
        arenas = self.arenas
        gun = np.empty((len(arenas), 2), np.float32)
        crosshair = np.empty((len(arenas), 5), np.float32)
        rays = np.empty((len(arenas), RAYS, 3), np.float32)
        hovered = np.empty((len(arenas), 1), np.float32)
        _observe(arenas, self.rules, OBSTACLES, gun, crosshair, rays, hovered)
        sensors = [gun, crosshair, rays, hovered]
        return [*sensors, pointer.observe_heading(self.fields["heading"])] if self.steers else sensors

    def _metrics(self) -> Array:
        shots, hits, reloads = self.arenas.shots, self.arenas.hits, self.arenas.reloads
        return np.stack([hits / np.maximum(shots, 1), shots, hits, reloads], axis=1).astype(np.float32)

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena."""
        from joybridge.games.shooting_birds.drawing import draw  # pygame stays off the stepping path

        return draw(self.arenas[arena], PICTURE_WIDTH, PICTURE_HEIGHT)

    def save(self) -> dict[str, Array]:
        """Return arenas and random streams."""
        return {
            "arenas": np.frombuffer(self.arenas.tobytes(), np.uint8).reshape(len(self.arenas), -1),
            **save_streams(self.streams),
            "bird_speed": np.array([self.rules.bird_speed]),
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take back what `save` returned. Raises ValueError for a state that no game can be in."""
        arenas = np.frombuffer(state["arenas"].tobytes(), r.ARENA)
        check_range("level", arenas["level"], 0, LEVELS - 1)
        check_range("ammo", arenas["ammo"], 0, r.MAGAZINE)
        check_range("tick", arenas["tick"], 0, r.EPISODE_TICKS - 1)
        if (arenas["tick"] != arenas["tick"][0]).any():
            raise ValueError("arenas are in different ticks of their episodes, which they share")
        check_range("fixed level", arenas["fixed_level"], self.fixed_level, self.fixed_level)
        check_range("bird size", arenas["birds"]["kind"], 0, 2)
        for field in ("x", "y", "vx", "vy", "heading"):
            check_range(field, arenas[field], -1e6, 1e6)
        for field in ("x", "y", "z", "vx", "vy", "phase"):
            check_range(f"bird {field}", arenas["birds"][field], -1e6, 1e6)
        check_range("bird_speed", state["bird_speed"], 0.0, 4.0)
        restore_streams(self.streams, state)
        self.arenas[:] = arenas
        self._set({"bird_speed": float(state["bird_speed"][0])})


@compiled
def _observe(arenas, rules, obstacles, gun, crosshair, rays, hovered):
    """Write the sensors of every arena."""
    for i in range(len(arenas)):
        arena = arenas[i]
        gun[i, 0] = 1.0 if arena.ammo > 0 else 0.0
        gun[i, 1] = arena.ammo // r.MAGAZINE if rules.whole_magazines else arena.ammo / r.MAGAZINE
        speed = np.sqrt(arena.vx * arena.vx + arena.vy * arena.vy)
        moving = speed > 1e-5
        crosshair[i, 0] = (arena.x - rules.origin_x) / REACH_X
        crosshair[i, 1] = arena.y / REACH_Y
        crosshair[i, 2] = arena.vx / speed if moving else 0.0
        crosshair[i, 3] = arena.vy / speed if moving else 0.0
        crosshair[i, 4] = speed / r.TOP_SPEED
        cast_rays(arena, obstacles, rays[i])
        target = front(arena, obstacles)
        hovered[i, 0] = -1.0 if target == OBSTACLE else (0.0 if target == NOTHING else 1.0)
