"""How many learners a run has. Needs no torch."""

from dataclasses import dataclass

from joybridge.trainer.config import Config
from joybridge.trainer.errors import ConfigError


@dataclass(frozen=True)
class Learners:
    """How many learners a run has, and where those beside the trainer are."""

    count: int = 1  # with the trainer
    cluster: str = ""  # HOST:PORT of a Ray cluster on whose nodes they are; "": here
    wait: float = 60.0  # seconds to wait for free cores of the cluster

    def arguments(self) -> list[str]:
        """Return the options of the command line that say how many; --ray is one of the simulators."""
        return ["--learners", f"{self.count}"] if self.count > 1 else []

    def check(self, config: Config) -> None:
        """Raise ConfigError for a configuration that only one learner can train."""
        if self.count > 1 and config.accelerator != "cpu":
            raise ConfigError(f"accelerator is {config.accelerator}, but --learners share only processors; set cpu")
        if self.count > 1 and config.demonstrations is not None:
            raise ConfigError("demonstrations cannot be cloned by several learners; leave out --learners")
