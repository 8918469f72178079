"""A session over several simulators shows what a single session shows."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from joybridge.client.client import Session, SimulatorError
from joybridge.client.sharded_session import SessionSpec, ShardedSession, divide
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.sharding import split
from joybridge.layouts import make_acts

ARENAS = 7
TIMESTEPS = 40


def arrays(step: StepArrays) -> Iterator[tuple[str, Any]]:
    """Yield the names and arrays of a step."""
    for field in fields(step):
        value = getattr(step, field.name)
        yield from ((field.name, array) for array in (value if isinstance(value, list) else [value]))


def assert_same(steps: list[StepArrays], others: list[StepArrays]) -> None:
    for step, other in zip(steps, others, strict=True):
        for (name, array), (_, expected) in zip(arrays(step), arrays(other), strict=True):
            assert (array is None) == (expected is None), name
            if array is not None:
                np.testing.assert_array_equal(array, expected, err_msg=name)


def random_acts(session: Session, rng: np.random.Generator) -> list[ActArrays]:
    acts = make_acts(session.spec, ARENAS)
    for act in acts:
        act.axes[:] = rng.uniform(0.5, 1.0, act.axes.shape)
        act.choices[:] = rng.integers(0, 2, act.choices.shape)
    return acts


@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("game", ["hybrid", "duel"])
def test_its_steps_are_those_of_a_single_session(simulator, game, parts):
    rng = np.random.default_rng(0)
    with Session(simulator, game, arenas=ARENAS, seed=3) as single:
        sharded = ShardedSession([simulator] * parts, divide(SessionSpec(game, ARENAS, seed=3), parts))
        with closing(sharded):
            assert_same(sharded.steps, single.steps)
            ended = 0
            for _ in range(TIMESTEPS):
                acts = random_acts(single, rng)
                assert_same(sharded.step(acts), single.step(acts))
                ended += sum(len(step.ended) for step in single.steps)
            assert ended > 0


def test_it_continues_from_its_snapshots(simulator):
    rng = np.random.default_rng(0)
    addresses: list[str] = [simulator] * 2
    whole = SessionSpec("shooting_birds", ARENAS, seed=3)
    with closing(ShardedSession(addresses, divide(whole, 2))) as session:
        acts = random_acts(session.sessions[0], rng)
        session.step(acts)
        again = ShardedSession(addresses, divide(whole, 2, snapshots=[part.save() for part in session.sessions]))
        with closing(again):
            for _ in range(TIMESTEPS):
                assert_same(again.step(acts), session.step(acts))


def test_behaviors_that_differ_are_an_error(simulator):
    parts = divide(SessionSpec("hybrid", 2, seed=0), 2, [{"size": "small"}, {"size": "large"}])
    with pytest.raises(SimulatorError, match="different versions of hybrid: their behaviors differ; restart both"):
        ShardedSession([simulator] * 2, parts)


@pytest.mark.parametrize(
    ("arenas", "parts", "bounds"), [(8, 2, [0, 4, 8]), (7, 3, [0, 2, 5, 7]), (3, 3, [0, 1, 2, 3]), (5, 1, [0, 5])]
)
def test_arenas_are_split_into_nearly_equal_parts(arenas, parts, bounds):
    assert split(arenas, parts) == bounds
