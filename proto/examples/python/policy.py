"""Play a policy that `joybridge export RUN policy.json` wrote. Copy this file into your program; it needs NumPy alone.

    policy = Policy("policy.json")
    state, random = policy.begin(lanes=1), np.random.default_rng()
    axes, choices, state = policy.act({"target": target, "bow": bow}, state, random, masks={"draw": allowed})

All arrays have a row per lane, which is one agent of the behavior. Decide only for agents that the game lets decide; if
an agent waits with the first observation of an episode, call `watch` with it. Where an episode begins, set the row of
the state to 0.
"""

import base64
import json
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

CLIP = 3.0  # samples of a Gaussian beyond ±CLIP act like ±CLIP
FORBIDDEN = -1e9  # a logit whose probability is 0
FAINT = 0.1  # what has this mass is placed half way between where it is and the middle
MAX_NUMBERS = 2**24  # that a policy remembers, and of a picture
FORMAT = "joybridge.policy.v5"
ACTIVATIONS = {
    "swish": lambda x: x * _sigmoid(x),
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
}


class Policy:
    """What plays one behavior of a game: its device, and the networks that share it."""

    def __init__(self, path):
        """Read a policy. Raises OSError, and ValueError if the file is no policy of this format."""
        document = json.loads(Path(path).read_bytes(), object_hook=_decode_array)
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise ValueError(f"{path} is no {FORMAT!r}; write it with `joybridge export RUN policy.json`")
        self.options = document.get("options", {})  # of the game, where they are not its defaults
        self.sensors = document["sensors"]  # name, dtype and shape of each
        self.axes = document["axes"]  # name, low and high of each, in the order of their columns
        self.branches = document["branches"]  # name and choices of each, in the order of their columns
        self.deterministic = document["deterministic"]
        if not all(axis["low"] <= axis["high"] for axis in self.axes):
            raise ValueError(f"{path} is damaged")
        self._networks = document["policies"]
        self._shapes = {sensor["name"]: sensor["shape"] for sensor in self.sensors}

    def begin(self, lanes):
        """Return the state of new episodes, float32 [lanes, numbers]: for each network, last frames and its memory."""
        numbers = 0
        for network in self._networks:
            seen = [*network["sensors"], *(image["sensor"] for image in network["images"])]
            numbers += (network["frame_stack"] - 1) * sum(int(np.prod(self._shapes[name])) for name in seen)
            numbers += _remembers(network)
        if numbers > MAX_NUMBERS:
            raise ValueError("the policy is damaged")
        return np.zeros((lanes, numbers), np.float32)

    def watch(self, sensors, state):
        """Return the state after an observation with which an agent waits, the first of an episode."""
        flat, following = self._flat(sensors), []
        for network in self._networks:
            _, _, kept, state = self._see(network, flat, state)
            memory, state = np.split(state, [_remembers(network)], axis=1)
            following += [*kept, memory]
        return np.concatenate(following, axis=1)

    def act(self, sensors, state, random, masks=None):
        """Return axes, float32 [lanes, axes], choices, int32 [lanes, branches], and the state of the next decision.

        sensors: name -> [lanes, *shape], as the game sends them. random: a numpy.random.Generator; unused if the policy
        is deterministic. masks: name of a branch -> bool [lanes, choices], true: allowed; branches that are left out
        allow all their choices, at least one choice is allowed in every lane.
        """
        lanes = len(next(iter(sensors.values())))
        axes = np.zeros((lanes, len(self.axes)), np.float32)
        choices = np.zeros((lanes, len(self.branches)), np.int32)
        allowed = [
            np.asarray((masks or {}).get(branch["name"], np.ones((lanes, len(branch["choices"])))), bool)
            for branch in self.branches
        ]
        flat, following = self._flat(sensors), []
        for network in self._networks:
            features, images, kept, state = self._see(network, flat, state)
            memory, state = np.split(state, [_remembers(network)], axis=1)
            normal, uniform = self._noise(network, lanes, random)
            outputs, memory = _dense(network, features, memory)
            outputs, begin = _point(network, outputs, images), 0
            following += [*kept, memory]
            if not np.isfinite(outputs).all():
                raise ValueError("a sensor is not finite, or the policy is damaged")
            for column, table in enumerate(network["discrete"]):
                end = begin + len(table["values"])
                logits = self._mask(table, outputs[:, begin:end], allowed)
                row = logits.argmax(axis=1) if uniform is None else _sample(logits, uniform[:, column])
                values = np.array(table["values"])[row]
                if "axis" in table:
                    axes[:, table["axis"]] = values
                else:
                    choices[:, table["branches"]] = values
                if "axes" in table:
                    axes[:, table["axes"]] = np.array(table["positions"])[row]
                begin = end
            samples = outputs[:, begin:]
            if normal is not None:
                samples = samples + network["deviations"] * normal
            shares = np.clip(samples, -CLIP, CLIP) / CLIP
            for share, sample, target in zip(shares.T, samples.T, network["continuous"], strict=True):
                if "axis" in target:
                    if target.get("squashed"):
                        share = np.tanh(sample)
                    low, high = (self.axes[target["axis"]][bound] for bound in ("low", "high"))
                    axes[:, target["axis"]] = np.clip((low + high) / 2 + (high - low) / 2 * share, low, high)
                else:
                    mask = allowed[target["branch"]]
                    pressed = _press(share, target.get("threshold"), mask.shape[1])
                    fits = mask[np.arange(lanes), pressed]
                    choices[:, target["branch"]] = np.where(fits, pressed, mask.argmax(axis=1))
        if not np.isfinite(axes).all():
            raise ValueError("the policy is damaged")
        return axes, choices, np.concatenate(following, axis=1)

    def _flat(self, sensors):
        return {name: np.asarray(sensors[name], np.float32).reshape(len(sensors[name]), -1) for name in self._shapes}

    def _see(self, network, flat, state):
        """Return what the dense layers get, [lanes, numbers], images, what is remembered, and the rest of a state.

        Of each image there is what each step of its encoder makes of it.
        """
        nothing = np.zeros((len(state), 0), np.float32)
        frame = _scale(network, np.concatenate([nothing, *(flat[name] for name in network["sensors"])], axis=1))
        features, images, kept = [], [], []
        for newest, image in [(frame, None), *((flat[image["sensor"]], image) for image in network["images"])]:
            older, state = np.split(state, [(network["frame_stack"] - 1) * newest.shape[1]], axis=1)
            seen = np.concatenate([older, newest], axis=1)
            kept.append(seen[:, newest.shape[1] :])
            if image:
                height, width, channels = image["shape"]
                stack = np.moveaxis(seen.reshape(len(seen), -1, height, width, channels), 4, 2)
                pixels = stack.reshape(len(seen), -1, height, width) / np.float32(image["white"])
                images.append(_encode(image["steps"], pixels, ACTIVATIONS[network["activation"]]))
                seen = images[-1][-1].reshape(len(seen), -1)
            features.append(seen)
            if image:
                features += [_moments(images[-1][one["step"]], one["grid"]) for one in image.get("moments", ())]
        return np.concatenate(features, axis=1), images, kept, state

    def _noise(self, network, lanes, random):
        """Return noise for the Gaussians and the branches of a network, [lanes, number] each, or None and None."""
        if self.deterministic:
            return None, None
        normal = random.standard_normal((lanes, len(network["continuous"])), np.float32)
        return normal, random.random((lanes, len(network["discrete"])), np.float32)

    @staticmethod
    def _mask(table, logits, allowed):
        """Return logits in which a row of the table is FORBIDDEN unless all its choices are allowed."""
        if "axis" in table:
            return logits
        values = np.array(table["values"])
        fits = np.ones(logits.shape, bool)
        for branch, column in zip(table["branches"], values.T, strict=True):
            fits &= allowed[branch][:, column]
        return np.where(fits, logits, np.float32(FORBIDDEN))


