"""The learner: updates of networks, beside bare products of the same shapes."""

from collections.abc import Callable

import numpy as np
import torch

from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.memory import keep_memory
from joybridge.contract.spec import choose_options
from joybridge.layouts import ActionSpace, make_layouts
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.history import Window
from joybridge.ppo.images import Image
from joybridge.ppo.loss import Batch
from joybridge.ppo.memory import Sequences
from joybridge.ppo.networks import MemoryKind, Network, Towers
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients
from joybridge.ppo.threads import use_one_thread
from joybridge.ppo.update import Learner, ppo_update
from joybridge.simulator.catalog import load_games
from joybridge.v1 import bridge_pb2 as pb
from tools.bench.measure import Figures, measure


def bench_learner() -> Figures:
    """Sample passes per second of an update of Shooting Birds bucket-11, batch 256, and of its matrix products."""
    use_one_thread()
    keep_memory()
    rows, minibatch, inputs, hidden = 4425, 256, 132, 100
    figures: Figures = {}
    layout = make_layouts("bucket-11", _device())[""]
    for shared in (True, False):
        body = "one tower" if shared else "two towers"
        networks = [Network(inputs, layout.space, Towers([hidden, hidden], shared), 0) for _ in range(3)]
        names = [str(branch) for branch in range(len(layout.space.branches))]
        ways = ("autograd", "closed form", "closed form with two threads")
        learners = {
            name: Learner(
                name,
                network,
                branches=names,
                gaussians=[],
                autograd=name == "autograd",
                threads=2 if "threads" in name else 1,
            )
            for name, network in zip(ways, networks, strict=True)
        }
        batch = random_batch(Observations(torch.randn(rows, inputs)), rows)

        for name, learner in learners.items():

            def work(learner=learner, batch=batch) -> float:  # type: ignore[no-untyped-def]
                ppo_update(
                    learner,
                    batch,
                    Coefficients(3e-4, 0.2, 0.05),
                    PolicyConfig(epochs=4, minibatch_size=minibatch),
                    np.random.default_rng(0),
                )
                return 4.0 * (rows // minibatch) * minibatch

            figures[f"{name}, {body}, sample passes/s"] = measure(work)
        actor, critic = networks[0].actor, networks[0].critic
        outputs = [tower.head.weight for tower in (actor, critic) if tower]
        figures[f"bare matrix products, {body}, sample passes/s"] = measure(
            lambda outputs=outputs: _products(outputs, minibatch, inputs, hidden)  # type: ignore[misc]
        )
        bare = figures[f"bare matrix products, {body}, sample passes/s"]["median"]
        for way in ways[1:]:
            ratio = figures[f"{way}, {body}, sample passes/s"]["median"] / bare
            figures[f"{way} / bare products, {body}"] = {"median": ratio, "low": ratio, "high": ratio}
    return figures | _image_learner(layout.space) | _memory_learner(layout.space)


def random_batch(observations: Observations, rows: int) -> Batch:
    """Return a minibatch of random advantages and values under three branches."""
    return Batch(
        observations,
        torch.zeros(rows, 0),
        torch.zeros(rows, 3, dtype=torch.long),
        None,
        torch.full((rows,), -5.9),
        torch.randn(rows),
        torch.randn(rows),
        torch.randn(rows),
    )


def _image_learner(space: ActionSpace) -> Figures:
    """Sample passes per second of an update from two images of 32 x 32, and of the bare passes of its network."""
    rows, minibatch, images, rng = 3072, 1024, [Image(32, 32, 1)] * 2, np.random.default_rng(0)
    network = Network(0, space, Towers([128, 128], True, "relu"), 0, [ImageEncoder("auto", images, 0, 1, "relu")])
    names = [str(branch) for branch in range(len(space.branches))]
    learner = Learner("player", network, branches=names, gaussians=[], autograd=False)
    bytes_of_all = [rng.integers(0, 256, (rows, 1, *image.shape), np.uint8) for image in images]
    windows = tuple(Window(each, np.arange(rows)[:, None], np.zeros(rows, np.int64)) for each in bytes_of_all)
    batch = random_batch(Observations(torch.zeros(rows, 0), windows), rows)
    seen = batch.observations.index_select(0, torch.arange(minibatch))

    def bare() -> float:
        for _ in range(rows // minibatch):
            logits, _, value = network(seen)
            (logits[:, :, :3].sum() + value.sum()).backward()
        return float(rows)

    return _beside_bare("two images", learner, batch, minibatch, bare)


def _memory_learner(space: ActionSpace) -> Figures:
    """Sample passes per second of an update with a GRU of 64 units, and of the bare passes of that layer."""
    rows, minibatch, length, size = 4096, 1024, 32, 64
    network = Network(40, space, Towers([size], True, "swish", MemoryKind("gru", size)), 0)
    names = [str(branch) for branch in range(len(space.branches))]
    learner = Learner("player", network, branches=names, gaussians=[], autograd=False)
    batch, count = random_batch(Observations(torch.randn(rows, 40)), rows), rows // length
    begins, lengths = length * torch.arange(count), torch.full((count,), length)
    batch.sequences = Sequences(begins, lengths, torch.zeros(count, size), torch.zeros_like(begins))
    layer, features = torch.nn.GRU(size, size), torch.randn(length, minibatch // length, size, requires_grad=True)

    def bare() -> float:
        for _ in range(rows // minibatch):
            layer(features)[0].sum().backward()
        return float(rows)

    return _beside_bare("a GRU", learner, batch, minibatch, bare)


def _beside_bare(what: str, learner: Learner, batch: Batch, minibatch: int, bare: Callable[[], float]) -> Figures:
    """Sample passes per second of an update, of the bare passes, and their ratio."""

    def update() -> float:
        settings = PolicyConfig(epochs=1, minibatch_size=minibatch)
        ppo_update(learner, batch, Coefficients(1e-3, 0.2, 0.02), settings, np.random.default_rng(0))
        return float(len(batch))

    figures = {f"{what}, sample passes/s": measure(update), f"{what}, bare passes/s": measure(bare)}
    ratio = figures[f"{what}, sample passes/s"]["median"] / figures[f"{what}, bare passes/s"]["median"]
    return figures | {f"{what} / bare passes": {"median": ratio, "low": ratio, "high": ratio}}


def _products(heads: list[torch.Tensor], minibatch: int, inputs: int, hidden: int) -> float:
    """Run the matrix products of forward and backward passes, nothing else."""
    x, g1, g2 = torch.randn(minibatch, inputs), torch.randn(minibatch, hidden), torch.randn(minibatch, hidden)
    w1, w2 = torch.randn(hidden, inputs), torch.randn(hidden, hidden)
    for _ in range(50):
        for head in heads:
            weight = head.detach()
            torch.mm(x, w1.t())
            torch.mm(g1, w2.t())
            outputs = torch.mm(g2, weight.t())
            torch.mm(outputs.t(), g2)
            torch.mm(outputs, weight)
            torch.mm(g2.t(), g1)
            torch.mm(g2, w2)
            torch.mm(g1.t(), x)
    return 50.0 * minibatch


def _device() -> pb.Device:
    return (
        load_games()["shooting_birds"]
        .describe(choose_options(load_games()["shooting_birds"].options, {}, "shooting_birds"))
        .behaviors[0]
        .device
    )
