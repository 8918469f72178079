"""When a run is saved: at intervals of time or of timesteps, at its end, and when it was never better."""

import time
from pathlib import Path

from joybridge.client.signals import uninterrupted
from joybridge.config.config import Config
from joybridge.run.checkpoint import best_score
from joybridge.run.run_state import RunState


class Saver:
    """Writes checkpoints of the states that a run reaches."""

    def __init__(self, run: Path, config: Config, state: RunState) -> None:
        """Begin with the state that the run continues from, which need not be saved."""
        self._run, self._config, self._state = run, config, state
        self._saved, self._saved_at = state.timesteps, time.monotonic()
        self._highest = best_score(run)
        self._best: RunState | None = None  # not saved yet

    def take(self, state: RunState) -> None:
        """Take the next state, and save it if it is time. Raises StorageError."""
        self._state = state
        if state.score is not None and (self._highest is None or state.score > self._highest):
            self._highest, self._best = state.score, state
        late = time.monotonic() - self._saved_at >= self._config.checkpoint_seconds
        if late or state.timesteps - self._saved >= self._config.checkpoint_interval:
            self._save()
            self._saved, self._saved_at, self._best = state.timesteps, time.monotonic(), None

    def finish(self) -> None:
        """Save the last state. Raises StorageError."""
        if self._state.timesteps:
            with uninterrupted():
                self._save()

    def _save(self) -> None:
        """Save the best state, then the last: a run that is killed in between finds the best one again.

        If there is no room for the best one, the last one is saved all the same. Raises StorageError.
        """
        try:
            if self._best is not None:
                self._best.save_as_best(self._run)
        finally:
            self._state.save(self._run, self._config.keep_checkpoints)
