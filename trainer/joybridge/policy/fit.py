"""Why the saved network of a policy does not fit a game or a configuration, in their own words."""

from collections.abc import Mapping, Sequence

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

OTHER_VERSION = "it is a network of another version of joybridge"
LSTM_GATES = 4  # a GRU has three


def misfits(
    saved: Mapping[str, Array], now: Mapping[str, Array], sensors: Sequence[pb.Sensor], frame_stack: int
) -> list[str]:
    """Return what differs between two networks, given by their parameters; nothing if one fits into the other.

    saved: of a checkpoint. now: of the game and configuration at hand, whose policy sees `frame_stack` frames of
    `sensors`.
    """
    if any(array.ndim != now[name].ndim for name, array in saved.items() if name in now):
        return [OTHER_VERSION]
    differences = []
    before, after = _layers(saved), _layers(now)
    parts = ", ".join(f"{sensor.name} {element_count(sensor)}" for sensor in sensors)
    frames = f"{frame_stack} frames of {parts}" if frame_stack > 1 else parts
    if _shapes(saved, "encoders.0.") != _shapes(now, "encoders.0."):
        differences.append(f"image_encoder, network, frame_stack or an image was another one, now {frames}")
    elif before[:1] != after[:1]:
        unit = "features" if _shapes(now, "encoders.") else "numbers"
        differences.append(f"the sensors had {_numbers(before[:1])} {unit}, now {_numbers(after[:1])} ({frames})")
    if before[1:] != after[1:]:
        differences.append(f"hidden_sizes was {before[1:]}, now {after[1:]}")
    kept = [_memory(network) for network in (saved, now)]
    if kept[0] != kept[1]:
        differences.append(f"memory was {kept[0]}, now {kept[1]}")
    shared = ["critic.head.weight" not in network for network in (saved, now)]
    if shared[0] != shared[1]:
        differences.append(f"shared_body was {str(shared[0]).lower()}, now {str(shared[1]).lower()}")
    common = [not _shapes(network, "encoders.1.") for network in (saved, now)]
    if not differences and common[0] != common[1]:
        differences.append(f"shared_encoder was {str(common[0]).lower()}, now {str(common[1]).lower()}")
    actions = [_actions(network, body) for network, body in zip((saved, now), shared, strict=True)]
    if actions[0] != actions[1]:
        differences.append(
            f"the network had {actions[0]} for actions, now {actions[1]}: the layout or the device differs"
        )
    if not differences and _shapes(saved) != _shapes(now):
        differences.append(OTHER_VERSION)
    return differences


def _shapes(network: Mapping[str, Array], prefix: str = "") -> dict[str, tuple[int, ...]]:
    """Return the shapes of all parameters whose names begin with `prefix`."""
    return {name: array.shape for name, array in network.items() if name.startswith(prefix)}


def _layers(network: Mapping[str, Array]) -> list[int]:
    """Return the inputs of the network and the units of each hidden layer of its actor."""
    weights: list[Array] = []
    while (name := f"actor.hidden.{len(weights)}.weight") in network:
        weights.append(network[name])
    return [*(weight.shape[-1] for weight in weights[:1]), *(len(weight) for weight in weights)]


def _memory(network: Mapping[str, Array]) -> str:
    """Return the kind and the size of the memory of the actor."""
    weight = network.get("actor.memory.layer.weight_hh_l0")
    if weight is None:
        return "none"
    gates, size = len(weight) // weight.shape[1], weight.shape[1]
    return f"{'lstm' if gates == LSTM_GATES else 'gru'} of {size}"


def _numbers(inputs: Sequence[int]) -> str:
    return str(inputs[0]) if inputs else "no"


def _actions(network: Mapping[str, Array], shared: bool) -> str:
    """Return the sizes of the actor's outputs."""
    gaussians = len(network.get("mean_bias", ()))
    logits = len(network.get("actor.head.weight", ())) - gaussians - shared
    return f"{gaussians} Gaussians and {logits} outputs of branches"
