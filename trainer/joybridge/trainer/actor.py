"""What plays: the observation encoder, the network and the layout of one policy, without anything that learns."""

import numpy as np
import torch

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.trainer.config import Config, PolicyConfig
from joybridge.trainer.errors import CheckpointError, ConfigError
from joybridge.trainer.layouts import LayoutError, Role, list_roles
from joybridge.trainer.observations import ObservationEncoder
from joybridge.trainer.ppo.fast.kernels import Action, Head, Noise, sample
from joybridge.trainer.ppo.networks import Network
from joybridge.v1 import bridge_pb2 as pb


class Actor:
    """One policy: from the step of its behavior to actions of its part of the device."""

    def __init__(
        self, role: Role, behavior: pb.Behavior, config: PolicyConfig, seed: int, accelerator: str = "cpu"
    ) -> None:
        """Make an untrained policy. `seed` fixes the network. Raises ConfigError."""
        self.name, self.behavior, self.layout = role.name, role.behavior, role.layout
        self.config, self.seed = config, seed
        self.encoder = ObservationEncoder(role.name, behavior, config.sensors, config.reward_weights)
        self.metrics = [metric.name for metric in behavior.metrics]
        self.branches, self.axes = role.layout.names(behavior.device)
        space = role.layout.space
        shared = config.shared_body if config.shared_body is not None else space.continuous == 0
        observation = self.encoder.size * config.frame_stack
        self.accelerator = torch.device(accelerator)
        self.network = Network(observation, space, config.hidden_sizes, shared, seed).to(self.accelerator)
        self._sizes = np.array(space.branches, np.int64)

    def allowed(self, step: StepArrays) -> list[Array] | None:
        """Return which choices each branch of the policy allows, bool [lanes, choices]; None: all."""
        return None if step.masks is None else self.layout.masks(step.masks)

    @torch.inference_mode()
    def sample(
        self, observations: Array, masks: Array | None, noise: Noise, action: Action, *, deterministic: bool = False
    ) -> Array:
        """Sample an action per lane into `action`; return the values of the observations, [lanes].

        masks: what to add to the logits, [lanes, branches, widest]. deterministic: the likeliest action instead.
        """
        network = self.network
        outputs, values = network.heads(self._tensor(observations))
        head = Head(to_array(network.mean_bias), to_array(network.log_variance), self._sizes)
        sample(to_array(outputs), head, masks, noise, deterministic, action)
        return to_array(values)

    @torch.inference_mode()
    def values(self, observations: Array) -> Array:
        """Return the values of observations, [rows]."""
        return to_array(self.network.value(self._tensor(observations)))

    def _tensor(self, array: Array) -> torch.Tensor:
        return torch.from_numpy(array).to(self.accelerator)

    def state(self) -> dict[str, Array]:
        """Return copies of the parameters for a checkpoint."""
        return {name: to_array(tensor).copy() for name, tensor in self.network.state_dict().items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned. Raises CheckpointError where it does not fit."""
        try:
            self.network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in state.items()})
        except RuntimeError as error:
            text = f"{self.name}: the checkpoint's network does not fit this game, layout or version: {error}"
            raise CheckpointError(text) from error


def make_actors(config: Config, spec: pb.GameSpec, accelerator: str = "cpu") -> list[Actor]:
    """Return untrained policies for all behaviors of a spec. Raises ConfigError."""
    if accelerator == "cuda" and not torch.cuda.is_available():
        raise ConfigError("accelerator is cuda, but torch finds no such device here; set accelerator=cpu")
    try:
        roles = list_roles(config.layout, spec)
    except LayoutError as error:
        raise ConfigError(f"layout: {error}") from error
    names = [role.name for role in roles]
    for name in config.policies:
        if name not in names:
            raise ConfigError(f"policies: there is no policy {name!r}; this game and layout have {', '.join(names)}")
    children = np.random.SeedSequence(config.seed).spawn(len(roles))
    seeds = [int(child.generate_state(1, np.uint64)[0]) for child in children]
    return [
        Actor(role, spec.behaviors[role.behavior], config.policy_config(role.name), seed, accelerator)
        for role, seed in zip(roles, seeds, strict=True)
    ]


def to_array(tensor: torch.Tensor) -> Array:
    """Return the numbers of a tensor: the same memory where it lives on the processor, else a copy."""
    return tensor.detach().cpu().numpy()
