"""A policy acts and learns alike with either gradient and on any accelerator."""

import sys
from functools import partial
from types import FrameType

import numpy as np
import pytest
import torch
from numba.core.serialize import _numba_unpickle

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import STATISTICS
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import Codec, StepArrays, pack_act
from joybridge.layouts import make_acts
from joybridge.policy.actor import make_actors
from joybridge.policy.player import PolicyPlayer
from joybridge.policy.policy import Policy
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.fast.kernels import draw_noise
from joybridge.ppo.loss import autograd_gradient, joint_log_probs
from joybridge.ppo.schedule import Coefficients
from joybridge.run.train import learn
from joybridge.simulator.catalog import load_games
from joybridge.simulator.session import Session
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import PLACES

ARENAS = 4
cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device here")


def full_agents(game: str, options: dict[str, str], config: Config, accelerator: str = "cpu") -> list[Policy]:
    """Return policies with a full rollout of a game that is played in this process."""
    session = Session(load_games(PLACES))
    start = pb.Start(game=game, arenas=ARENAS, options=options)
    started = session.answer(pb.PlayRequest(start=start)).started
    codecs = [Codec(behavior, ARENAS) for behavior in started.spec.behaviors]

    def unpack(step):
        return [codec.unpack_step(message) for codec, message in zip(codecs, step.behaviors, strict=True)]

    policies = [
        Policy(actor, started.spec.behaviors[actor.behavior], [0, ARENAS])
        for actor in make_actors(config, started.spec, accelerator)
    ]
    acts, steps = make_acts(started.spec, ARENAS), unpack(started.step)
    for policy in policies:
        policy.begin([steps])
    while not policies[0].rollout.full:
        for policy in policies:
            policy.act(steps, acts)
        for policy in policies:
            policy.note(acts)
        request = pb.PlayRequest(act=pb.Act(behaviors=[pack_act(act) for act in acts]))
        steps = unpack(session.answer(request).step)
        for policy in policies:
            policy.store(steps)
    return policies


def small(layout: str, *, autograd: bool, game: str = "ferry") -> Config:
    policy = PolicyConfig(
        hidden_sizes=[16], rollout_steps=20, time_horizon=20, minibatch_size=16, epochs=2, autograd=autograd
    )
    return Config(game=game, layout=layout, arenas=ARENAS, policy=policy)


def weights_after_an_update(layout: str, accelerator: str, *, autograd: bool) -> dict[str, np.ndarray]:
    """Return the weights of all policies after a rollout of Ferry and its update."""
    policies = full_agents("ferry", {}, small(layout, autograd=autograd), accelerator)
    for policy in policies:
        learn(policy, 0.1)
    return {f"{policy.actor.name} {name}": array for policy in policies for name, array in policy.actor.state().items()}


@pytest.mark.parametrize("layout", ["hybrid", "ordinal-5", "beta"])
def test_compiled_code_calls_no_python_code_in_which_an_interrupt_would_end_the_process(layout):
    """What Numba returns as an array or a NamedTuple is made with this function, whose failure it does not notice."""
    calls = []

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call" and frame.f_code is _numba_unpickle.__code__:
            calls.append(event)

    for policy in full_agents("hybrid", {}, small(layout, autograd=False, game="hybrid")):
        actor, rollout = policy.actor, policy.rollout
        seen, space = rollout.observation(0, slice(None)), actor.layout.space
        noise = draw_noise(np.random.default_rng(0), (ARENAS, space.continuous), (ARENAS, len(space.branches)))
        batch = rollout.batch(np.ones_like(rollout.rewards), rollout.decided())
        gradients = [] if layout == "beta" else [ClosedFormGradient(actor.network, threads) for threads in (1, 2)]
        for profile in (None, note):  # compiled in the first round
            sys.setprofile(profile)
            try:
                actor.act(seen, None, noise)
                actor.values(seen)
                for gradient in gradients:
                    gradient(batch, torch.arange(len(batch)), Coefficients(1e-3, 0.2, 0.01))
            finally:
                sys.setprofile(None)
    assert not calls


