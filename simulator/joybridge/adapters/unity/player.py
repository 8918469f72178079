"""One player: how it is greeted, and its steps."""

from collections.abc import Iterable, Mapping

from joybridge.adapters.unity.communicator import Communicator
from joybridge.adapters.unity.forms import check_actions
from joybridge.adapters.unity.process import PlayerProcess
from joybridge.adapters.unity.settings import UnitySettings
from joybridge.contract.versions import own_version
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.side_channels import Payload
from joybridge.mlagents.wire import VERSION, CommunicatorError, capabilities, check_version
from joybridge.simulator.batched_game import GameError


class UnityPlayer:
    """A player at a port."""

    def __init__(self, settings: UnitySettings, communicator: Communicator, process: PlayerProcess | None) -> None:
        """Take a communicator that listens. process: None for a player that is started by hand."""
        self.settings, self.communicator, self.process = settings, communicator, process
        self.announced: dict[str, ml.BehaviorParameters] = {}
        self.seed = 0
        self.unused: ml.PlayerStep | None = None  # the answer to the first reset, if nothing was played since
        self._told = False  # about the engine

    def greet(self, seed: int, areas: int) -> None:
        """Wait for the player and agree about the version. Raises GameError."""
        link = self.communicator
        first = link.receive(self.settings.start, self._fate).from_player
        while not first.HasField("hello"):  # it is from a session that has ended
            link.dismiss()
            first = link.receive(self.settings.start, self._fate).from_player
        try:
            check_version(first.hello.communication_version, f"the player at port {link.port}")
        except CommunicatorError as error:
            link.dismiss()
            raise GameError(str(error)) from error
        self.seed = seed
        answer = ml.TrainerHello(
            seed=seed,
            communication_version=VERSION,
            package_version=own_version().product.removeprefix("joybridge "),
            capabilities=capabilities(),
            num_areas=areas,
        )
        link.answer(ml.FromTrainer(hello=answer))
        link.receive(self.settings.start, self._fate)

    def ask_reset(self, parameters: Mapping[str, float]) -> None:
        """Ask for new episodes with values of environment parameters. Raises GameError."""
        payloads = [side_channels.parameter(name, value) for name, value in parameters.items()]
        if not self._told:
            payloads = [*engine(self.settings), *payloads]
            self._told = True
        self.send(ml.TrainerStep(command=ml.RESET, side_channels=side_channels.join(payloads)))

    def send(self, step: ml.TrainerStep) -> None:
        """Send a step. Raises GameError if the player has gone."""
        self.unused = None
        self.communicator.answer(ml.FromTrainer(step=step))

    def receive(self) -> ml.PlayerStep:
        """Return what happened in the player. Raises GameError."""
        content = self.communicator.receive(self.settings.wait, self._fate).from_player
        for one in content.hello.behaviors:
            check_actions(one)
            self.announced[one.name] = one
        return content.step

    def end(self) -> None:
        """Dismiss the player; one that was started here ends."""
        if self.process is None:
            self.communicator.dismiss()
        else:
            self.communicator.close()
            self.process.end()

    def _fate(self) -> str:
        return self.process.fate() if self.process else ""


def engine(settings: UnitySettings) -> Iterable[Payload]:
    """Yield the settings of the engine."""
    yield side_channels.resolution(settings.width, settings.height)
    yield side_channels.engine(side_channels.QUALITY, settings.quality)
    yield side_channels.time_scale(settings.time_scale)
    yield side_channels.engine(side_channels.TARGET_FRAME_RATE, settings.target_frame_rate)
    yield side_channels.engine(side_channels.CAPTURE_FRAME_RATE, settings.capture_frame_rate)
