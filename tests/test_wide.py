"""An observation of 64 MiB, from the game to the client, over both transports."""

import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.contract.codec import ActArrays
from tests.support.servers import games, server
from tests.support.wide_game import SHAPE


@pytest.mark.nightly
@pytest.mark.parametrize("transport", ["grpc", "local"])
@pytest.mark.promise("P6")
def test_an_observation_of_64_mib_arrives_as_it_was_sent(transport):
    with (
        server("--address", "127.0.0.1:0", *games("tests.support.wide_game:Wide")) as process,
        Session(process.address, "wide", arenas=1, seed=5, transport=transport) as session,
    ):
        wanted = np.random.default_rng(5).random((1, *SHAPE), np.float32)
        assert wanted.nbytes == 2**26
        for _ in range(3):
            assert np.array_equal(session.steps[0].observations[0], wanted)
            session.step([ActArrays(np.empty((1, 0), np.float32), np.ones((1, 1), np.int32))])
            wanted = wanted[..., ::-1]