def test_who_plays_keeps_its_noise_for_as_many_decisions_as_the_layout_says():
    started = Session(load_games(PLACES)).answer(pb.PlayRequest(start=pb.Start(game="hybrid", arenas=2))).started
    (actor,) = make_actors(small("gsde-3, x=hybrid", autograd=False, game="hybrid"), started.spec)
    step = Codec(started.spec.behaviors[0], 2).unpack_step(started.step.behaviors[0])
    acts = make_acts(started.spec, 2)
    player, drawn = PolicyPlayer(actor, 2, 0, deterministic=False), []
    player.begin(step)
    for _ in range(6):
        player.act(step, acts[0])
        drawn.append(player.noise.normal)
    holds = actor.network.noise_holds
    assert holds.tolist() == [1] + 16 * [3]
    for t, numbers in enumerate(drawn):
        np.testing.assert_array_equal(numbers[:, 1:], drawn[t - t % 3][:, 1:])
    assert len({numbers.tobytes() for numbers in drawn}) == 6 and len({n[:, 1:].tobytes() for n in drawn}) == 2
    for _ in range(2):  # where lanes come and go, as those of an opponent, each decision has its own
        player.act(step, acts[0], np.array([1]))
        drawn.append(player.noise.normal)
    assert drawn[-1].shape == drawn[-2].shape == (1, 17) and not (drawn[-1] == drawn[-2]).any()


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "ordinal-5", "threshold-0.0", "multiagent"])
def test_before_any_update_the_ratio_of_what_was_sampled_is_1_by_autograd_and_by_the_closed_form(layout):
    """Axes, branches and masks: sampling, the reference and the compiled loss agree on every log-probability."""
    coefficients = Coefficients(1e-3, 1e-4, 0.01)  # so narrow a clip range that any disagreement is counted
    masked = False
    for policy in full_agents("hybrid", {"masks": "on"}, small(layout, autograd=False, game="hybrid")):
        decided = policy.rollout.decided()
        assert decided.sum() > ARENAS * 10
        batch = policy.rollout.batch(np.ones_like(policy.rollout.rewards), decided)
        masked |= batch.masks is not None and bool((batch.masks < 0).any())
        network = policy.actor.network
        log_probs, _, _ = joint_log_probs(network(batch.observations), network.log_variance, batch)
        torch.testing.assert_close(log_probs, batch.log_probs, atol=2e-5, rtol=0)
        for gradient in (partial(autograd_gradient, network), ClosedFormGradient(network)):
            statistics = dict(
                zip(STATISTICS, gradient(batch, torch.arange(len(batch)), coefficients)[: len(STATISTICS)], strict=True)
            )
            assert statistics["approx_kl"] == pytest.approx(0.0, abs=1e-7)
            assert statistics["clip_fraction"] == 0.0
    assert masked is (layout != "threshold-0.0")


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=cuda)])
@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "threshold-0.0", "multiagent"])
def test_autograd_learns_on_any_device_what_the_closed_form_does(layout, device):
    closed = weights_after_an_update(layout, "cpu", autograd=False)
    other = weights_after_an_update(layout, device, autograd=True)
    assert closed.keys() == other.keys()
    for name, array in closed.items():
        np.testing.assert_allclose(other[name], array, atol=2e-5, err_msg=name)


@pytest.mark.skipif(torch.cuda.is_available(), reason="torch finds a CUDA device here")
def test_a_device_that_is_not_there_is_refused_by_its_name():
    spec = load_games()["ferry"].describe({})
    with pytest.raises(ConfigError, match="accelerator is cuda, but torch finds no such device"):
        make_actors(Config(game="ferry"), spec, "cuda")


@pytest.mark.parametrize(("updates", "share"), [(0, 0.1), (50, 0.55), (100, 1.0), (1000, 1.0)])
def test_penalties_grow_from_a_tenth_to_their_weight_over_the_ramp(updates, share):
    config = PolicyConfig(rollout_steps=5, penalty_ramp=2000)  # 20 timesteps per rollout
    (policy,) = full_agents("orchard", {}, Config(game="orchard", policy=config))
    policy.updates = updates - 1
    policy.restart()
    gain, cost = np.float32(1.0), np.float32(-0.5)
    channels = np.zeros((ARENAS, len(policy.actor.encoder.weights)), np.float32)
    channels[:, 0], channels[:, -1] = gain / policy.actor.encoder.weights[0], cost / policy.actor.encoder.weights[-1]
    (step,) = policy_step(policy, channels)
    policy.store([step])
    np.testing.assert_allclose(policy.rollout.rewards[0], gain + share * cost, rtol=1e-6)


def policy_step(policy: Policy, channels: np.ndarray) -> list[StepArrays]:
    """Return a step in which every lane earns the same."""
    sensors = [np.zeros((ARENAS, *sensor.shape), np.float32) for sensor in policy.actor.encoder.sensors]
    return [StepArrays(sensors, channels, np.zeros(ARENAS, bool), np.zeros(ARENAS, bool))]
