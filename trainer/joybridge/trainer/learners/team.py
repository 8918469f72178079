"""The trainer's side of learning with others: it starts them, and shares its updates with them."""

import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import timedelta

import torch

from joybridge.trainer.config import Config
from joybridge.trainer.errors import LearnerError, LearnerLost
from joybridge.trainer.learners.choice import Learners
from joybridge.trainer.learners.group import Group, Store, TCPStore, own_address
from joybridge.trainer.learners.message import send_update
from joybridge.trainer.learners.worker import PREPARED, RUN, Run
from joybridge.trainer.policy import Policy
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.schedule import Coefficients
from joybridge.trainer.ppo.shared import Shard, SharedGradient
from joybridge.trainer.wire.cluster import cluster_learners
from joybridge.trainer.wire.errors import SimulatorLost
from joybridge.trainer.wire.launch import learner_processes
from joybridge.v1 import bridge_pb2 as pb

LOOPBACK = "127.0.0.1"
PREPARING = 4.0  # times the time limit of an operation, as for the first step of a game: something may be compiled
COMPILED, JUDGED = 1, 3  # updates after which everything is compiled, and learners are judged


class Team:
    """The learners of a run while it is trained, for the trainer."""

    def __init__(self, group: Group, policies: Sequence[Policy], say: Callable[[str], None]) -> None:
        """Let the policies learn with a group. say: called with a remark if one learner would be faster."""
        self.group, self.policies, self.say = group, policies, say
        self.gradients = [SharedGradient(policy.learner, group.add_up) for policy in policies]
        for policy, gradient in zip(policies, self.gradients, strict=True):
            policy.learner.gradient = gradient
        self.sending = 0.0  # seconds so far
        self.updates = 0

    def share(self, policy: Policy, batch: Batch, coefficients: Coefficients) -> Shard:
        """Give all learners their rows of a batch; return those of the trainer. Raises LearnerLost."""
        self._judge()
        begin = time.perf_counter()
        number = self.policies.index(policy)
        shard = send_update(self.group, number, policy.updates, policy.learner, batch, coefficients)
        self.sending += time.perf_counter() - begin
        self.updates += 1
        return shard

    def _judge(self) -> None:
        """Once, compare the time of updates with that of one learner, which is estimated."""
        if self.updates == COMPILED:
            self.sending = 0.0
            for gradient in self.gradients:
                gradient.computing = gradient.waiting = 0.0
        elif self.updates == JUDGED:
            computing = sum(gradient.computing for gradient in self.gradients)
            others = self.sending + sum(gradient.waiting for gradient in self.gradients)
            if (ratio := (computing + others) / (computing * self.group.count)) > 1:
                self.say(
                    f"{self.group.count} learners take {ratio:.1f} times as long for an update as one; this network is "
                    "faster without --learners"
                )


@contextmanager
def open_team(
    learners: Learners, config: Config, spec: pb.GameSpec, policies: Sequence[Policy], say: Callable[[str], None]
) -> Iterator[Team | None]:
    """Start the learners beside the trainer, and yield all of them together; None if there are no others.

    They end with the block. Raises LearnerError if one cannot be started, and LearnerLost if one ends before it is
    ready.
    """
    learners.check(config)
    if learners.count == 1:
        yield None
        return
    host, _, port = learners.cluster.rpartition(":")
    host = own_address(host, int(port)) if host else LOOPBACK
    listening = socket.create_server((host, 0))
    port = listening.getsockname()[1]
    store = TCPStore(
        host, port, is_master=True, wait_for_workers=False, master_listen_fd=listening.detach(),
        timeout=timedelta(seconds=config.timeout_seconds),
    )  # fmt: skip
    run = Run(torch=torch.__version__, learners=learners.count, config=config, spec=spec.SerializeToString())
    store.set(RUN, run.model_dump_json())
    place, others = f"{host}:{port}", learners.count - 1
    with ExitStack() as started:
        try:
            if learners.cluster:
                started.enter_context(cluster_learners(learners.cluster, place, others, learners.wait))
            else:
                started.enter_context(learner_processes(place, others))
        except SimulatorLost as error:
            raise LearnerError(f"{error}") from None
        wait_for_learners(store, learners.count, PREPARING * config.timeout_seconds)
        yield Team(Group(store, 0, learners.count, host, config.timeout_seconds), policies, say)


def wait_for_learners(store: Store, count: int, seconds: float) -> None:
    """Wait until all other learners are ready. Raises LearnerError if one cannot take part, and LearnerLost."""
    for number in range(1, count):
        try:
            store.wait([PREPARED.format(number)], timedelta(seconds=seconds))
        except RuntimeError:
            raise LearnerLost(f"learner {number} of {count} was not ready within {seconds:g} s") from None
        if reason := store.get(PREPARED.format(number)).decode():
            raise LearnerError(f"learner {number} of {count} cannot take part: {reason}")
