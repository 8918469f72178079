"""Runs to be exported, whose actions depend on all that is observed, and the runtimes that play them."""

import importlib.util
import math
from pathlib import Path

import numpy as np

from joybridge.client.client import describe
from joybridge.config.config import Config
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.policy.actor import SCALING, make_actors
from joybridge.policy.document import decode, encode, make_document
from joybridge.run.checkpoint import Manifest, save_checkpoint
from joybridge.run.folder import keep_config

EXAMPLES = Path(__file__).parents[2] / "proto" / "examples"
RUNTIME = EXAMPLES / "python" / "policy.py"
IMAGES = [  # encoder, pixels, frames, activation, one convolution for actor and critic
    ("windows", "20", 2, "relu", True),
    ("simple", "9", 3, "swish", False),
    ("nature", "36", 1, "elu", True),
    ("impala", "9", 2, "tanh", False),
    ("auto", "20", 1, "swish", False),
    ("moments", "20", 2, "tanh", True),
]
SMALL = PolicyConfig(frame_stack=3, hidden_sizes=[8, 8])
POINTERS = [  # images, layout
    (IMAGES[0], "map-5x4"),
    (IMAGES[1], "map-4x4, gear=threshold-0.0"),
    (IMAGES[2], "map-3x2, gear=ordinal-3"),
    (IMAGES[3], "map-4x3"),
    (IMAGES[5], "map-4x4"),
]
MEMORIES = [  # kind, body of actor and critic, layout, what they see
    ("gru", True, "bucket-3", "numbers"),
    ("lstm", False, "hybrid", "numbers"),
    ("lstm", True, "multiagent", "numbers"),
    ("gru", False, "threshold-0.5", "images"),
    ("lstm", False, "joint-3", "images"),
]


def make_run(folder: Path, simulator: str, **settings) -> Path:
    """Return a run whose networks have large random weights: its actions depend on all that they observe."""
    config = Config(**({"game": "hybrid", "policy": SMALL} | settings))
    rng, arrays = np.random.default_rng(8), {}
    for actor in make_actors(config, describe(simulator, config.game, config.options)):
        for name, array in actor.state().items():
            inputs = math.prod(array.shape[1:])  # with many, smaller weights, so that axes are not all at their bounds
            width = min(0.7, (1.0 if actor.network.encoders else 4.0) / math.sqrt(inputs))
            if actor.network.pointers:  # so that the likeliest cell is not always the same
                width /= 3
            drawn = rng.normal(0.0, width, array.shape).astype(np.float32)
            if name.startswith(SCALING):
                drawn = rng.uniform(0.5, 2.0, array.shape).astype(np.float32)
            arrays[f"{actor.name}/policy/network.{name}"] = drawn
    keep_config(config, folder)
    save_checkpoint(folder, arrays, Manifest(timesteps=64))
    return folder


def load_runtime(path):
    """Return the module in a file."""
    spec = importlib.util.spec_from_file_location("policy", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Given:
    """Random numbers that somebody else has drawn, in place of a generator."""

    def __init__(self, players):
        noise = [player.noise for player in players]
        self._normal, self._uniform = iter([n.normal for n in noise]), iter([n.uniform for n in noise])

    def standard_normal(self, shape, dtype):
        return next(self._normal)

    def random(self, shape, dtype):
        return next(self._uniform)


def documents(play, index=0, deterministic=False):
    actors = [player.actor for player in play.players if player.actor.behavior == index]
    return decode(encode(make_document(actors, play.spec.behaviors[index], deterministic=deterministic, about={})))


def seeing(encoder, pixels, frames, activation, shared):
    """Return the settings of a run in the gallery."""
    policy = PolicyConfig(
        image_encoder=encoder,
        frame_stack=frames,
        activation=activation,
        shared_encoder=shared,
        shared_body=None if shared else False,
        hidden_sizes=[8],
        scale_observations="running",
    )
    return {"game": "gallery", "options": {"pixels": pixels}, "policy": policy}


def pointing(images, layout):
    """Return the settings of a run whose policies point into the images of the gallery."""
    return seeing(*images) | {"layout": layout}


def remembering(kind, shared, layout, seen):
    """Return the settings of a run whose policies have a memory."""
    settings = seeing("simple", "9", 2, "relu", True) if seen == "images" else {"policy": SMALL}
    memory = {"memory": MemoryConfig(kind=kind, size=6), "shared_body": shared}
    return settings | {"layout": layout, "policy": settings["policy"].model_copy(update=memory)}


PLAY_ALL = """
import { readFileSync } from "node:fs";
import { Policy } from "POLICY";
const [policyFile, decisionsFile] = process.argv.slice(1);
const policy = new Policy(JSON.parse(readFileSync(policyFile, "utf8")));
let state = policy.begin();
for (const { sensors, masks, normal, uniform, waits, ends } of JSON.parse(readFileSync(decisionsFile, "utf8"))) {
  if (waits) {
    state = policy.watch(sensors, state);
    continue;
  }
  const action = policy.act(sensors, state, masks, { normal: () => normal.shift(), uniform: () => uniform.shift() });
  state = ends ? policy.begin() : action.state;
  console.log([...action.axes, ...action.choices].join(" "));
}
"""
