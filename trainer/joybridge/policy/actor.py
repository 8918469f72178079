"""What plays: the observation encoder, the network and the layout of one policy, without anything that learns."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch

from joybridge.config.arrays import select
from joybridge.config.config import Config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.tensors import Array
from joybridge.layouts import Role
from joybridge.policy.config_fit import fitting_roles
from joybridge.policy.encoder import ObservationEncoder
from joybridge.policy.fit import misfits
from joybridge.policy.network_fit import check_network
from joybridge.policy.past_acts import PastActs
from joybridge.policy.scaling import make_scaling
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.fast.acting import decide, write_heads
from joybridge.ppo.fast.kernels import NO_MASKS, Action, Noise
from joybridge.ppo.fast.towers import NetworkShape, shape_of
from joybridge.ppo.initialization import orthogonal, set_log_std
from joybridge.ppo.networks import Heads, MemoryKind, Network, Towers, flatten_parameters
from joybridge.ppo.observation import Observation
from joybridge.ppo.observation_tensors import to_tensors
from joybridge.ppo.own import OwnEncoder
from joybridge.ppo.sampling import sample_actions
from joybridge.ppo.threads import compute_alike
from joybridge.v1 import bridge_pb2 as pb

SCALING = "scaling."  # begins the names of arrays that are not the network's


class Acted(NamedTuple):
    """What an actor does in some lanes."""

    action: Action
    values: Array  # [lanes]: of what it saw
    memory: Array | None = None  # [lanes, state_size]: what it remembers now; None: an actor without memory

    def of_deciding(self, observation: Observation, deciding: Array | None) -> "Acted":
        """Return the same, but lanes that wait remember what they did in `observation`. deciding [lanes]; None: all."""
        if self.memory is None or observation.memory is None or deciding is None:
            return self
        return self._replace(memory=np.where(deciding[:, None], self.memory, observation.memory))


class Actor:
    """One policy: from what its lanes observe to actions of its part of the device."""

    def __init__(
        self, role: Role, behavior: pb.Behavior, config: PolicyConfig, seed: int, accelerator: str = "cpu"
    ) -> None:
        """Make an actor with an untrained network, which `seed` fixes. Raises ConfigError."""
        self.name, self.behavior, self.layout = role.name, role.behavior, role.layout
        self.config, self.seed = config, seed
        self.encoder = ObservationEncoder(
            role.name, behavior, config.sensors, config.reward_weights, config.image_encoder
        )
        self.scaling = make_scaling(role.name, config.scale_observations, self.encoder.numbers)
        self.metrics = [metric.name for metric in behavior.metrics]
        self.branches, self.gaussians = role.layout.names(behavior.device)
        space = role.layout.space
        shared = config.shares_body(space.continuous)
        self.past = PastActs(behavior.device, config.remember_acts)
        self.observation_size = self.past.size + self.encoder.size * config.frame_stack
        self.accelerator = torch.device(accelerator)
        pictures = [*self.encoder.images.values()]
        check_network(role, behavior.device, config, pictures)
        count = 1 if shared or config.shared_encoder else 2
        encoders: list[ImageEncoder | OwnEncoder] = []
        if config.network:
            encoders += [
                OwnEncoder(config.network, self.encoder.numbers, self.encoder.images, config.frame_stack, seed + index)
                for index in range(count)
            ]
        elif pictures:
            encoders += [
                ImageEncoder(
                    config.image_encoder,
                    pictures,
                    self.observation_size,
                    config.frame_stack,
                    config.activation,
                    config.frame_differences,
                )
                for _ in range(count)
            ]
        memory = None if config.memory.kind == "none" else MemoryKind(config.memory.kind, config.memory.size)
        towers = Towers(config.hidden_sizes, shared, config.activation, memory)
        network = Network(self.observation_size, space, towers, seed, encoders)
        if config.ortho_init:
            orthogonal(network, seed)
        if config.log_std_init:
            set_log_std(network, config.log_std_init, self.gaussians)
        self.network = network.to(self.accelerator)

    def see(self, observations: Sequence[Array]) -> Observation:
        """Return one frame as the network gets it: the sensors side by side, scaled, and one picture of each image."""
        frames = self.encoder.frames(observations)
        if self.scaling is not None:
            frames = self.scaling.apply(frames)
        return Observation(frames, self.encoder.pictures(observations))

    def act(
        self, observations: Observation, masks: Array | None, noise: Noise, *, deterministic: bool = False
    ) -> Acted:
        """Return actions, for `layout.write`, and values.

        masks: [lanes, branches, widest], added to the logits; None: all choices are allowed. deterministic: take the
        likeliest actions instead of those that the noise gives.
        """
        if self._compiled is not None and not self.layout.space.distributions:
            allowed = NO_MASKS if masks is None else masks
            return Acted(*decide(*self._compiled, observations.numbers, allowed, noise, deterministic))
        with torch.inference_mode():
            outputs, estimates, memory = self._heads(observations)
            action = sample_actions(self.network, outputs, masks, noise, deterministic=deterministic)
            return Acted(action, estimates.numpy(force=True), None if memory is None else memory.numpy(force=True))

    def values(self, observations: Observation) -> Array:
        """Return the values, float32 [rows], of observations."""
        return self._heads(observations).value.numpy(force=True)

    @torch.inference_mode()
    def _heads(self, observations: Observation) -> Heads:
        """Return what `Network.heads` does."""
        if self._compiled is None:
            return self.network.heads(to_tensors(observations, self.accelerator))
        weights, shape = self._compiled
        rows, columns = len(observations.numbers), len(shape.sums.T) or shape.columns
        outputs, values = np.empty((rows, columns), np.float32), np.empty(rows, np.float32)
        write_heads(weights, shape, observations.numbers, outputs, values)
        return Heads(torch.from_numpy(outputs), torch.from_numpy(values), None)

    @cached_property
    def _compiled(self) -> tuple[Array, NetworkShape] | None:
        """The parameters as compiled functions take them, None where PyTorch computes the network."""
        network = self.network
        if network.encoders or network.state_size or network.shown or self.accelerator.type != "cpu":
            return None
        return flatten_parameters(network).detach().numpy(), shape_of(network)

    def state(self) -> dict[str, Array]:
        """Return copies of the parameters, and of what scales observations, for a checkpoint."""
        state = {name: tensor.numpy(force=True).copy() for name, tensor in self.network.state_dict().items()}
        scaling = {} if self.scaling is None else self.scaling.state()
        return state | {f"{SCALING}{name}": array for name, array in scaling.items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned. Raises CheckpointError where it does not fit."""
        if differences := misfits(state, self.state(), self.encoder.sensors, self.config.frame_stack):
            raise CheckpointError(f"{self.name}: the trained network does not fit: {'; '.join(differences)}")
        network = {name: torch.from_numpy(a.copy()) for name, a in state.items() if not name.startswith(SCALING)}
        self.network.load_state_dict(network)
        if self.scaling is not None:
            self.scaling.load(select(state, SCALING))


