"""How memory and time grow with the work, as a page of curves, and a model of scale from these figures.

python -m tools.scale [--output results/scale] [--timesteps N] [--redraw]

Writes figures.json, curves.png and README.md. --redraw makes the page again from figures.json, without measuring.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.metrics import Row
from joybridge.run.train import train
from joybridge.run.training import Audience
from tools.bench.measure import CONFIGS, GAMES, children, machine, megabytes, random_acts

ARENAS = (1, 4, 16, 64, 256, 1024, 4096)
SESSIONS = (1, 4, 16, 64)
SECONDS = 2.0  # of each point
CORES = (2, 10, 100, 1000)
LEARNERS = (1, 8)
GRADIENTS = 0.1  # assumed: what it costs to add the gradients of several learners, as a part of learning
TRAININGS = ("shooting_birds/bucket-11", "beastly_rivals/bucket-3")
Figures = dict[str, Any]


class Costs(NamedTuple):
    """Seconds of one core per timestep."""

    simulate: float  # the game, in a simulator
    wire: float  # messages, in a simulator
    act: float  # all that the trainer does to play
    learn: float
    wait: float = 0.0  # of the trainer for messages, also where simulators are fast enough


class Prediction(NamedTuple):
    """What the model says about a number of cores."""

    saturated: str  # the part that the others wait for most
    rate: float  # timesteps per second
    core_hours: float  # per 1 B timesteps, of all cores, also of those that wait


def predict(costs: Costs, cores: int, learners: int = 1, gradients: float = 0.0, simulators: int = 0) -> Prediction:
    """Return how fast training is. The other cores run simulators, or only so many of them, if given.

    While the arenas are played, simulators and policies work at the same time; learning waits for both, and for the
    messages. Several learners divide the arenas, and learning takes a fraction `gradients` longer. Raises ValueError
    without a core for simulators.
    """
    simulators = simulators or cores - learners
    if not 1 <= simulators <= cores - learners:
        raise ValueError(f"{cores} cores for {learners} learners and {simulators} simulators, expected one each")
    played = {"simulate": costs.simulate / simulators, "wire": costs.wire / simulators}
    learn = costs.learn * (1.0 + gradients * (learners > 1)) / learners
    act, wait = costs.act / learners, costs.wait / learners
    seconds = max(sum(played.values()), act) + wait + learn
    waits_for_simulators = sum(played.values()) > act
    parts = {**(played if waits_for_simulators else {"act": act}), "wait": wait, "learn": learn}
    saturated = max(parts, key=lambda name: parts[name])
    return Prediction(saturated, 1.0 / seconds, 1e9 * seconds * cores / 3600.0)


# ---------------------------------------------------------------------------------------------------------- measuring


def measure(timesteps: int) -> Figures:
    """Return all figures, of trainings with so many timesteps. This takes some minutes."""
    figures: Figures = {"machine": machine(), "arenas": {}, "sessions": {}, "trainings": {}}
    for game in GAMES:
        figures["arenas"][game] = [by_arenas(game, arenas) for arenas in ARENAS]
        figures["sessions"][game] = [by_sessions(game, sessions) for sessions in SESSIONS]
    for experiment in TRAININGS:
        figures["trainings"][experiment] = [training(experiment, count, timesteps) for count in (1, 2)]
    return figures


def by_arenas(game: str, arenas: int) -> Figures:
    """Play one session with random actions for some seconds."""
    with simulator_process() as address, Session(address, game, arenas=arenas, seed=0) as session:
        simulator = children()[-1]
        acts = random_acts(session.spec, arenas, np.random.default_rng(0))
        for act in acts:
            session.step(act)
        used, simulated = processor_seconds(simulator), 0.0
        trips: list[float] = []
        until = time.perf_counter() + SECONDS
        while (begin := time.perf_counter()) < until:
            session.step(acts[len(trips) % len(acts)])
            trips.append(time.perf_counter() - begin)
            simulated += session.simulate_seconds
        steps = len(trips) * arenas
        low, high = np.percentile(trips, [50, 95])
        return {
            "arenas": arenas,
            "us": 1e6 * sum(trips) / steps,
            "p50_us": 1e6 * low,
            "p95_us": 1e6 * high,
            "simulate_us": 1e6 * simulated / steps,
            "simulator_cpu_us": 1e6 * (processor_seconds(simulator) - used) / steps,
            "mb": megabytes(simulator),
        }


def by_sessions(game: str, sessions: int, arenas: int = 16) -> Figures:
    """Play several sessions at one simulator for some seconds; each has a request on its way nearly all the time."""
    with simulator_process() as address, ExitStack() as stack:
        simulator = children()[-1]
        opened = [
            stack.enter_context(Session(address, game, arenas=arenas, first_arena=arenas * index, seed=0))
            for index in range(sessions)
        ]
        acts = random_acts(opened[0].spec, arenas, np.random.default_rng(0))
        for session in opened:
            session.step(acts[0])
        trips: list[float] = []
        sent = []
        for session in opened:
            session.send(acts[0])
            sent.append(time.perf_counter())
        begin = time.perf_counter()
        while time.perf_counter() < begin + SECONDS:
            for index, session in enumerate(opened):
                session.receive()
                trips.append(time.perf_counter() - sent[index])
                session.send(acts[len(trips) % len(acts)])
                sent[index] = time.perf_counter()
        seconds = time.perf_counter() - begin
        for session in opened:
            session.receive()
        return {
            "sessions": sessions,
            "per_second": len(trips) * arenas / seconds,
            "p95_us": 1e6 * float(np.percentile(trips, 95)),
            "mb": megabytes(simulator),
        }


def training(experiment: str, simulators: int, timesteps: int) -> Figures:
    """Train with so many simulators, and return what a timestep costs and what memory is used over time."""
    config = load_config(CONFIGS / f"{experiment}.yaml", [f"stop_at={timesteps}", f"log_interval={timesteps // 12}"])
    rows: list[Row] = []
    memory: list[Figures] = []
    used: list[float] = []
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        addresses = [stack.enter_context(simulator_process()) for _ in range(simulators)]
        processes = children()[-simulators:]

        def report(done: int, live: Row, row: Row | None) -> None:
            if row is not None:
                rows.append(row)
                used.append(sum(processor_seconds(process) for process in processes))
                held = [megabytes(process) for process in processes]
                memory.append({"timesteps": done, "trainer": megabytes(os.getpid()), "simulator": max(held)})

        train(config, Path(folder) / "run", addresses, resume=False, audience=Audience(report))
    between = memory[-1]["timesteps"] - memory[1]["timesteps"]  # without the first row, in which rules are compiled
    seconds = [1.0 / row["timesteps_per_second"] for row in rows[2:]]

    def cost(*activities: str) -> float:
        return float(
            np.mean(
                [s * sum(row[activity] for activity in activities) for s, row in zip(seconds, rows[2:], strict=True)]
            )
        )

    return {
        "simulators": simulators,
        "per_second": 1.0 / float(np.mean(seconds)),
        "act": cost("act"),
        "learn": cost("learn"),
        "waited": cost("simulate", "wire"),
        "simulators_cpu": (used[-1] - used[1]) / between,
        "memory": memory,
    }


def processor_seconds(process: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# ------------------------------------------------------------------------------------------------------------- page


def costs_of(figures: Figures, experiment: str) -> Costs:
    """Return the costs that were measured in a training with one simulator. Wait is what the others leave of it."""
    game = experiment.split("/")[0]
    one = figures["trainings"][experiment][0]
    arenas = load_config(CONFIGS / f"{experiment}.yaml").arenas
    nearest = min(figures["arenas"][game], key=lambda point: abs(np.log(point["arenas"] / arenas)))
    share = min(1.0, nearest["simulate_us"] / nearest["simulator_cpu_us"]) if nearest["simulator_cpu_us"] else 1.0
    total = one["simulators_cpu"]
    wait = max(0.0, 1.0 / one["per_second"] - max(total, one["act"]) - one["learn"])
    return Costs(total * share, total * (1.0 - share), one["act"], one["learn"], wait)


def write_page(figures: Figures, folder: Path) -> None:
    """Write the pictures and the page into a folder."""
    draw(figures, folder)
    (folder / "README.md").write_text("\n".join(page(figures)) + "\n")


def draw(figures: Figures, folder: Path) -> None:
    """Draw the curves: cost, latency and memory by arenas, rate and latency by sessions, memory over a training."""
    figure, panels = plt.subplots(2, 3, figsize=(12, 7), layout="constrained")
    for game in GAMES:
        points, many = figures["arenas"][game], figures["sessions"][game]
        arenas, sessions = [p["arenas"] for p in points], [p["sessions"] for p in many]
        panels[0, 0].plot(arenas, [p["us"] for p in points], "o-", label=game)
        (line,) = panels[0, 1].plot(arenas, [p["p50_us"] for p in points], "o-", label=f"{game}, p50")
        panels[0, 1].plot(arenas, [p["p95_us"] for p in points], ":", color=line.get_color(), label=f"{game}, p95")
        panels[0, 2].plot(arenas, [p["mb"] for p in points], "o-", label=game)
        panels[1, 0].plot(sessions, [p["per_second"] for p in many], "o-", label=game)
        panels[1, 1].plot(sessions, [p["p95_us"] for p in many], "o-", label=game)
    for experiment, runs in figures["trainings"].items():
        memory = runs[0]["memory"]
        for name, style in (("trainer", "-"), ("simulator", ":")):
            x = [point["timesteps"] / 1e6 for point in memory]
            panels[1, 2].plot(x, [point[name] for point in memory], style, label=f"{experiment}, {name}")
    titles = [
        ("µs per agent-step", "arenas"),
        ("round trip, µs", "arenas"),
        ("memory of the simulator, MB", "arenas"),
        ("agent-steps per second", "sessions of 16 arenas"),
        ("round trip p95, µs", "sessions of 16 arenas"),
        ("memory in training, MB", "million timesteps"),
    ]
    for panel, (title, below) in zip(panels.flat, titles, strict=True):
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(below, fontsize=9)
        if below != "million timesteps":
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_formatter("{x:.0f}")
        if "µs" in title:
            panel.set_yscale("log")
        else:
            panel.set_ylim(0.0, 1.1 * panel.get_ylim()[1])
        panel.legend(frameon=False, fontsize=7)
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    figure.savefig(folder / "curves.png", dpi=90)
    plt.close(figure)


def page(figures: Figures) -> list[str]:
    """Return the lines of the page."""
    lines = [
        "# Scale",
        "",
        "How time and memory grow with arenas, sessions and timesteps, and a model of more cores.",
        "`python -m tools.scale`, in a checkout, measures all of it again and writes this page. It needs a machine of",
        "its own.",
        "",
        f"Measured on {figures['machine']}, over a Unix socket, with random actions.",
        "",
        "![Curves](curves.png)",
        "",
    ]
    for game in GAMES:
        lines += [f"## {game}", ""]
        lines += table(
            ["arenas", "µs per agent-step", "of these, the game", "round trip p50, µs", "p95, µs", "simulator, MB"],
            [
                [p["arenas"], p["us"], p["simulate_us"], p["p50_us"], p["p95_us"], p["mb"]]
                for p in figures["arenas"][game]
            ],
        )
        lines += table(
            ["sessions of 16 arenas", "agent-steps per second", "round trip p95, µs", "simulator, MB"],
            [[p["sessions"], p["per_second"], p["p95_us"], p["mb"]] for p in figures["sessions"][game]],
        )
    lines += ["## Model", "", *MODEL, ""]
    rows, checks = [], []
    for experiment in figures["trainings"]:
        costs = costs_of(figures, experiment)
        for run in figures["trainings"][experiment]:
            predicted = predict(costs, 1 + run["simulators"], simulators=run["simulators"]).rate
            checks.append([experiment, run["simulators"], predicted, run["per_second"], predicted / run["per_second"]])
        for learners in LEARNERS:
            for cores in (cores for cores in CORES if cores > learners):
                found = predict(costs, cores, learners, GRADIENTS)
                rows.append([experiment, learners, cores, found.saturated, found.rate, found.core_hours])
        lines.append(
            f"{experiment}, µs per timestep: simulate {1e6 * costs.simulate:.1f}, wire {1e6 * costs.wire:.1f}, "
            f"act {1e6 * costs.act:.1f}, wait {1e6 * costs.wait:.1f}, learn {1e6 * costs.learn:.1f}."
        )
        lines.append("")
    lines += table(
        ["training", "learners", "cores", "saturated", "timesteps per second", "core-hours per 1 B timesteps"], rows
    )
    lines += ["Predicted beside measured, on this machine (with one simulator, wait makes them equal):", ""]
    lines += table(["training", "simulators", "predicted", "measured", "ratio"], checks)
    return lines[:-1]


MODEL = [
    "A timestep costs four parts of processor time: *simulate* and *wire* in a simulator, *act* and *learn* in a",
    "learner. Simulators are spread over all cores but those of the learners. While arenas are played, simulators and",
    "policies work at the same time, and the slower of both counts. Learning comes after that. *Wait* is the rest of a",
    "timestep with one simulator: the trainer waits for messages, also where the simulator is fast enough. Several",
    f"learners divide act, wait and learn; to add their gradients is assumed to cost {GRADIENTS:.0%} of learning. The",
    "network is assumed to be fast enough. The largest part is *saturated*. All cores are counted, also those that",
    "wait.",
]


def table(head: list[str], rows: list[list[Any]]) -> list[str]:
    """Return a table of Markdown, with an empty line after it."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return [*lines, *("| " + " | ".join(cell(value) for value in row) + " |" for row in rows), ""]


def cell(value: object) -> str:
    """Return a number with three digits or more, a text as it is."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}".replace(",", " ") if value >= 100 else f"{value:.3g}"


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how memory and time grow with the work, and write a page.")
    parser.add_argument("--output", type=Path, default=Path("results/scale"), help="folder; default: %(default)s")
    parser.add_argument(
        "--timesteps", type=int, default=450_000, help="of each training, at least 100 000; default: %(default)s"
    )
    parser.add_argument("--redraw", action="store_true", help="write the page from figures.json, without measuring")
    options = parser.parse_args()
    file = options.output / "figures.json"
    if not options.redraw:
        options.output.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(measure(options.timesteps), indent=1) + "\n")
    write_page(json.loads(file.read_text()), options.output)
    print(options.output / "README.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
