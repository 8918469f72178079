"""What an episode pays, when it is over, and what a hook adds: rewards, sensors and metrics.

A hook is a Python file with any of these functions; each is given the program's main module:

    state(program)    numbers, which become the sensor "state"
    reward(program)   after each frame: a number, or a dictionary of reward channels
    done(program)     after each frame: whether the episode is over
    metrics(program)  at the end of an episode: a dictionary of numbers
"""

import math
import re
import runpy
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.adapters.pygame_programs.inside.rewards import Texts, reward_of
from joybridge.contract.tensors import Array

FUNCTIONS = ("state", "reward", "done", "metrics")
EARLY = " (rendered before the first frame; a text that is shown again and not rendered again needs a hook's done)"


class Score:
    """The reward channels, sensors and metrics of the program."""

    def __init__(
        self, texts: Texts, played: Counter[str], rewards: Mapping[str, str], done: Sequence[str], hook: str
    ) -> None:
        """rewards: by channel, see rewards.py. done: patterns of text. hook: a file, "" for none. Raises ValueError."""
        self.over = False
        self._sources = {name: reward_of(source, texts, played) for name, source in rewards.items()}
        self._wanted = {name: f"reward '{source}'" for name, source in rewards.items()}
        self._ends = dict.fromkeys(done, False)  # whether each pattern was found in this episode
        self._early = set[str]()  # patterns that were found before it
        for pattern in done:
            texts.search(pattern, partial(self._end_at, pattern))
        self._hook: dict[str, Callable[[Any], Any]] = {}
        if hook:
            if not Path(hook).is_file():
                raise ValueError(
                    f"there is no hook {hook}; its path is relative to the current folder, where the training was "
                    "started, or write one with `joybridge new --pygame PROGRAM`"
                )
            found = runpy.run_path(hook)
            self._hook = {name: found[name] for name in FUNCTIONS if name in found}
            if not self._hook:
                raise ValueError(f"{hook} has none of the functions {', '.join(FUNCTIONS)}")
        self.program: Any = None  # its main module, from the first look on
        self._earned = dict.fromkeys(rewards, 0.0)
        self._totals: dict[str, float] = {}  # of the episode, by channel
        self._sizes: dict[str, Any] = {}

    def look(self) -> dict[str, Any]:
        """Return the channels, the number of states and the metrics, after a first look at the program."""
        self.program = sys.modules["__main__"]
        if "reward" in self._hook:
            self._earned |= dict.fromkeys(self._hook_rewards(), 0.0)
        if not self._earned:
            self._earned = {"reward": 0.0}
        metrics = self._call("metrics", {})
        self._sizes = {"state": len(self.state()), "metrics": list(metrics)}
        totals = [f"{name}_total" for name in self._earned] if len(self._earned) > 1 else []
        return {"channels": list(self._earned), **self._sizes, "metrics": [*metrics, *totals]}

    def begin(self) -> None:
        """Begin an episode: what happened before is not paid."""
        self.take()
        self._totals = dict.fromkeys(self._earned, 0.0)
        self._early |= {pattern for pattern, found in self._ends.items() if found}
        self._ends = dict.fromkeys(self._ends, False)
        self.over = False

    def after_frame(self) -> None:
        """Look at the program at the end of a frame."""
        for source in self._sources.values():
            source.look()
        if "reward" in self._hook:
            for name, value in self._hook_rewards().items():
                if name not in self._earned:
                    raise KeyError(f"the hook's reward has the channel {name!r}, which its first result had not")
                self._earned[name] += value
        if "done" in self._hook and self._call("done", False):
            self._end()

    def take(self) -> list[float]:
        """Return the rewards since the last call, by channel."""
        for name, source in self._sources.items():
            self._earned[name] += source.take()
        earned = list(self._earned.values())
        self._totals = {name: self._totals.get(name, 0.0) + value for name, value in self._earned.items()}
        self._earned = dict.fromkeys(self._earned, 0.0)
        return earned

    def state(self) -> Array:
        """Return the numbers of the sensor "state", float32. Raises ValueError for other counts than at first."""
        state: Array = np.array(self._call("state", []), np.float32).ravel()
        if len(state) != self._sizes.setdefault("state", len(state)):
            raise ValueError(f"the hook's state has {len(state)} numbers, at first it had {self._sizes['state']}")
        if not np.isfinite(state).all():
            raise ValueError(f"the hook's state has {state[~np.isfinite(state)][0]}, expected finite numbers")
        return state

    def metrics(self) -> list[float]:
        """Return the values of the hook's metrics, and of several channels what each has paid since `begin`."""
        values = self._call("metrics", {})
        totals = list(self._totals.values()) if len(self._totals) > 1 else []
        own = [_finite(f"metric {name}", values.get(name, 0.0)) for name in self._sizes["metrics"]]
        return [*own, *totals]

    def missed(self) -> list[str]:
        """Return the rewards and ends that are looked for and were never found."""
        rewards = [self._wanted[name] for name, source in self._sources.items() if not source.found()]
        ends = [
            f"done '{pattern}'{EARLY if pattern in self._early else ''}"
            for pattern, found in self._ends.items()
            if not found
        ]
        return rewards + ends

    def _end_at(self, pattern: str, match: "re.Match[str]") -> None:
        self._ends[pattern] = True
        self._end()

    def _end(self) -> None:
        self.over = True

    def _hook_rewards(self) -> dict[str, float]:
        paid = self._call("reward", 0.0)
        rewards = paid if isinstance(paid, Mapping) else {"reward": paid}
        return {name: _finite(f"reward {name}", value) for name, value in rewards.items()}

    def _call(self, name: str, default: Any) -> Any:
        return self._hook[name](self.program) if name in self._hook else default


def _finite(what: str, value: Any) -> float:
    """Return a number of a hook. Raises ValueError if it is infinite or none."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"the hook's {what} is {number}, expected a finite number")
    return number