def make_actors(config: Config, spec: pb.GameSpec, accelerator: str = "cpu") -> list[Actor]:
    """Return untrained policies for all behaviors of a spec. Raises ConfigError."""
    if accelerator == "cuda" and not torch.cuda.is_available():
        raise ConfigError("accelerator is cuda, but torch finds no such device here; set accelerator=cpu")
    if accelerator == "cuda":
        compute_alike()
    roles = fitting_roles(config, spec)
    children = np.random.SeedSequence(config.seed).spawn(len(roles))
    seeds = [int(child.generate_state(1, np.uint64)[0]) for child in children]
    return [
        Actor(role, spec.behaviors[role.behavior], config.policy_config(role.name), seed, accelerator)
        for role, seed in zip(roles, seeds, strict=True)
    ]


def trained_actors(config: Config, spec: pb.GameSpec, arrays: dict[str, Array]) -> list[Actor]:
    """Return the policies in the arrays of a checkpoint of a run with this configuration.

    Raises ConfigError, and CheckpointError where they do not fit.
    """
    actors = make_actors(config, spec)
    for actor in actors:
        actor.load(policy_state(arrays, actor.name))
    return actors


def policy_state(arrays: dict[str, Array], policy: str) -> dict[str, Array]:
    """Return the parameters of one policy's network from the arrays of a checkpoint."""
    return select(arrays, f"{policy}/policy/network.")
