"""Several learners share an update: the result is that of one, whatever they learn, and whichever of them is lost."""

import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.distributed import HashStore  # type: ignore[attr-defined]

from joybridge.simulator.catalog import load_games
from joybridge.trainer.__main__ import main
from joybridge.trainer.actor import make_actors
from joybridge.trainer.checkpoint import load_checkpoint
from joybridge.trainer.config import Config
from joybridge.trainer.errors import LearnerError, LearnerLost
from joybridge.trainer.images import Image
from joybridge.trainer.layouts import ActionSpace
from joybridge.trainer.learners import group as groups
from joybridge.trainer.learners.choice import Learners
from joybridge.trainer.learners.group import Group, missing_learners
from joybridge.trainer.learners.message import receive_update, send_update
from joybridge.trainer.learners.team import wait_for_learners
from joybridge.trainer.learners.worker import PREPARED, RUN, Run, prepare, replicate
from joybridge.trainer.ppo.convolutions import ImageEncoder
from joybridge.trainer.ppo.distributions import FORBIDDEN
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.networks import Network
from joybridge.trainer.ppo.schedule import Coefficients
from joybridge.trainer.ppo.shared import SharedGradient, bounds, make_shard
from joybridge.trainer.ppo.update import Learner, ppo_update
from joybridge.trainer.train import train
from tests.support.games import PLACES
from tests.test_recovery import CONFIG, outcome

COUNT, ROWS, SIZE = 3, 50, 16
COEFFICIENTS = Coefficients(1e-3, 0.2, 0.01)
BETA = "joybridge.trainer.ppo.continuous.beta:Beta"
PIXELS = 6 * 6 * 2 + 3
SPACES = {
    "choices with masks": ActionSpace(0, (4, 3)),
    "gaussians": ActionSpace(2, ()),
    "both": ActionSpace(2, (3,)),
    "beta": ActionSpace(2, (3,), distributions=(BETA, BETA)),
    "images": ActionSpace(1, (3,)),
}


def together(count: int, work: Callable[[int], Any]) -> list[Any]:
    """Return what `work` returns for each learner; each has a thread."""
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(work, range(count)))


def make_groups(count: int, seconds: float) -> list[Group]:
    store = HashStore()
    return together(count, lambda number: Group(store, number, count, "127.0.0.1", seconds))


@pytest.fixture(scope="module")
def connected() -> list[Group]:
    return make_groups(COUNT, 60.0)


def make(name: str) -> tuple[Learner, Batch]:
    """Return a learner, and a batch that it disagrees with; the same at each call."""
    space, images = SPACES[name], None
    if name == "images":
        images = partial(ImageEncoder, "simple", [Image(3, 6, 6, 2)], PIXELS, 1, "relu")
    network = Network(PIXELS, space, [16, 8], True, 1, "swish", images)
    names = [f"b{index}" for index in range(len(space.branches))], [f"x{index}" for index in range(space.continuous)]
    learner = Learner("player", network, branches=names[0], gaussians=names[1], autograd=False)
    rng = torch.Generator().manual_seed(0)
    normal = partial(torch.randn, generator=rng)
    discrete = torch.stack([torch.randint(0, 3, (ROWS,), generator=rng) for _ in space.branches] or [normal(ROWS)], 1)
    masks = None
    if "masks" in name:
        masks = torch.zeros(ROWS, 2, 4)
        masks[::3, 0, 3] = FORBIDDEN
    continuous = torch.rand(ROWS, space.continuous, generator=rng) * 0.8 + 0.1
    batch = Batch(
        normal(ROWS, PIXELS), continuous, discrete[:, : len(space.branches)].long(), masks, normal(ROWS) * 0.1 - 2.0,
        normal(ROWS), normal(ROWS), normal(ROWS),
    )  # fmt: skip
    return learner, batch


def shared(name: str, group: Group) -> tuple[Learner, Batch]:
    learner, batch = make(name)
    learner.gradient = SharedGradient(learner, group.add_up)
    begin, end = bounds(ROWS, group.number, group.count)
    return learner, make_shard(batch.slice(begin, end), begin, ROWS)


