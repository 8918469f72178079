"""What stands between an environment and its simulator: the session, and who plays in which of its lanes."""

import weakref
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded

from joybridge.contract.spec import MAX_PICTURES, choose_parameters
from joybridge.contract.tensors import Array
from joybridge.gym.lanes import Lanes, Player
from joybridge.trainer.layouts import list_roles, make_acts
from joybridge.trainer.wire.client import Session
from joybridge.trainer.wire.launch import simulator_process

TURN_BASED_FPS = 5.0  # of games without a clock


class Bridge:
    """What all environments share: a session, the simulator behind it where it is one's own, the players."""

    def __init__(
        self,
        game: str,
        *,
        single: bool,
        split: bool,
        arenas: int = 1,
        layout: str = "bucket-11",
        frame_stack: int = 3,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        simulator: str | None = None,
        reward_weights: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open the session, as BridgeVectorEnv says.

        split: one player per agent, not one per policy in all lanes. single: there may be one player only, and
        `reward_weights` are its; otherwise they are per player.
        """
        if frame_stack < 1:
            raise ValueError(f"frame_stack is {frame_stack}, expected at least 1")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode is {render_mode!r}, expected None or 'rgb_array'")
        seed = _check_seed(seed)
        with ExitStack() as resources:
            address = simulator or resources.enter_context(simulator_process())
            self.session = resources.enter_context(
                Session(address, game, arenas=arenas, seed=seed, options=options, parameters=parameters)
            )
            self.spec = self.session.spec
            self.lanes = [Lanes(behavior, frame_stack) for behavior in self.spec.behaviors]
            self.players = self._make_players(layout, reward_weights or {}, single, split)
            self.pictures: list[Array] = []  # of all arenas after the last step
            self.drawn = self._choose_drawn(render_mode)
            self.fresh = True  # all episodes have begun and none has been played
            self.playing = False
            # Called by `close`, when the environment is collected, or at the interpreter's end; once.
            self.close = weakref.finalize(self, resources.pop_all().close)

    def _make_players(
        self, layout: str, reward_weights: Mapping[str, Any], single: bool, split: bool
    ) -> dict[str, Player]:
        """Return the players by name. Raises ValueError."""
        planned = {}
        for policy, behavior, hand in list_roles(layout, self.spec):
            lanes = self.lanes[behavior]
            agents = lanes.behavior.agents_per_arena if split else 1
            for agent in range(agents):
                rows = slice(agent, agent + 1) if agents > 1 else slice(None)
                planned[f"{policy}_{agent}" if agents > 1 else policy] = (lanes, rows, hand)
        if single and len(planned) > 1:
            raise ValueError(
                f"{self.spec.name} with layout {layout!r} is played by {len(planned)} ({', '.join(planned)}) and this "
                "environment is for one; use joybridge.gym.BridgeParallelEnv"
            )
        for name in () if single else reward_weights:
            if name not in planned:
                raise ValueError(f"reward_weights: there is no agent {name!r}; there are {', '.join(planned)}")
        return {
            name: Player(
                *plan,
                reward_weights if single else reward_weights.get(name, {}),
                "actions" if single else f"actions[{name!r}]",
            )
            for name, plan in planned.items()
        }

    def _choose_drawn(self, render_mode: str | None) -> range:
        """Return the arenas to draw. Raises ValueError where they cannot be."""
        if render_mode is None:
            return range(0)
        if not self.spec.HasField("picture"):
            raise ValueError(f"{self.spec.name} cannot be drawn: its spec has no picture; leave out render_mode")
        if self.session.arenas > MAX_PICTURES:
            raise ValueError(f"render_mode: {self.session.arenas} arenas, at most {MAX_PICTURES} can be drawn")
        return range(self.session.arenas)

    def metadata(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """Return an environment's metadata with the game's frames per second."""
        seconds = self.spec.tick_seconds * self.spec.decision_interval
        return {**known, "render_fps": 1.0 / seconds if seconds else TURN_BASED_FPS}

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> int | None:
        """Begin new episodes everywhere; return the seed as Python's int. Raises ValueError."""
        self._require_open()
        seed = None if seed is None else _check_seed(seed)
        if seed is not None or parameters or not self.fresh:
            chosen = choose_parameters(self.spec.parameters, parameters, self.spec.name)
            self.session.reset(seed, chosen)
            self.pictures = []
        self.fresh, self.playing = False, True
        for lanes, step in zip(self.lanes, self.session.steps, strict=True):
            lanes.begin(step)
        return seed

    def play(self, moves: Iterable[tuple[Player, Any]]) -> None:
        """Advance every arena by one decision; lanes without a move rest. Raises ValueError."""
        self._require_open()
        if not self.playing:
            raise ResetNeeded("no episode is being played; call reset first")
        acts = make_acts(self.spec, self.session.arenas)
        for lanes, act in zip(self.lanes, acts, strict=True):
            for column, mask in enumerate(lanes.step.masks or ()):
                act.choices[:, column] = mask.argmax(axis=1)  # the first that is allowed
        for player, actions in moves:
            player.write(actions, acts[self.lanes.index(player.lanes)])
        if self.drawn:
            steps, self.pictures = self.session.step_and_draw(acts, self.drawn)
        else:
            steps = self.session.step(acts)
        for lanes, step in zip(self.lanes, steps, strict=True):
            lanes.push(step)
        self.fresh = all((step.terminated | step.truncated).all() for step in steps)

    def picture(self) -> Array | None:
        """Return the only arena's picture, as BridgeEnv says."""
        if not self.drawn:
            return None
        size = (self.spec.picture.height, self.spec.picture.width, 3)
        return self.pictures[0].copy() if self.pictures else np.zeros(size, np.uint8)

    def _require_open(self) -> None:
        if not self.close.alive:
            raise ClosedEnvironmentError("the environment is closed; make a new one")


def _check_seed(seed: Any) -> int:
    """Return a seed as Python's int. Raises ValueError for one that the contract does not carry."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed!r}, expected one int of 0..2^64-1, which fixes the games of all arenas")
    return int(seed)
