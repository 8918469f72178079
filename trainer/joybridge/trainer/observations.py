"""The part of a behavior's step that concerns one policy: the sensors it sees and the reward it is paid."""

from collections.abc import Iterable, Sequence

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.contract.spec import element_count
from joybridge.contract.tensors import Array
from joybridge.trainer.config import ConfigError, PolicyConfig
from joybridge.v1 import bridge_pb2 as pb


class Senses:
    """Picks sensors and weighs reward channels."""

    def __init__(self, name: str, behavior: pb.Behavior, config: PolicyConfig) -> None:
        """Choose sensors and weights. Raises ConfigError for a sensor or channel the game does not have."""
        sensors = [sensor.name for sensor in behavior.sensors]
        channels = [channel.name for channel in behavior.channels]
        wanted = sensors if config.sensors is None else config.sensors
        _require_known(f"{name}: sensors", wanted, sensors)
        _require_known(f"{name}: reward_weights", config.reward_weights, channels)
        self.sensors = [sensors.index(sensor) for sensor in wanted]
        self.size = sum(element_count(behavior.sensors[i]) for i in self.sensors)
        weights = {c.name: c.default_weight for c in behavior.channels} | config.reward_weights
        self.weights = np.array([weights[channel] for channel in channels], np.float32)

    def frames(self, observations: Sequence[Array]) -> Array:
        """Return the chosen sensors side by side, float32 [rows, size]."""
        rows = len(observations[0])
        return np.concatenate([observations[i].reshape(rows, -1) for i in self.sensors], axis=1, dtype=np.float32)

    def rewards(self, step: StepArrays) -> Array:
        """Return the weighted sum of the channels, float32 [lanes]."""
        return step.rewards @ self.weights


def _require_known(where: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ConfigError(f"{where}: the game has no {name!r}; it has {', '.join(known)}")
