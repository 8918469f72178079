"""Measures of the behavior of trained policies that the paper describes in words.

python -m tools.paper.behavior RUN [RUN …]    adds to results/behavior.json and draws figures/behavior.png beside it

Plays each run for one time limit of the game, with actions sampled as in training. The measures are computed from
sensors, pressed buttons and metrics, by their names. The same seed gives the same measures.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.client.client import SimulatorError
from joybridge.client.launch import simulator_process
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.contract.tensors import Array
from joybridge.play.playing import PlaySpec, open_play
from joybridge.run.folder import run_config
from tools.paper.behavior_figure import draw
from tools.paper.birds import measure_birds, watch
from tools.paper.triangles import is_triangle, laps

Measures = dict[str, Any]  # of one run, as in the JSON file

# Shooting Birds, units/s: the unit of the crosshair's speed sensor, its top speed.
TOP_SPEED = 50.0
# Beastly Rivals, game units (meters): the unit of the position sensors, and the slow sphere's radius.
PLACE_UNIT, SPHERE_RADIUS = 7.0, 3.0
WINDOW_SECONDS = 10.0  # of the lap radius: the character walks 40 m, about one lap or more
FEWEST_EPISODES = 3  # that must last through a window for its lap radius to count


@dataclass(frozen=True)
class Trace:
    """Sensors, actions and ends of episodes of all lanes of one behavior, decision by decision."""

    seconds: float  # game time of a decision
    sensors: dict[str, Array]  # by name [decisions, lanes, *shape]: before the decision
    pressed: dict[str, Array]  # by button, bool [decisions, lanes]
    ended: Array  # bool [decisions, lanes]: whether the episode ended with the decision
    metrics: dict[str, Array]  # by name [decisions, lanes]: of episodes that ended with the decision, else NaN
    groups: int = 1  # number of equally large blocks of lanes, each played with other options

    def episodes(self) -> list[tuple[slice, int]]:
        """Return every finished episode as its decisions and its lane."""
        ends = [[0, *(np.flatnonzero(column) + 1).tolist()] for column in self.ended.T]
        return [(slice(*pair), lane) for lane, column in enumerate(ends) for pair in pairwise(column)]


def shooting_birds(trace: Trace) -> Measures:
    """Measure how the crosshair moves (units/s) and how often and how well it shoots."""
    _, _, right, up, speed = np.moveaxis(
        trace.sensors["crosshair"], -1, 0
    )  # a unit vector and a fraction of the top speed
    shots = trace.pressed["shoot"] & (trace.sensors["gun"][..., 0] > 0)  # an empty gun does not shoot
    pauses = [pause for episode in trace.episodes() for pause in np.diff(np.flatnonzero(shots[episode]))]
    hits = trace.metrics["hits"]
    return {
        "abs_vx": _mean(abs(right * speed) * TOP_SPEED),
        "abs_vy": _mean(abs(up * speed) * TOP_SPEED),
        "seconds_between_shots": _mean(np.multiply(pauses, trace.seconds)),
        "hits_per_level": [_mean(block) for block in np.split(hits, trace.groups, axis=1)],
        "click_accuracy": _mean(trace.metrics["click_accuracy"]),
    }


def beastly_rivals(trace: Trace) -> Measures:
    """Measure the character's laps, the clicks, the survival and the time in the slow sphere.

    slow_share is the fraction of decisions in which the character's center is in the sphere, even where the sphere does
    not slow it. slow_share_by_chance is the same with the sphere of another arena, which a policy cannot observe.
    """
    places = trace.sensors["character"][..., :2] * PLACE_UNIT
    spheres = places - trace.sensors["slow_sphere"][..., :2] * PLACE_UNIT
    return {
        "lap_radius": lap_radius(trace, places),
        "commands_per_decision": _mean(trace.pressed["move"] | trace.pressed["blink"]),
        "blinks_per_episode": _mean(trace.metrics["blinks"]),
        "slow_share": _mean(_near(places, spheres)),
        "slow_share_by_chance": _mean(_near(places, np.roll(spheres, 1, axis=1))),
        "survival_seconds": _mean(trace.metrics["survival"] * trace.seconds),
        "clocks_survived": _mean(trace.ended.sum(axis=0) == 1),  # only once, by the clock
        **triangles(trace),
    }


def triangles(trace: Trace) -> Measures:
    """Return which fraction of the cursor's laps are triangles, in the first and in the last third of the time limit.

    None if fewer than FEWEST_EPISODES episodes have laps there.
    """
    cursor, third = trace.sensors["cursor"][..., :2] * PLACE_UNIT, len(trace.ended) // 3
    measures: Measures = {}
    for name, part in (("early_triangles", slice(third)), ("late_triangles", slice(2 * third, None))):
        paths = [list(laps(cursor[episode][part], trace.seconds)) for episode in trace.episodes()]
        found = [answer for path in paths for lap in path if (answer := is_triangle(lap)) is not None]
        measures[name] = _mean(found) if sum(map(bool, paths)) >= FEWEST_EPISODES else None
    return measures


def lap_radius(trace: Trace, places: Array) -> list[list[float]]:
    """Return [middle of a window in seconds of episode time, radius], window after window.

    The radius is the radius of gyration: the root mean square distance of `places` [decisions, lanes, 2] to their own
    center within the window. For about a whole lap on a circle it is the circle's radius. It is the mean over the
    episodes that lasted through the window, as long as there are FEWEST_EPISODES. The list ends there.
    """
    episodes = [places[episode] for episode in trace.episodes()]
    points: list[list[float]] = []
    for window in count():
        first, last = (round(edge * WINDOW_SECONDS / trace.seconds) for edge in (window, window + 1))
        alive = [episode[first:last] for episode in episodes if len(episode) >= last]
        if len(alive) < FEWEST_EPISODES:
            return points
        points.append([(window + 0.5) * WINDOW_SECONDS, _mean([_gyration(path) for path in alive])])
    return points


def _gyration(path: Array) -> float:
    return math.sqrt(np.square(path - path.mean(axis=0)).sum(axis=1).mean())


def _near(places: Array, spheres: Array) -> Array:
    """Return whether the places [..., 2] are in the slow spheres around those centres."""
    return np.asarray(np.linalg.norm(places - spheres, axis=-1) < SPHERE_RADIUS)


def _mean(values: Any) -> Any:
    """Return the rounded mean of all values but NaN, or None if there is none."""
    known = np.asarray(values, float)
    known = known[~np.isnan(known)]
    return round(float(known.mean()), 4) if len(known) else None


GAMES: dict[str, Callable[[Trace], Measures]] = {"shooting_birds": shooting_birds, "beastly_rivals": beastly_rivals}


def measure(run: Path, address: str, *, episodes: int, seed: int) -> tuple[str, Measures]:
    """Play at least `episodes` episodes of a run. Return "GAME/FOLDER" and the measures.

    The name of the game is dropped from a folder named GAME-LAYOUT-sSEED. Raises SimulatorError, CheckpointError or
    ConfigError.
    """
    config = run_config(run)
    if config.game not in GAMES:
        raise ConfigError(f"{run} plays {config.game}; behavior is measured in {' and '.join(GAMES)}")
    trace, timesteps = play(run, address, episodes=episodes, seed=seed)
    measures = GAMES[config.game](trace)
    if config.game == "shooting_birds":
        measures |= measure_birds(watch(run, episodes=episodes, seed=seed))
    measures |= {"timesteps": timesteps, "episodes": int(trace.ended.sum())}
    return f"{config.game}/{run.resolve().name.removeprefix(f'{config.game}-')}", measures


def play(run: Path, address: str, *, episodes: int, seed: int) -> tuple[Trace, int]:
    """Play one time limit in enough arenas. Return the trace and the timesteps of the policy's training.

    With `stratify_by` in the configuration, the choices of that option are the groups of the trace. Raises the same
    errors as `measure`.
    """
    with open_play(PlaySpec(run, address, seed=seed), episodes=episodes, arenas_limit=episodes) as played:
        spec = played.spec
        behavior, decisions = spec.behaviors[0], spec.max_episode_decisions
        shape = (decisions, played.arenas)
        trace = Trace(
            seconds=spec.tick_seconds * spec.decision_interval,
            sensors={sensor.name: np.empty((*shape, *sensor.shape), np.float32) for sensor in behavior.sensors},
            pressed={branch.name: np.empty(shape, bool) for branch in behavior.device.branches},
            ended=np.empty(shape, bool),
            metrics={metric.name: np.full(shape, np.nan) for metric in behavior.metrics},
            groups=len(played.choices),
        )
        for t, decision in enumerate(islice(played.decisions(), decisions)):
            step = decision.after[0]
            _fill(trace.sensors.values(), t, decision.before[0].observations)
            _fill(trace.pressed.values(), t, decision.acts[0].choices.T == 1)
            trace.ended[t] = step.ends
            if step.metrics is not None:
                _fill(trace.metrics.values(), (t, trace.ended[t]), step.metrics.T)
        return trace, played.timesteps


def _fill(arrays: Iterable[Array], index: Any, columns: Iterable[Array]) -> None:
    for array, column in zip(arrays, columns, strict=True):
        array[index] = column


def add_measures(path: Path, name: str, measures: Measures) -> dict[str, Measures]:
    """Add a run to the file, unless the file holds a longer trained run of that name. Return the whole file.

    Raises ValueError if the file is not JSON.
    """
    known: dict[str, Measures] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if name not in known or known[name]["timesteps"] <= measures["timesteps"]:
        known[name] = measures
    else:
        print(f"{name}: kept the measures after {known[name]['timesteps']:,} timesteps", file=sys.stderr)
    lines = [f"{json.dumps(key)}: {json.dumps(known[key])}" for key in sorted(known)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return known


def show(known: dict[str, Measures]) -> None:
    """Print a table per game: a line per run, a column per measure, the first and the last value of lists."""
    for game in GAMES:
        rows = {name: entry for name, entry in sorted(known.items()) if name.startswith(f"{game}/")}
        names = list(dict.fromkeys(key for entry in rows.values() for key in entry))
        if rows:
            print(f"\n{game:<24}" + "".join(f"  {name:>{max(len(name), 11)}}" for name in names))
        for name, entry in rows.items():
            cells = (f"{_cell(entry.get(key)):>{max(len(key), 11)}}" for key in names)
            print(f"{name.removeprefix(f'{game}/'):<24}  " + "  ".join(cells))


def _cell(value: Any) -> str:
    if isinstance(value, list):
        flat = [item[-1] if isinstance(item, list) else item for item in value]
        return f"{_cell(flat[0])} … {_cell(flat[-1])}" if flat else "–"
    return "–" if value is None else f"{value:,}" if isinstance(value, int) else f"{value:.3g}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how trained policies play.")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument(
        "--episodes", type=int, default=70, help="least number of episodes of each run; default: %(default)s"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of the games and of action sampling; default: %(default)s"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("results/behavior.json"), help="JSON file to add to; default: %(default)s"
    )
    options = parser.parse_args(arguments)
    try:
        with simulator_process() as address:
            for run in options.runs:
                name, measures = measure(run, address, episodes=options.episodes, seed=options.seed)
                print(f"{run}: {name}, {measures['episodes']} episodes", file=sys.stderr, flush=True)
                known = add_measures(options.output, name, measures)
    except json.JSONDecodeError as error:
        print(f"error: {options.output} is not JSON ({error}); move it away to start a new file", file=sys.stderr)
        return 1
    except (CheckpointError, ConfigError, SimulatorError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    figure = options.output.parent / "figures" / "behavior.png"
    draw(known, figure)
    show(known)
    print(f"\n{options.output}, {figure}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
