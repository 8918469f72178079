"""One observation for several games: pictures of one size, numbers padded to one length, and perhaps which game it is.

    an image's name   pictures of all games that have an image of this name, in the middle of the largest of them,
                      gray if any of them is gray; black in games that lack it
    numbers           all other sensors of a game side by side, scaled from their bounds to -1..1, then zeros
    known             which of these numbers the game has; left out if all games have equally many
    game              1 at the game that is played, 0 at the others; only if it is told

How many numbers there are tells which game it is where no two games have equally many.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from joybridge.config.errors import ConfigError
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.policy.scaling import is_bounded, scaling_by_bounds
from joybridge.v1 import bridge_pb2 as pb

LUMINANCE = np.array([77, 150, 29])  # of red, green and blue, in 256ths, as built-in games have it
TAKEN = ("numbers", "known", "game")  # names of common sensors


class View:
    """How the sensors of one game become the common sensors."""

    def __init__(self, sensors: Sequence[pb.Sensor], chosen: Sequence[int], common: Sequence[pb.Sensor], number: int):
        """Take the sensors of a game, which of them count, and the common ones. number: of the game."""
        self._common, self._number = common, number
        names = {sensors[index].name: index for index in chosen if sensors[index].HasField("image")}
        self._images = [names.get(sensor.name) for sensor in common]
        self._numbers = [index for index in chosen if not sensors[index].HasField("image")]
        self._count = sum(element_count(sensors[index]) for index in self._numbers)
        self._scaling = scaling_by_bounds([sensors[index] for index in self._numbers])

    def see(self, observations: Sequence[Array]) -> list[Array]:
        """Return the common sensors, [rows, *shape] each, from those of the game."""
        rows = len(observations[0])
        return [
            self._see(sensor, None if image is None else observations[image], observations, rows)
            for sensor, image in zip(self._common, self._images, strict=True)
        ]

    def _see(self, sensor: pb.Sensor, pictures: Array | None, observations: Sequence[Array], rows: int) -> Array:
        if sensor.HasField("image"):
            seen = np.zeros((rows, *sensor.shape), np.uint8)
            if pictures is not None:
                _put(pictures, seen)
            return seen
        if sensor.name == "known":
            known = np.zeros((rows, *sensor.shape), bool)
            known[:, : self._count] = True
            return known
        seen = np.zeros((rows, *sensor.shape), np.float32)
        if sensor.name == "game":
            seen[:, self._number] = 1.0
        elif self._count:
            parts = [observations[index].reshape(rows, -1) for index in self._numbers]
            numbers = np.concatenate(parts, axis=1, dtype=np.float32)
            seen[:, : self._count] = numbers if self._scaling is None else self._scaling.apply(numbers)
        return seen


def common_sensors(
    games: Mapping[str, Sequence[pb.Sensor]], chosen: Mapping[str, Sequence[str] | None], *, tell_game: bool
) -> tuple[list[pb.Sensor], dict[str, View]]:
    """Return the common sensors of games, given by name, and how each game's become them.

    chosen: the names of the sensors that count; None: all. Raises ConfigError.
    """
    counted = {game: _count(game, sensors, chosen[game]) for game, sensors in games.items()}
    images: dict[str, list[pb.Sensor]] = {}
    sizes = {}
    for game, sensors in games.items():
        sizes[game] = 0
        for index in counted[game]:
            sensor = sensors[index]
            if sensor.HasField("image"):
                images.setdefault(sensor.name, []).append(sensor)
            else:
                sizes[game] += element_count(sensor)
    if taken := images.keys() & set(TAKEN):
        raise ConfigError(f"games: an image is called {min(taken)!r}, as a common sensor; choose other sensors")
    common = [_common_image(name, alike) for name, alike in images.items()]
    most = max(sizes.values())
    if most:
        bounded = all(
            is_bounded(sensors[index])
            for game, sensors in games.items()
            for index in counted[game]
            if not sensors[index].HasField("image")
        )
        low, high = ([-1.0], [1.0]) if bounded else ([], [])
        common.append(pb.Sensor(name="numbers", dtype=pb.DTYPE_FLOAT32, shape=[most], low=low, high=high))
        if len({*sizes.values()}) > 1:
            common.append(pb.Sensor(name="known", dtype=pb.DTYPE_BOOL, shape=[most], low=[0.0], high=[1.0]))
    if tell_game:
        told = pb.Sensor(name="game", dtype=pb.DTYPE_FLOAT32, shape=[len(games)], low=[0.0], high=[1.0], elements=games)
        common.append(told)
    views = {game: View(sensors, counted[game], common, number) for number, (game, sensors) in enumerate(games.items())}
    return common, views


def _count(game: str, sensors: Sequence[pb.Sensor], chosen: Sequence[str] | None) -> list[int]:
    """Return the indices of the sensors of a game that count. Raises ConfigError."""
    names = [sensor.name for sensor in sensors]
    for name in chosen or ():
        if name not in names:
            raise ConfigError(f"games.{game}.sensors: the game has no {name!r}; it has {', '.join(names)}")
    return [index for index, name in enumerate(names) if chosen is None or name in chosen]


def _common_image(name: str, alike: Sequence[pb.Sensor]) -> pb.Sensor:
    """Return the image that has room for all of these."""
    height, width = (max(sensor.shape[side] for sensor in alike) for side in (0, 1))
    color = pb.COLOR_RGB if all(one.image.color == pb.COLOR_RGB for one in alike) else pb.COLOR_GRAY
    form = pb.Image(color=color, centered=all(one.image.centered for one in alike))
    shape = [height, width, 3 if color == pb.COLOR_RGB else 1]
    return pb.Sensor(name=name, dtype=pb.DTYPE_UINT8, shape=shape, low=[0.0], high=[255.0], image=form)


def _put(pictures: Array, seen: Array) -> None:
    """Write pictures [rows, height, width(, channels)] into the middle of larger ones, [rows, H, W, channels]."""
    pictures = pictures.reshape(*pictures.shape[:3], -1)
    if pictures.shape[3] == 3 and seen.shape[3] == 1:
        pictures = (pictures @ LUMINANCE >> 8)[..., None]
    top, left = ((seen.shape[side] - pictures.shape[side]) // 2 for side in (1, 2))
    seen[:, top : top + pictures.shape[1], left : left + pictures.shape[2]] = pictures
