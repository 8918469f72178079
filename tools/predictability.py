"""How well the place of a bird can be foreseen, for every kind of bird of Shooting Birds.

python -m tools.predictability [--arenas 60] [--seconds 40]

A predictor is given the last ten places of a bird and of the crosshair, relative to the bird, and says where the bird
will be 200 ms later. The best linear predictor is compared with a small network. Errors are mean distances in radii of
the bird: below one, a shot at the predicted place hits. The crosshair is that of the scripted player. Birds that leave
or are shot within the time do not count.
"""

import argparse

import numpy as np
import torch

from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import script
from joybridge.games.shooting_birds.foes import HABITS
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.rules import TICK
from joybridge.games.shooting_birds.sensing import BIRD_RADIUS

AHEAD, PAST = 10, 10  # ticks
STRIDE = 3  # between two samples of a bird
FARTHEST = 12.0  # units: a bird that goes farther in AHEAD ticks is another one
RIDGE = 1e-6
HIDDEN, EPOCHS, BATCH = 64, 8, 1024


def watch(birds: str, arenas: int, ticks: int) -> tuple[Array, Array, Array]:
    """Return inputs [samples, values], displacements [samples, 2] and radii [samples] of birds that are watched.

    The samples of the last quarter of the arenas are the last ones.
    """
    options = choose_options(ShootingBirds.options, {"birds": birds, "locomotion": "axes"}, "shooting_birds")
    game = ShootingBirds(options, {}, arenas, 0, 0)
    places, pointers, kinds, hits = [], [], [], []
    for _ in range(ticks):
        game.step([script.act(game.arenas, game.world)])
        each = game.arenas.birds
        places.append(np.stack([each["x"], each["y"]], axis=-1))
        pointers.append(np.stack([game.arenas.x, game.arenas.y], axis=-1))
        kinds.append(each["kind"].copy())
        hits.append(each["z"].copy())  # a new bird has another depth
    place, pointer, kind, depth = (np.array(values) for values in (places, pointers, kinds, hits))
    now = np.arange(PAST, ticks - AHEAD, STRIDE)
    past = np.stack([place[now - k] for k in range(PAST)], axis=-2) - place[now][..., None, :]
    aim = np.stack([pointer[now - k] for k in range(PAST)], axis=-2)[:, :, None] - place[now][..., None, :]
    inputs = np.concatenate([past[..., 1:, :].reshape(*past.shape[:3], -1), aim.reshape(*aim.shape[:3], -1)], axis=-1)
    moved = place[now + AHEAD] - place[now]
    same = (depth[now + AHEAD] == depth[now]) & (depth[now - PAST] == depth[now]) & (abs(place[now][..., 0]) < 18.0)
    same &= np.hypot(moved[..., 0], moved[..., 1]) < FARTHEST
    by_arena = [np.swapaxes(values, 0, 1) for values in (inputs, moved, BIRD_RADIUS[kind[now]], same)]
    inputs, moved, radius, same = by_arena
    return inputs[same], moved[same], radius[same]


def linear_error(inputs: Array, moved: Array, radius: Array, split: int) -> float:
    """Return the error of the best linear predictor of the samples before `split` on those after it."""
    extended = np.concatenate([inputs, np.ones((len(inputs), 1))], axis=1)
    known = extended[:split]
    gram = known.T @ known + RIDGE * split * np.eye(known.shape[1])
    weights = np.linalg.solve(gram, known.T @ moved[:split])
    return _error(extended[split:] @ weights - moved[split:], radius[split:])


def network_error(inputs: Array, moved: Array, radius: Array, split: int) -> float:
    """Return the same of a small network."""
    torch.manual_seed(0)
    scale, mean = inputs[:split].std(axis=0) + 1e-6, inputs[:split].mean(axis=0)
    rows = torch.tensor((inputs - mean) / scale, dtype=torch.float32)
    target = torch.tensor(moved, dtype=torch.float32)
    layers = [torch.nn.Linear(rows.shape[1], HIDDEN), torch.nn.ReLU(), torch.nn.Linear(HIDDEN, HIDDEN), torch.nn.ReLU()]
    network = torch.nn.Sequential(*layers, torch.nn.Linear(HIDDEN, 2))
    optimizer = torch.optim.Adam(network.parameters(), 2e-3)
    for epoch in range(EPOCHS):
        for group in optimizer.param_groups:
            group["lr"] = 2e-3 * (1.0 - epoch / EPOCHS)
        for batch in torch.split(torch.randperm(split), BATCH):
            optimizer.zero_grad()
            (network(rows[batch]) - target[batch]).norm(dim=1).mean().backward()
            optimizer.step()
    with torch.no_grad():
        predicted = network(rows[split:]).numpy()
    return _error(predicted - moved[split:], radius[split:])


def _error(wrong: Array, radius: Array) -> float:
    return float(np.mean(np.hypot(wrong[:, 0], wrong[:, 1]) / radius))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure how well birds can be foreseen.")
    parser.add_argument("--arenas", type=int, default=60, help="default %(default)s")
    parser.add_argument("--seconds", type=float, default=40.0, help="game time; default %(default)s")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{AHEAD * TICK * 1000:.0f} ms ahead, mean error in radii of the bird")
    print(f"{'birds':<10}{'samples':>9}{'linear':>9}{'network':>9}")
    for birds in HABITS:
        inputs, moved, radius = watch(birds, arguments.arenas, round(arguments.seconds / TICK))
        split = len(inputs) * 3 // 4
        linear, network = (error(inputs, moved, radius, split) for error in (linear_error, network_error))
        print(f"{birds:<10}{len(inputs):>9,}{linear:>9.3f}{network:>9.3f}", flush=True)


if __name__ == "__main__":
    main()
