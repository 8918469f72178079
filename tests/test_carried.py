"""Decisions of lanes that wait beyond the end of a rollout: they are learned from once their outcome is known."""

import numpy as np
import pytest

from joybridge.contract.codec import StepArrays
from joybridge.layouts import ActionSpace
from joybridge.policy.encoder import push_frames
from joybridge.ppo.carried import carried_from
from joybridge.ppo.fast.kernels import Action
from joybridge.ppo.images import Image
from joybridge.ppo.observation import Observation
from joybridge.ppo.rollout import RolloutBuffer

LANES, STACK, LENGTH = 5, 2, 36
SPACE = ActionSpace(1, (2,))
FORMS = [Image(1, 2, 1)]


def make_rollout(steps):
    return RolloutBuffer(steps, [slice(0, LANES)], STACK, SPACE, FORMS, STACK, 1)


def stream(seed):
    """Return LENGTH steps in which lanes wait and end at random, each with what lanes see, get and are allowed."""
    rng = np.random.default_rng(seed)
    steps = []
    for t in range(LENGTH):
        terminated, deciding = rng.random(LANES) < 0.1, rng.random(LANES) < 0.3
        step = StepArrays([], np.zeros((LANES, 1)), terminated, np.zeros(LANES, bool), deciding=deciding)
        step.ended = np.flatnonzero(terminated).astype(np.int32)
        allowed = [rng.random((LANES, 2)) < 0.7] if LENGTH // 3 < t < LENGTH // 2 else None
        numbers, rewards = rng.random((2, LANES), np.float32)
        action = Action(
            rng.random((LANES, 1), np.float32), rng.integers(0, 2, (LANES, 1)), rng.random(LANES, np.float32)
        )
        steps.append((step, numbers[:, None], rewards, allowed, action, rng.random((LANES, 1), np.float32)))
    return steps


def play(rollout, told):
    step, numbers, rewards, allowed, action, memory = told
    t = rollout.rows[0]
    if allowed is not None:
        allowed[0][:, 0] = True
    rollout.mask(allowed)
    push_frames(rollout.observations[t], numbers, step, rollout.observations[t + 1])
    pictures = (numbers * 255).astype(np.uint8).reshape(LANES, 1, 1, 1).repeat(2, 2)
    for history in rollout.histories:
        sources, after, new = history.push(t, slice(None), pictures)
        push_frames(sources, new, step, after)
    rollout.put(action, action.log_probs, np.where(rollout.deciding[t][:, None], memory, rollout.memory[t]))
    rollout.store(step, rewards)


def learned(steps, told, *, saved=False):
    """Return what is learned from in rollouts of so many steps: a line for each decision, of each lane in order."""
    rollout = make_rollout(steps)
    rollout.begin(Observation(np.zeros((LANES, 1), np.float32), (np.ones((LANES, 1, 2, 1), np.uint8),)), None)
    lines: list[tuple[int, list[float]]] = []
    for begin in range(0, LENGTH, steps):
        for one in told[begin : begin + steps]:
            play(rollout, one)
        rollout.close()
        decided = rollout.decided()
        if not decided.any():  # then nothing is learned
            rollout.restart()
            continue
        batch = rollout.batch(np.zeros(decided.shape, np.float32), decided, 1, normalize=False)
        rewards, ends = (array.T[decided.T] for array in (rollout.rewards, rollout.terminated))
        masks = np.zeros((len(rewards), 2)) if batch.masks is None else batch.masks.numpy()[:, 0]
        parts = [batch.observations.numbers, batch.continuous, batch.discrete, batch.log_probs[:, None]]
        parts += [batch.sequences.states, batch.values[:, None]]
        stacks = batch.observations.images[0].gather().reshape(len(rewards), -1)
        columns = [*(part.numpy() for part in parts), masks, stacks, rewards[:, None], ends[:, None]]
        lanes = np.nonzero(decided.T)[0]
        lines += zip(lanes.tolist(), np.concatenate(columns, axis=1).tolist(), strict=True)
        rollout.restart()
        if saved:
            rollout = copy_of(rollout, steps)
    return [line for lane in range(LANES) for number, line in lines if number == lane], rollout


def copy_of(rollout, steps):
    """Return the rollout that a checkpoint would bring back."""
    copy = make_rollout(steps)
    copy.observations[0], copy.deciding[0], copy.memory[0] = (
        array[0] for array in (rollout.observations, rollout.deciding, rollout.memory)
    )
    copy.histories[0].load(rollout.histories[0].window(0).gather())
    copy.take_carried(carried_from(rollout.carried.state()))
    return copy


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("steps", [1, 3, 4, 9])
@pytest.mark.parametrize("saved", [False, True])
def test_short_rollouts_learn_from_what_a_long_one_learns_from(seed, steps, saved):
    told = stream(seed)
    wanted, whole = learned(LENGTH, told)
    got, last = learned(steps, told, saved=saved)
    assert len(wanted) > LENGTH and got == wanted
    assert last.carried.lanes.tolist() == whole.carried.lanes.tolist()


def test_new_episodes_forget_what_is_carried():
    told = stream(0)
    _, rollout = learned(3, told)
    assert len(rollout.carried.lanes)
    rollout.begin(Observation(np.zeros((LANES, 1), np.float32), (np.ones((LANES, 1, 2, 1), np.uint8),)), None)
    assert not len(rollout.carried.lanes) and (rollout.pending == -1).all()


def test_a_damaged_checkpoint_is_refused():
    _, rollout = learned(3, stream(0))
    state = rollout.carried.state()

    def take(**changes):
        other = make_rollout(3)
        other.deciding[0] = rollout.deciding[0]
        other.take_carried(carried_from({name: a for name, a in (state | changes).items() if a is not None}))

    take()
    for name, change in {
        "lanes": state["lanes"] + LANES,
        "arrays.values": np.full_like(state["arrays.values"], np.nan),
        "arrays.observations": state["arrays.observations"][:, :1],
        "arrays.discrete": state["arrays.discrete"].astype(np.int32),
        "arrays.log_probs": None,
        "arrays.rewards": state["arrays.values"],
        "images.0": state["images.0"][:, :1],
    }.items():
        with pytest.raises(ValueError, match="do not fit"):
            take(**{name: change})
    state["lanes"] = np.flatnonzero(rollout.deciding[0])[:1].repeat(len(state["lanes"]))
    with pytest.raises(ValueError, match="do not fit"):
        take()
