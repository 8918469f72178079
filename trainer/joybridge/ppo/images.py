"""Which sensors of a policy are images. Needs no torch."""

from collections.abc import Sequence
from typing import NamedTuple

from joybridge.config.errors import ConfigError
from joybridge.contract.limits import element_count
from joybridge.v1 import bridge_pb2 as pb

SMALLEST = {"simple": 1, "nature": 36, "impala": 1}  # pixels of each side that an encoder needs


class Image(NamedTuple):
    """An image within a frame: its numbers are row-major [height, width, channels], from `begin` on."""

    begin: int
    height: int
    width: int
    channels: int

    @property
    def end(self) -> int:
        """Return where the numbers after the image begin."""
        return self.begin + self.height * self.width * self.channels


def find_images(policy: str, encoder: str, sensors: Sequence[pb.Sensor]) -> list[Image]:
    """Return the images in the frames of a policy; none for the encoder "none". Raises ConfigError.

    Sensors of shape [height, width, channels] are images, and those of type uint8 and shape [height, width].
    """
    if encoder == "none":
        return []
    images, begin, smallest = [], 0, SMALLEST[encoder]
    for sensor in sensors:
        if len(sensor.shape) == 3 or (len(sensor.shape) == 2 and sensor.dtype == pb.DTYPE_UINT8):
            height, width, channels = (*sensor.shape, 1)[:3]
            if min(height, width) < smallest:
                raise ConfigError(
                    f"{policy}: image_encoder is {encoder}, which needs {smallest} x {smallest} pixels, but sensor "
                    f"{sensor.name!r} has {height} x {width}; set image_encoder=simple"
                )
            images.append(Image(begin, height, width, channels))
        begin += element_count(sensor)
    if not images:
        shapes = ", ".join(f"{sensor.name} {list(sensor.shape)}" for sensor in sensors)
        raise ConfigError(
            f"{policy}: image_encoder is {encoder}, but no sensor is an image of shape [height, width, channels] "
            f"({shapes}); set image_encoder=none"
        )
    return images
