"""Which sensors of a policy are images, and their shapes. Needs no torch."""

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from joybridge.config.errors import ConfigError
from joybridge.layouts import Map
from joybridge.v1 import bridge_pb2 as pb

# Of each side, that an encoder needs.
MIN_PIXELS = {"windows": 16, "moments": 16, "simple": 1, "nature": 36, "impala": 1}


class Image(NamedTuple):
    """One picture: uint8 [height, width, channels]."""

    height: int
    width: int
    channels: int
    centered: bool = False  # whether its middle is always where the agent's pointer is

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the shape of its array."""
        return self[:3]


def find_images(policy: str, encoder: str, sensors: Sequence[pb.Sensor]) -> dict[str, Image]:
    """Return the images among the sensors of a policy by name. Raises ConfigError.

    With the encoder "auto", they are those that the spec calls images. With "none", there are none: pixels are plain
    numbers. Other encoders take all sensors of type uint8 and of shape [height, width, channels] or [height, width].
    """
    if encoder == "none":
        return {}
    chosen = [s for s in sensors if (s.HasField("image") if encoder == "auto" else _is_picture(s))]
    images = {sensor.name: _image(sensor) for sensor in chosen}
    for name, image in images.items():
        kind = encoder_kind(encoder, image)
        if min(image.height, image.width) < MIN_PIXELS[kind]:
            raise ConfigError(
                f"{policy}: image_encoder is {encoder}, which needs {MIN_PIXELS[kind]} x {MIN_PIXELS[kind]} pixels, "
                f"but sensor {name!r} has {image.height} x {image.width}; set image_encoder=simple"
            )
    if not images and encoder != "auto":
        shapes = ", ".join(f"{sensor.name} {list(sensor.shape)}" for sensor in sensors)
        raise ConfigError(
            f"{policy}: image_encoder is {encoder}, but no sensor is an image of type uint8 and shape [height, width, "
            f"channels] ({shapes}); set image_encoder=auto"
        )
    return images


def check_maps(policy: str, maps: Iterable[Map], images: Collection[Image]) -> None:
    """Raise ConfigError unless there is an image for each map of a policy's layout: see `shows`."""
    for each in maps:
        if any(shows(image, each) for image in images):
            continue
        kind = "centered on the pointer" if each.relative else "that shows the whole field"
        if not images:
            found, instead = "it sees no image", "joint-N, which makes one choice for two axes from numbers"
        elif each.relative:
            found, instead = "none of its images is", "map-WxH if the axes are positions"
        else:
            found, instead = "its images are centered on the pointer", "map-WxH-relative if the axes move the pointer"
        raise ConfigError(f"{policy}: the layout is a map in an image {kind}, but {found}; take {instead}")


def check_differences(policy: str, network: str | None, frame_stack: int, images: Collection[Image]) -> None:
    """Raise ConfigError unless convolutions of ours see stacks of images, between which there are differences."""
    why = ""
    if network:
        why = f"{network} sees the pictures as they are"
    elif not images:
        why = "there are no images; leave it out"
    elif frame_stack == 1:
        why = "frame_stack is 1; set it to 2 or more"
    if why:
        raise ConfigError(f"{policy}: frame_differences: {why}")


def shows(image: Image, each: Map) -> bool:
    """Return whether the cells of a map are places in an image."""
    return image.centered == each.relative


def encoder_kind(encoder: str, image: Image) -> str:
    """Return which convolutions an image gets: by default overlapping windows, or simple ones if it is small."""
    if encoder != "auto":
        return encoder
    return "windows" if min(image.height, image.width) >= MIN_PIXELS["windows"] else "simple"


def _image(sensor: pb.Sensor) -> Image:
    height, width, channels = (*sensor.shape, 1)[:3]
    return Image(height, width, channels, sensor.image.centered)


def _is_picture(sensor: pb.Sensor) -> bool:
    return sensor.dtype == pb.DTYPE_UINT8 and len(sensor.shape) in (2, 3)