@pytest.mark.parametrize("name", SPACES)
def test_the_gradient_of_shares_is_that_of_the_whole_minibatch(name, connected):
    learner, batch = make(name)
    rows = torch.from_numpy(np.random.default_rng(2).permutation(ROWS))[: ROWS // 2]
    statistics = learner.gradient(batch, rows, COEFFICIENTS)

    def share(number: int) -> tuple[np.ndarray, torch.Tensor | None]:
        other, shard = shared(name, connected[number])
        return other.gradient(shard, rows, COEFFICIENTS), other.weights.grad

    for found, gradient in together(COUNT, share):
        np.testing.assert_allclose(found, statistics, rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(gradient, learner.weights.grad, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("limits", [{}, {"max_grad_norm": 0.1, "target_kl": 1e-5}])
def test_an_update_by_several_learners_is_that_of_one_and_the_same_for_all_of_them(name, limits, connected):
    def update(learner: Learner, batch: Batch) -> tuple[dict[str, float], torch.Tensor]:
        rng = np.random.default_rng(0)
        found = ppo_update(learner, batch, COEFFICIENTS, epochs=3, minibatch_size=SIZE, rng=rng, **limits)
        return found, learner.weights.detach()

    alone, weights = update(*make(name))
    results = together(COUNT, lambda number: update(*shared(name, connected[number])))
    for found, others in results:
        assert others.numpy().tobytes() == results[0][1].numpy().tobytes()
        torch.testing.assert_close(others, weights, rtol=0, atol=2e-5)  # the learning rate is 1e-3
        del found["explained_variance"]  # of its own rows
        for key, value in found.items():
            assert value == pytest.approx(alone[key], rel=1e-3, abs=1e-5), key
    assert not torch.equal(weights, make(name)[0].weights)


def test_a_shard_is_shuffled_and_cut_as_the_whole_batch_and_may_have_no_rows():
    _, batch = make("both")
    order = torch.from_numpy(np.random.default_rng(1).permutation(ROWS))
    whole = batch.rows(order[20:24])
    found = []
    for number in range(10):
        begin, end = bounds(ROWS, number, 10)
        shard = make_shard(batch.slice(begin, end), begin, ROWS).rows(order[20:24])
        assert len(shard) == 4 and shard.own().observations.equal(whole.observations[shard.places])
        found += shard.places.tolist()
    assert sorted(found) == [0, 1, 2, 3]


def test_learners_get_the_weights_and_their_own_rows_of_an_update(connected):
    config = Config(game="hybrid", layout="hybrid", arenas=ROWS)
    spec = load_games(PLACES)["hybrid"].describe({"size": "small", "masks": "on"})
    replicas = [replicate(make_actors(config, spec)[0], ROWS) for _ in range(COUNT)]
    learner, actor = replicas[0].learner, replicas[0].actor
    with torch.no_grad():
        learner.weights += 1.0
        learner.moments["step"] += 7.0
    space, normal = actor.layout.space, partial(torch.randn, generator=torch.Generator().manual_seed(0))
    discrete, masks = torch.ones(ROWS, len(space.branches)).long(), normal(ROWS, len(space.branches), space.widest)
    batch = Batch(
        normal(ROWS, actor.observation_size), normal(ROWS, space.continuous), discrete, masks,
        *(normal(ROWS) for _ in range(4)),
    )  # fmt: skip

    def exchange(number: int) -> Any:
        if number == 0:
            return send_update(connected[0], 0, 5, learner, batch, COEFFICIENTS)
        return receive_update(connected[number], [replicas[number]])

    sent, *received = together(COUNT, exchange)
    assert len(sent.own()) == bounds(ROWS, 0, COUNT)[1]
    for number, update in enumerate(received, 1):
        assert (update.updates, update.coefficients) == (5, COEFFICIENTS)
        assert torch.equal(update.replica.learner.weights, learner.weights)
        assert update.replica.learner.moments["step"] == 7.0
        for name, tensor in vars(update.shard.own()).items():
            assert torch.equal(tensor, getattr(batch, name)[slice(*bounds(ROWS, number, COUNT))])


# What goes wrong


def test_a_learner_that_does_not_answer_is_named_within_the_time_limit(monkeypatch):
    monkeypatch.setattr(groups, "PRESENCE_SECONDS", 0.05)
    trainer, *_others = make_groups(3, 0.3)
    trainer.store.set(f"{groups.PRESENCE} 1", "")
    with pytest.raises(LearnerLost, match="lost learner 2 of 3: Timed out waiting 300ms for "):
        trainer.add_up(torch.zeros(3))
    assert missing_learners(trainer.store, 3) == [2]


def test_an_update_that_is_not_of_the_run_is_refused():
    first, second = make_groups(2, 60.0)
    with ThreadPoolExecutor(1) as threads:
        refused = threads.submit(receive_update, second, [])
        first.spread(torch.zeros(7, dtype=torch.float64))
        with pytest.raises(LearnerError, match="update 0 of policy 0 with 0 rows is not of this run"):
            refused.result()


def test_a_learner_with_another_torch_or_that_is_never_ready_is_named():
    store = HashStore()
    run = Run(torch="1.0", learners=2, config=Config(game="hybrid"), spec=b"")
    store.set(RUN, run.model_dump_json())
    with pytest.raises(LearnerError, match=r"torch .* is installed, but the trainer has 1\.0; install that"):
        prepare(store)
    with pytest.raises(LearnerLost, match=r"learner 1 of 2 was not ready within 0\.01 s"):
        wait_for_learners(store, 2, 0.01)
    store.set(PREPARED.format(1), "no room")
    with pytest.raises(LearnerError, match="learner 1 of 2 cannot take part: no room"):
        wait_for_learners(store, 2, 1.0)


def test_the_configuration_of_a_run_reaches_learners_unchanged():
    config = CONFIG.model_copy(update={"parameters": {"bird_speed": 1 / 3}, "stop": 7})
    sent = Run(torch="", learners=2, config=config, spec=bytes(range(256)))
    assert Run.model_validate_json(sent.model_dump_json()) == sent


@pytest.mark.usefixtures("signals")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["accelerator=cuda"], "accelerator is cuda, but --learners share only processors; set cpu"),
        (["demonstrations=shown"], "demonstrations cannot be cloned by several learners; leave out --learners"),
    ],
)
def test_what_only_one_learner_can_do_is_refused(options, message, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("joybridge.trainer.__main__.find_demonstrations", lambda folder: [])
    assert main(["train", "archer/hybrid", *options, "--run", str(tmp_path / "run"), "--learners", "2"]) == 1
    assert message in capsys.readouterr().err


# Whole runs


def workers() -> list[int]:
    """Return the processes of learners that this process, in any of its threads, has started."""
    texts = [path.read_text() for path in Path("/proc/self/task").glob("*/children")]
    started = [int(pid) for text in texts for pid in text.split()]
    return [pid for pid in started if b"learners.worker" in Path(f"/proc/{pid}/cmdline").read_bytes()]


@pytest.mark.slow
def test_a_run_of_two_learners_is_that_of_one_and_goes_on_with_the_same_bits_when_a_learner_is_killed(
    simulator, tmp_path, caplog
):
    def run(name: str, count: int, report: Callable[..., None] = lambda *_: None) -> Path:
        folder, say = tmp_path / name, lambda text: None
        learners, revive = Learners(count), lambda: [simulator]
        train(CONFIG, folder, [simulator], resume=False, report=report, revive=revive, say=say, learners=learners)
        return folder

    def kill(timesteps: int, *_: object) -> None:
        if timesteps == CONFIG.end // 2 and not killed:
            killed.extend(workers())
            os.kill(killed[0], signal.SIGKILL)

    killed: list[int] = []
    one, two, lost = run("one", 1), run("two", 2), run("lost", 2, kill)
    assert outcome(lost) == outcome(two)
    assert "lost learner 1 of 2: " in caplog.text and "(restart 1 of 5)" in caplog.text
    assert workers() == []
    arrays, others = (load_checkpoint(folder)[0] for folder in (one, two))
    network = [name for name in arrays if "/policy/network." in name]
    for name in network:
        np.testing.assert_allclose(others[name], arrays[name], rtol=0, atol=1e-5)
    assert any(arrays[name].tobytes() != others[name].tobytes() for name in network)
