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
from joybridge.viewer.clock import LOOK_SECONDS, interval, pause
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
    shown: dict[str, Any] = {}
    while True:
        shown = _show_curves(page, run, shown)
        try:
            with open_play(PlaySpec(run, reach(), seed=seed, only_game=only_game)) as play:
                _watch_arena(page, run, Watched(run, play, seed), shown)
        except JoybridgeError as error:
            page.send(json.dumps({"type": "lost", "text": str(error)}))
        pause(page, time.monotonic() + LOOK_SECONDS, True)


def _watch_arena(page: ServerConnection, run: Path, watched: Watched, shown: dict[str, Any]) -> None:
    page.send(game_message(watched))
    running, looked, due = True, time.monotonic(), time.monotonic()
    while True:
        running = pause(page, due, running)
        now = time.monotonic()
        if now > looked + LOOK_SECONDS:
            shown = _show_curves(page, run, shown)
            watched.renew()
            looked = now
        if running:
            watched.play()
            page.send(turn_message(watched, None, None, outputs=watched.outputs, timesteps=watched.timesteps))
            for picture in watched.pictures:
                page.send(encode_picture(picture))
        due = max(due, now) + interval(watched.spec) if running else now + LOOK_SECONDS


def _show_curves(page: ServerConnection, run: Path, shown: dict[str, Any]) -> dict[str, Any]:
    """Send the metrics of all policies, if they have changed; return them."""
    curves: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for path in sorted(run.glob("metrics-*.csv")):
        own = curves.setdefault(path.stem.removeprefix("metrics-"), {})
        for row in read_rows(path):
            for name, value in row.items():
                if name != "timesteps" and math.isfinite(value):
                    own.setdefault(name, []).append((row["timesteps"], value))
    if curves != shown:
        page.send(json.dumps({"type": "curves", "policies": curves}))
    return curves
