"""A policy acts and learns alike with either gradient and on any device."""

import numpy as np
import pytest
import torch

from joybridge.contract.codec import Codec, pack_act
from joybridge.simulator.catalog import load_games
from joybridge.simulator.session import Session
from joybridge.trainer.build import make_policies
from joybridge.trainer.config import Config, ConfigError, PolicyConfig
from joybridge.trainer.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb

ARENAS = 4
cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device here")


def weights_after_an_update(layout: str, device: str, *, autograd: bool) -> dict[str, np.ndarray]:
    """Return the weights of all policies after a rollout of Ferry, played in this process, and its update."""
    shared = PolicyConfig(
        hidden_sizes=[16], rollout_steps=20, time_horizon=20, minibatch_size=16, epochs=2, autograd=autograd
    )
    config = Config(game="ferry", layout=layout, arenas=ARENAS, accelerator=device, policy=shared)
    session = Session(load_games())
    started = session.answer(pb.PlayRequest(start=pb.Start(game="ferry", arenas=ARENAS))).started
    codecs = [Codec(behavior, ARENAS) for behavior in started.spec.behaviors]

    def unpack(step):
        return [codec.unpack_step(message) for codec, message in zip(codecs, step.behaviors, strict=True)]

    policies, acts, steps = (
        make_policies(config, started.spec, ARENAS),
        make_acts(started.spec, ARENAS),
        unpack(started.step),
    )
    for policy in policies:
        policy.begin(steps)
    for _ in range(shared.rollout_steps):
        for policy in policies:
            policy.act(steps, acts)
        request = pb.PlayRequest(act=pb.Act(behaviors=[pack_act(act) for act in acts]))
        steps = unpack(session.answer(request).step)
        for policy in policies:
            policy.take(steps)
    for policy in policies:
        policy.turn_over(0.1)
    return {
        f"{policy.name} {name}": array
        for policy in policies
        for name, array in policy.state().items()
        if name.startswith("network.")
    }


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
    with pytest.raises(ConfigError, match="device is cuda, but torch finds no such device"):
        make_policies(Config(game="ferry", accelerator="cuda"), spec, ARENAS)
