"""Parts of a user's own: a network before the towers, and a term of the loss. Differentiated by autograd."""

from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, TypeAlias

import torch
from torch import Tensor, nn

from joybridge.config.errors import ConfigError
from joybridge.config.own_names import load_own
from joybridge.contract.limits import element_count
from joybridge.ppo.convolutions import Encoded
from joybridge.ppo.images import Image
from joybridge.ppo.observation_tensors import Observations
from joybridge.v1 import bridge_pb2 as pb

# Adds to the loss of a minibatch. Arguments: the outputs of the network (`Outputs`), the joint log-probabilities of the
# actions [n], and the minibatch (`Batch`). Returns a number.
Term: TypeAlias = Callable[[Any, Tensor, Any], Tensor]


def load_term(name: str) -> Term:
    """Return a term of the loss, which raises ConfigError if it returns no finite number. Raises ConfigError."""
    term = load_own("loss", name)
    if not isinstance(term, FunctionType):
        raise ConfigError(
            f"loss: {name!r} is {type(term).__name__}, expected a function of outputs, log_probs and batch"
        )

    def checked(outputs: Any, log_probs: Tensor, batch: Any) -> Tensor:
        added = term(outputs, log_probs, batch)
        if not isinstance(added, Tensor) or added.numel() != 1:
            came = f"a tensor of {list(added.shape)}" if isinstance(added, Tensor) else type(added).__name__
            raise ConfigError(f"loss: {name} returned {came}, expected a tensor of one number, such as a mean")
        if not added.isfinite() and log_probs.isfinite().all():  # otherwise the network itself is no longer finite
            shapes = {each: list(getattr(outputs, each).shape) for each in ("logits", "mean", "value")}
            raise ConfigError(
                f"loss: {name} returned {added.item():g}, expected a finite number; the shapes of its outputs are "
                f"{shapes}: a layout has no means without Gaussians, and no logits without choices"
            )
        return added.reshape(())

    return checked


class OwnEncoder(nn.Module):
    """A module that turns named sensors into features, in place of the encoders of images.

    It is made with the shapes of its inputs, {sensor: (frame_stack, *shape)}, and called with tensors
    {sensor: [n, frame_stack, *shape]}: float32, scaled as the configuration says, and uint8 for images. It returns
    [n, features].
    """

    def __init__(
        self, name: str, numbers: Sequence[pb.Sensor], images: dict[str, Image], frame_stack: int, seed: int
    ) -> None:
        """Make the module "module:Class" with random numbers from `seed`. Raises ConfigError."""
        super().__init__()
        self.frame_stack = frame_stack
        self.sensors = {sensor.name: tuple(sensor.shape) for sensor in numbers}
        self.sizes = [element_count(sensor) for sensor in numbers]
        self.images = [*images]
        shapes = self.sensors | {name: image.shape for name, image in images.items()}
        stacked = {name: (frame_stack, *shape) for name, shape in shapes.items()}
        made = load_own("network", name)
        if not (isinstance(made, type) and issubclass(made, nn.Module)):
            raise ConfigError(f"network: {name!r} is no subclass of torch.nn.Module")
        empty = {
            name: torch.zeros(2, *shape, dtype=torch.uint8 if name in images else torch.float32)
            for name, shape in stacked.items()
        }
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            try:
                self.module = made(stacked).eval()  # a draw by the module would be no part of a checkpoint
                with torch.no_grad():
                    features = self.module(empty)
            except Exception as error:
                raise ConfigError(
                    f"network: {name} does not work with {stacked}: {type(error).__name__}: {error}"
                ) from error
        if not isinstance(features, Tensor) or features.dim() != 2 or len(features) != 2:
            shape = list(features.shape) if isinstance(features, Tensor) else type(features).__name__
            raise ConfigError(f"network: {name} returns {shape} for two rows, expected [2, features]")
        if other := [key for key, each in self.module.named_parameters() if each.dtype != torch.float32]:
            raise ConfigError(f"network: {name} has {other[0]} in another type than float32")
        self.features = features.shape[1]

    def forward(self, observations: Observations) -> Encoded:
        """Return features [n, features], and no maps."""
        n = len(observations.numbers)
        frames = observations.numbers.view(n, self.frame_stack, sum(self.sizes))
        parts = torch.split(frames, self.sizes, dim=2)
        named = {
            name: part.reshape(n, self.frame_stack, *shape)
            for (name, shape), part in zip(self.sensors.items(), parts, strict=True)
        }
        return Encoded(self.module(named | dict(zip(self.images, observations.images, strict=True))), [])
