"""The network of one set of games as that of another: what both see and control keeps its weights, by name.

So a game can join a policy or leave it. What is new among the numbers and images that a policy sees has no weight at
first, so it plays the games that stay as before; what is new among the parts of the device begins untrained. Images
that leave were black in the games that stay, and go on to count as if they still were. With `remember_acts`, a policy
saw the parts that leave, too, so only joining changes nothing.

If no game stays, the policy keeps what it sees. What it does is made less sure, and so are values that are rows of the
same head; others begin untrained. For buttons of the same name mean other things there, and one that is hardly ever
pressed would not be tried again.
"""

from collections.abc import Hashable, Sequence

import numpy as np
import torch

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.ppo.convolutions import ImageEncoder

UNSURE = 0.05  # of the weights of choices and means, where no game stays
UNTRAINED = ("critic.head.weight", "mean_bias", "value_bias", "log_variance")  # there


def transferred(before: Actor, now: Actor, *, stays: bool = True) -> dict[str, Array]:
    """Return the parameters of a trained actor as those of an untrained one for other games, for `Actor.load`.

    stays: whether any of the games is one that it was trained in.

    Arrays that cannot be brought into another form stay as they are, and `load` says what does not fit.
    """
    saved, fresh = before.state(), now.state()
    made, own = dict(saved), bool(before.config.network)  # what an own network takes and makes has no names
    if not own:
        made = _with_images(saved, fresh, [*before.encoder.images], [*now.encoder.images])
    for name, array in saved.items():
        if name in ("actor.hidden.0.weight", "critic.hidden.0.weight") and not own:
            tower = ["actor", "critic"].index(name.partition(".")[0])
            keys = [_inputs(actor, tower, state[name].shape[1]) for actor, state in ((before, saved), (now, fresh))]
            made[name] = _placed(array.T, np.zeros_like(fresh[name].T), keys[0], keys[1]).T
            bias = name.replace("weight", "bias")
            made[bias] = saved[bias] + array @ _of_black(before, now, tower, keys[0])
        elif name in UNTRAINED and not stays:
            made[name] = fresh[name]
        elif name == "actor.head.weight":
            sure = 1.0 if stays else UNSURE
            made[name] = sure * _placed(array, fresh[name], _outputs(before), _outputs(now))
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


def _with_images(
    saved: dict[str, Array], fresh: dict[str, Array], before: Sequence[str], now: Sequence[str]
) -> dict[str, Array]:
    """Return saved parameters, with the convolutions of the images `now` instead of `before`; new ones untrained."""
    made: dict[str, Array] = {}
    for name, array in saved.items():
        head, convolutions, tail = name.partition(".convolutions.")
        number, _, rest = tail.partition(".")
        if not convolutions:
            made[name] = array
        elif before[int(number)] in now:
            made[f"{head}{convolutions}{now.index(before[int(number)])}.{rest}"] = array
    return {name: array for name, array in fresh.items() if ".convolutions." in name} | made


def _encoder(actor: Actor, tower: int) -> ImageEncoder | None:
    """Return what encodes images for the actor (0) or the critic (1) of a policy, if it has images."""
    encoders = actor.network.encoders
    encoder = encoders[min(tower, len(encoders) - 1)] if encoders else None
    return encoder if isinstance(encoder, ImageEncoder) else None


@torch.inference_mode()
def _of_black(before: Actor, now: Actor, tower: int, keys: Sequence[Hashable]) -> Array:
    """Return the inputs of a tower's first dense layer: what black images that have left are to it, and zeros."""
    inputs, encoder = np.zeros(len(keys), np.float32), _encoder(before, tower)
    if encoder is not None:
        for name, body in zip(before.encoder.images, encoder.bodies, strict=True):
            if name not in now.encoder.images:
                black = torch.zeros(1, before.config.frame_stack, *body.image.shape, dtype=torch.uint8)
                features, _ = body(black.to(before.accelerator))
                first = keys.index((name, 0))
                inputs[first : first + body.features] = features[0].numpy(force=True)
    return inputs


def _inputs(actor: Actor, tower: int, columns: int) -> list[Hashable]:
    """Return a key for each input of the first dense layer: past acts, numbers of each frame, features of images."""
    frame = [
        (sensor.name, sensor.elements[index] if sensor.elements else index)
        for sensor in actor.encoder.numbers
        for index in range(element_count(sensor))
    ]
    keys: list[Hashable] = [*actor.past.keys]
    keys += [(number, *key) for number in range(actor.config.frame_stack) for key in frame]
    if encoder := _encoder(actor, tower):
        bodies = zip(actor.encoder.images, encoder.bodies, strict=True)
        keys += [(image, feature) for image, body in bodies for feature in range(body.features)]
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
