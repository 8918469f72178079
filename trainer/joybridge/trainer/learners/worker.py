"""A learner beside the trainer: `python -m joybridge.trainer.learners.worker HOST:PORT`, the place of their store.

Prints READY once torch is loaded. Then it takes part in all updates of the run, until its standard input closes.
"""

import os
import sys
from threading import Thread

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict

from joybridge.contract.address import READY
from joybridge.contract.codec import lane_count
from joybridge.contract.errors import JoybridgeError
from joybridge.trainer.actor import Actor, make_actors
from joybridge.trainer.config import Config
from joybridge.trainer.errors import DivergedError, LearnerError
from joybridge.trainer.learners.group import FOREVER, Group, Store, TCPStore, answer_presence, own_address
from joybridge.trainer.learners.message import Replica, Update, receive_update
from joybridge.trainer.policy import SHUFFLES, random_numbers
from joybridge.trainer.ppo.rollout import RolloutBuffer
from joybridge.trainer.ppo.schedule import Coefficients
from joybridge.trainer.ppo.shared import SharedGradient
from joybridge.trainer.ppo.update import Learner, ppo_update
from joybridge.trainer.threads import use_one_thread
from joybridge.v1 import bridge_pb2 as pb

# Keys of the store; the last is that of a learner, which writes there why it cannot take part, or nothing.
RUN, JOINED, PREPARED = "run", "joined", "prepared {}"


class Run(BaseModel):
    """What a learner must know of a run, as JSON in the store."""

    model_config = ConfigDict(ser_json_bytes="base64", val_json_bytes="base64")

    torch: str  # version
    learners: int
    config: Config
    spec: bytes  # of the game


def main() -> None:
    """Run the program."""
    Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    host, _, port = sys.argv[1].rpartition(":")
    print(READY, flush=True)
    try:
        take_part(TCPStore(host, int(port), timeout=FOREVER), host, int(port))
    except (JoybridgeError, RuntimeError) as error:  # the trainer knows, or is gone
        sys.exit(f"a learner ends: {error}")


def take_part(store: Store, host: str, port: int) -> None:
    """Take part in all updates of the run whose trainer is at a store. Raises LearnerError in the end."""
    number = store.add(JOINED, 1)
    try:
        replicas, count = prepare(store)
    except Exception as error:  # what is wrong here is for the trainer to say
        store.set(PREPARED.format(number), f"{error}" or type(error).__name__)
        raise LearnerError(f"{error}") from None
    answer_presence(host, port, number)
    store.set(PREPARED.format(number), "")
    group = Group(store, number, count, own_address(host, port), FOREVER.total_seconds())
    for replica in replicas:
        replica.learner.gradient = SharedGradient(replica.learner, group.add_up)
    while True:
        learn(receive_update(group, replicas))


def prepare(store: Store) -> tuple[list[Replica], int]:
    """Return the policies of a run, and how many learners it has. Raises LearnerError and ConfigError."""
    run = Run.model_validate_json(store.get(RUN))
    if run.torch != torch.__version__:
        raise LearnerError(f"torch {torch.__version__} is installed, but the trainer has {run.torch}; install that")
    spec = pb.GameSpec.FromString(run.spec)
    actors = make_actors(run.config, spec)
    lanes = [lane_count(spec.behaviors[actor.behavior], run.config.arenas) for actor in actors]
    return [replicate(actor, count) for actor, count in zip(actors, lanes, strict=True)], run.learners


def replicate(actor: Actor, lanes: int) -> Replica:
    """Return a policy that learns from shares of the experience of so many lanes."""
    learner = Learner(
        actor.name, actor.network, branches=actor.branches, gaussians=actor.gaussians, autograd=actor.config.autograd,
        threads=actor.config.threads,
    )  # fmt: skip
    # An update of one row, so that what is compiled at its first call is no delay later.
    one = RolloutBuffer(1, [slice(0, 1)], actor.observation_size, actor.layout.space)
    batch = one.batch(np.zeros((1, 1), np.float32), np.ones((1, 1), bool))
    learner.gradient(batch, torch.arange(1), Coefficients(0.0, 0.0, 0.0))
    return Replica(actor, learner, actor.config.rollout_steps * lanes)


def learn(update: Update) -> None:
    """Do what the trainer does at the same time."""
    actor, config = update.replica.actor, update.replica.actor.config
    try:
        ppo_update(
            update.replica.learner, update.shard, update.coefficients,
            epochs=config.epochs, minibatch_size=config.minibatch_size,
            rng=random_numbers(actor.seed, update.updates, SHUFFLES),
            max_grad_norm=config.max_grad_norm, target_kl=config.target_kl,
        )  # fmt: skip
    except DivergedError:  # the trainer says so
        return


def _end_with_parent() -> None:
    """End this process once its standard input, on which nothing is ever written, closes."""
    while os.read(0, 1024):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