def _scale(network, frame):
    """Return a frame [lanes, numbers] as the network was trained with it."""
    if "scaling" not in network:
        return frame
    scaling = network["scaling"]
    limit = np.float32(scaling.get("limit", np.inf))
    return np.clip((frame - scaling["shift"]) * scaling["scale"], -limit, limit)


def _encode(steps, values, activation):
    """Return an image [lanes, channels, height, width] after each of the steps of an encoder."""
    after = []
    for step in steps:
        if step["kind"] == "activation":
            values = activation(values)
        elif step["kind"] == "residual":
            values = values + _encode(step["steps"], values, activation)[-1]
        elif step["kind"] == "convolution":
            sums = np.tensordot(_windows(step, values, 0), step["weight"], ([1, 4, 5], [1, 2, 3])) + step["bias"]
            values = np.moveaxis(sums, 3, 1)
        else:
            values = _windows(step, values, -np.inf).max(axis=(4, 5))
        after.append(values)
    return after


def _moments(values, grid):
    """Return x, y and mass of what each channel of an image [lanes, channels, height, width] finds."""
    masses = np.square(values).reshape(*values.shape[:2], -1)
    mass, (x, y) = masses.sum(axis=2), np.moveaxis(masses @ grid.T, 2, 0)
    return np.concatenate([x / (mass + FAINT), y / (mass + FAINT), mass / (mass + 1)], axis=1)


