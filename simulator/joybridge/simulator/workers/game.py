"""Many arenas of a one-arena game as a BatchedGame whose arenas are stepped by several processes at once."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, ClassVar

from joybridge.contract.codec import ActArrays, Codec, Format, StepArrays, fill_act, lane_count
from joybridge.contract.sharding import join, part_of, split
from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import BatchedGame
from joybridge.simulator.workers.link import ACT, DISTRIBUTE, DRAW, OBSERVE, RESET, START
from joybridge.simulator.workers.process import WorkerProcess
from joybridge.v1 import bridge_pb2 as pb


def in_workers(game: type[BatchedGame], place: str, workers: int, seconds: float) -> type[BatchedGame]:
    """Return a game whose arenas are stepped by `workers` processes, each of which loads the game at its place.

    seconds: for each answer of a worker.
    """
    names = ("name", "description", "options")
    members: dict[str, Any] = {name: getattr(game, name) for name in names}
    members |= {"game": game, "place": place, "workers": workers, "seconds": seconds}
    return type(game.__name__, (WorkerGame,), members)


class WorkerGame(BatchedGame):
    """The arenas of one session, a contiguous range per worker. `in_workers` creates the subclass for a game."""

    game: ClassVar[type[BatchedGame]]
    place: ClassVar[str]
    workers: ClassVar[int]
    seconds: ClassVar[float]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the author's spec."""
        return cls.game.describe(options)

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Start the workers, and begin a first episode in every arena."""
        spec = self.describe(options)
        behaviors, parameters_of_game = spec.behaviors, len(spec.parameters)
        bounds = split(arenas, min(self.workers, arenas))
        ranges = [range(begin, end) for begin, end in pairwise(bounds)]
        self._lanes = [[lane_count(behavior, bound) for bound in bounds] for behavior in behaviors]
        self._codecs = [[Codec(behavior, len(each), parameters_of_game) for behavior in behaviors] for each in ranges]
        self._distributed = self.distributions  # what the workers draw from
        self.processes: list[WorkerProcess] = []
        common = {"options": dict(options), "parameters": dict(parameters), "seed": seed}
        try:
            for number, each in enumerate(ranges):
                self.processes.append(WorkerProcess(self.place, number, each, self.seconds))
            for process in self.processes:
                own = {"arenas": len(process.arenas), "first_arena": first_arena + process.arenas.start}
                process.send(START, common | own)
            self._wait()
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        self._distribute()
        for process in self.processes:
            process.send(RESET, {"seed": seed, "parameters": dict(parameters)})
        self._wait()

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        for process in self.processes:
            process.send(OBSERVE, b"")
        return self._receive()

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision."""
        self._distribute()
        for number, process in enumerate(self.processes):
            message = pb.Act()
            for act in part_of(acts, self._lanes, number):
                fill_act(message.behaviors.add(), act)
            process.send(ACT, message.SerializeToString())
        return self._receive()

    def draw(self, arena: int) -> Array:
        """Return the author's picture of one arena."""
        process = next(process for process in self.processes if arena in process.arenas)
        process.send(DRAW, {"arena": arena - process.arenas.start})
        tensor = pb.Tensor.FromString(process.receive())
        return Format(tensor.dtype, tuple(tensor.shape), "picture").unpack(tensor)

    def close(self) -> None:
        """End the workers."""
        for process in self.processes:
            process.let_go()
        for process in self.processes:
            process.end()

    def _distribute(self) -> None:
        """Tell the workers what parameters are drawn from, if the session has changed it."""
        if self.distributions is not self._distributed:
            self._distributed = self.distributions
            message = pb.Act(distributions=self.distributions).SerializeToString()
            for process in self.processes:
                process.send(DISTRIBUTE, message)
            self._wait()

    def _wait(self) -> None:
        for process in self.processes:
            process.receive()

    def _receive(self) -> list[StepArrays]:
        """Return the step of all arenas. Raises GameError."""
        parts = []
        for process, codecs in zip(self.processes, self._codecs, strict=True):
            behaviors = pb.Step.FromString(process.receive()).behaviors
            parts.append([codec.unpack_step(step) for codec, step in zip(codecs, behaviors, strict=True)])
        return join(parts)
