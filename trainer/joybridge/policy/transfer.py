"""The network of one set of games as that of another: what both see and control keeps its weights, by name.

So a game can join a policy or leave it. What is new among the numbers that a policy sees has no weight at first, so it
plays the games that stay as before; what is new among the parts of the device begins untrained. With `remember_acts`,
it saw the parts that leave, too, so only joining changes nothing.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor


def transferred(before: Actor, now: Actor) -> dict[str, Array]:
    """Return the parameters of a trained actor as those of an untrained one for other games, for `Actor.load`.

    Arrays that cannot be brought into another form stay as they are, and `load` says what does not fit.
    """
    saved, fresh = before.state(), now.state()
    made = dict(saved)
    for name, array in saved.items():
        if name in ("actor.hidden.0.weight", "critic.hidden.0.weight"):
            keys = [_inputs(actor, state[name].shape[1]) for actor, state in ((before, saved), (now, fresh))]
            made[name] = _placed(array.T, np.zeros_like(fresh[name].T), keys[0], keys[1]).T
        elif name == "actor.head.weight":
            made[name] = _placed(array, fresh[name], _outputs(before), _outputs(now))
        elif name == "mean_bias":
            made[name] = _placed(array, fresh[name], _axes(before, "outputs"), _axes(now, "outputs"))
        elif name == "log_variance":
            made[name] = _placed(array, fresh[name], _axes(before, "parameters"), _axes(now, "parameters"))
    return made


def _placed(array: Array, into: Array, before: Sequence[Hashable], now: Sequence[Hashable]) -> Array:
    """Return `into` with the rows of an array at the places of their keys; the array if its rows do not fit."""
    if array.shape[1:] != into.shape[1:] or len(array) != len(before) or len(into) != len(now):  # as in a map
        return array
    rows, places = into.copy(), {key: row for row, key in enumerate(now)}
    for key, row in zip(before, array, strict=True):
        if key in places:
            rows[places[key]] = row
    return rows


def _inputs(actor: Actor, columns: int) -> list[Hashable]:
    """Return a key for each input of the first dense layer: past acts, numbers of each frame, features of images."""
    frame = [
        (sensor.name, sensor.elements[index] if sensor.elements else index)
        for sensor in actor.encoder.numbers
        for index in range(element_count(sensor))
    ]
    keys: list[Hashable] = [*actor.past.keys]
    keys += [(number, *key) for number in range(actor.config.frame_stack) for key in frame]
    return [*keys, *range(columns - len(keys))]


def _outputs(actor: Actor) -> list[Hashable]:
    """Return a key for each row of the actor's head: choices, padded to the widest, axes, perhaps the value."""
    space = actor.layout.space
    choices = [(name, choice) for name in actor.branches for choice in range(space.widest)]
    return [*choices, *_axes(actor, "outputs"), *(["value"] if actor.network.critic is None else [])]


def _axes(actor: Actor, kind: str) -> list[Hashable]:
    """Return a key for each output, or parameter, of the distributions of axes."""
    counts = [getattr(each, kind) for each in actor.network.distributions] or [1] * len(actor.gaussians)
    return [(name, number) for name, count in zip(actor.gaussians, counts, strict=True) for number in range(count)]