def _point(network, outputs, images):
    """Return outputs in which what a map looks for, a weight for each channel, has become the logits of its cells."""
    parts, begin = [], 0
    for table in network["discrete"]:
        if "places" not in table:
            parts.append(outputs[:, begin : begin + len(table["values"])])
            begin += len(table["values"])
            continue
        logits = 0
        for place in table["places"]:
            weights = outputs[:, begin : begin + place["channels"]]
            found = np.einsum("lchw,lc->lhw", images[place["image"]][place["step"]], weights)
            logits = logits + found.reshape(len(found), -1) @ place["weight"].T
            begin += place["channels"]
        parts.append(logits)
    return np.concatenate([*parts, outputs[:, begin:]], axis=1)


def _windows(step, values, beyond):
    """Return what each window of a step covers, [lanes, channels, rows, columns, height, width]."""
    margin, stride = [step["padding"]] * 2, step["stride"]
    channels, height, width = values.shape[1:]
    if max(channels, len(step.get("bias", ()))) * (height + sum(margin)) * (width + sum(margin)) > MAX_NUMBERS:
        raise ValueError("the policy is damaged")
    padded = np.pad(values, [(0, 0), (0, 0), margin, margin], constant_values=beyond)
    return sliding_window_view(padded, step["size"], axis=(2, 3))[:, :, ::stride, ::stride]


def _dense(network, values, memory):
    """Return what the dense layers of a network put out, with its activation between them, and its next memory."""
    activation = ACTIVATIONS[network["activation"]]
    for number, layer in enumerate(network["layers"]):
        if number:
            values = activation(values)
        if "memory" in network and number == len(network["layers"]) - 1:
            values, memory = _remember(network["memory"], values, memory)
        values = _linear(layer, values)
    return values, memory


def _linear(layer, values):
    return values @ layer["weight"].T + layer["bias"]


def _remembers(network):
    """Return how many numbers the memory of a network has."""
    if "memory" not in network:
        return 0
    return network["memory"]["state"]["weight"].shape[1] * (2 if network["memory"]["kind"] == "lstm" else 1)


def _remember(layer, values, memory):
    """Return what a recurrent layer puts out, and its next memory, [lanes, numbers] each."""
    last, cells = np.split(memory, [layer["state"]["weight"].shape[1]], axis=1)
    given, kept = _linear(layer["input"], values), _linear(layer["state"], last)
    if layer["kind"] == "gru":
        (reset, update, new), (by_reset, by_update, by_new) = (np.split(gates, 3, axis=1) for gates in (given, kept))
        update = _sigmoid(update + by_update)
        new = np.tanh(new + _sigmoid(reset + by_reset) * by_new)
        last = (1 - update) * new + update * last
        return last, last
    write, keep, new, show = np.split(given + kept, 4, axis=1)
    cells = _sigmoid(keep) * cells + _sigmoid(write) * np.tanh(new)
    last = _sigmoid(show) * np.tanh(cells)
    return last, np.concatenate([last, cells], axis=1)


def _sigmoid(x):
    return 1 / (1 + np.exp(-np.clip(x, -80, None)))


def _sample(logits, uniform):
    """Return a choice per row with the probabilities softmax(logits); uniform: noise in [0, 1)."""
    sums = np.exp(logits.astype(float) - logits.max(axis=1, keepdims=True)).cumsum(axis=1)
    row = (sums <= uniform[:, None] * sums[:, -1:]).sum(axis=1)
    return np.where(row < logits.shape[1], row, logits.argmax(axis=1))  # the level may be rounded up to the total


def _press(share, threshold, count):
    """Return the choice of a branch of `count` choices at shares in -1..1."""
    if threshold is None:
        return np.minimum(((share + 1) / 2 * count).astype(int), count - 1)
    return (share > 0 if threshold == 0 else np.abs(share) < threshold).astype(int)


def _decode_array(value):
    """Return an array for what the file holds as {"shape": ..., "float32": BASE64}."""
    if set(value) != {"shape", "float32"}:
        return value
    return np.frombuffer(base64.b64decode(value["float32"]), "<f4").reshape(value["shape"])
