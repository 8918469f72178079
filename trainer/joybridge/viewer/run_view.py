"""A run in training, as a page shows it: its learning curves, and its newest policies at play. Needs torch.

It only reads the folder of the run, and plays at a simulator of its own, so the training neither changes nor waits.
"""

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from websockets.sync.server import ServerConnection

from joybridge.config.errors import CheckpointError
from joybridge.config.game_settings import fixed
from joybridge.config.metrics import read_rows
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.play.playing import Play, PlaySpec, open_play
from joybridge.play.pointer_marks import mark_pointers
from joybridge.play.policy_outputs import policy_outputs
from joybridge.policy.actor import policy_state
from joybridge.run.checkpoint import checkpoints
from joybridge.run.run_state import load_state
from joybridge.viewer.arena import Settings
from joybridge.viewer.clock import LOOK_SECONDS, Pace, interval
from joybridge.viewer.messages import encode_picture, game_message, turn_message
from joybridge.viewer.scores import Scores


class Watched:
    """One arena in which the newest policies of a run play; it has what a page shows of an `Arena`."""

    def __init__(self, run: Path, play: Play, seed: int) -> None:
        """Play in an open session."""
        self._run, self._play = run, play
        self.spec = play.spec
        self.settings = Settings(seed, dict(play.config.options), fixed(play.config.parameters))
        self.scores = Scores(play.spec)
        self.acts, self.steps = make_acts(play.spec, 1), play.session.steps
        self.turn = 0
        self.timesteps = play.timesteps
        self.pictures: list[Array] = []
        self.outputs: list[dict[str, Any]] = []
        self._view = play.view()
        self._decisions = play.decisions(1 if play.spec.HasField("picture") else 0)

    def play(self) -> None:
        """Play one decision. Raises SimulatorError."""
        self.outputs = [policy_outputs(player, self.spec, self.steps) for player in self._play.players]
        played = next(self._decisions)
        self.turn += 1
        self.acts, self.steps = played.acts, played.after
        remembered = self._play.remembered()
        marked = [mark_pointers(picture, self.spec, played.acts) for picture in played.pictures]
        self.pictures = [self._view.beside(picture, played.after, remembered) for picture in marked]
        self.scores.take(played.after)

    def renew(self) -> None:
        """Take the newest checkpoint, if there is a newer one that is whole."""
        saved = checkpoints(self._run)
        if saved and int(saved[-1].name) > self.timesteps:
            try:
                state = load_state(self._run)
                for player in self._play.players:
                    player.actor.load(policy_state(state.arrays, player.actor.name))
            except CheckpointError:  # it is being replaced
                return
            self.timesteps = state.timesteps


def watch(page: ServerConnection, run: Path, reach: Callable[[], str], seed: int, only_game: str = "") -> None:
    """Show a run to a page until the page goes away, which raises ConnectionClosed.

    reach: returns the address of a simulator that answers. Before there is a checkpoint, only the curves are shown.
    only_game: which of several games is played; "": the first.
    """
    pace, curves = Pace(page), Curves(page, run)
    while True:
        try:
            curves.show()
            with open_play(PlaySpec(run, reach(), seed=seed, only_game=only_game)) as play:
                _watch_arena(page, pace, Watched(run, play, seed), curves)
        except JoybridgeError as error:
            page.send(json.dumps({"type": "lost", "text": str(error)}))
        pace.wait(time.monotonic() + LOOK_SECONDS)


def _watch_arena(page: ServerConnection, pace: Pace, watched: Watched, curves: "Curves") -> None:
    page.send(game_message(watched))
    looked = due = time.monotonic()
    while True:
        pace.wait(due)
        now = time.monotonic()
        if now > looked + LOOK_SECONDS:
            curves.show()
            watched.renew()
            looked = now
        if pace.running:
            watched.play()
            page.send(turn_message(watched, None, None, outputs=watched.outputs, timesteps=watched.timesteps))
            for picture in watched.pictures:
                page.send(encode_picture(picture))
        due = max(due, now) + interval(watched.spec) if pace.running else now + LOOK_SECONDS


class Curves:
    """The metrics of all policies of a run, as a page shows them."""

    def __init__(self, page: ServerConnection, run: Path) -> None:
        """Show nothing yet."""
        self._page, self._run = page, run
        self._shown: dict[str, dict[str, list[tuple[float, float]]]] = {}

    def show(self) -> None:
        """Send them, if they have changed. Raises CheckpointError for a file that is no file of metrics."""
        curves: dict[str, dict[str, list[tuple[float, float]]]] = {}
        for path in sorted(self._run.glob("metrics-*.csv")):
            own = curves.setdefault(path.stem.removeprefix("metrics-"), {})
            for row in read_rows(path):
                for name, value in row.items():
                    if name != "timesteps" and math.isfinite(value):
                        own.setdefault(name, []).append((row["timesteps"], value))
        if curves != self._shown:
            self._page.send(json.dumps({"type": "curves", "policies": curves}))
            self._shown = curves
