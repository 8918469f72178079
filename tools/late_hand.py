"""The ceiling of Shooting Birds under a hand that is late: a scripted player that knows the whole state.

    python -m tools.late_hand [--arenas N] [--delays D …] [--forgets]

It knows what is on its way, and so where the crosshair will be when its next action is done, and aims at where birds
will be then. A bird that it has shot at counts as gone until the shot arrives; with --forgets it does not, and the
player shoots again and again at birds that are gone when the shots arrive.
"""

import argparse
from collections import deque

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.rules import BIRDS, EPISODE_TICKS, MAGAZINE, TICK, TOP_SPEED
from joybridge.games.shooting_birds.script import REACH_X, REACH_Y
from joybridge.games.shooting_birds.sensing import BIRD_RADIUS, covered
from joybridge.simulator.compiled import compiled

STEP = TICK * TOP_SPEED  # units that the crosshair moves per decision, at most
SURE = 0.95  # share of a bird's radius within which a shot is made


@compiled
def decide(arenas, obstacles, delay, crosshair, ammo, gone, axes, shots):
    """Write the velocity [arenas, 2] to the nearest bird, and whether to shoot [arenas]; both are done after `delay`.

    crosshair: where it will be then, units [arenas, 2]. ammo: the shots that are left then [arenas]. gone: for how many
    decisions more a bird counts as gone [arenas, birds]; one that is shot at does for as long as the shot takes.
    """
    for i in range(len(arenas)):
        arena, nearest, target = arenas[i], np.inf, -1
        for j in range(len(arena.birds)):
            bird = arena.birds[j]
            gone[i, j] = max(gone[i, j] - 1, 0)
            x, y = bird.x + bird.vx * TICK * delay, bird.y + bird.vy * TICK * delay
            if bird.wait > 0 or gone[i, j] > 0 or covered(x, y, bird.z, arena.level, obstacles):
                continue
            dx, dy = x - crosshair[i, 0], y - crosshair[i, 1]
            if dx * dx + dy * dy < (SURE * BIRD_RADIUS[bird.kind]) ** 2:
                target = j
            next_x, next_y = x + bird.vx * TICK, y + bird.vy * TICK
            dx, dy = next_x - crosshair[i, 0], next_y - crosshair[i, 1]
            if max(abs(dx), abs(dy)) < nearest and abs(next_x) <= REACH_X and abs(next_y) <= REACH_Y:
                nearest = max(abs(dx), abs(dy))
                axes[i, 0], axes[i, 1] = min(max(dx / STEP, -1.0), 1.0), min(max(dy / STEP, -1.0), 1.0)
        shots[i] = target >= 0 and ammo[i] > 0
        if shots[i]:
            gone[i, target] = delay + 1


def play(delay: int, arenas: int, forgets: bool = False, seed: int = 0) -> tuple[float, float]:
    """Play one episode in each arena under a delay in decisions; return the mean reward and hits of an episode."""
    options = choose_options(ShootingBirds.options, {"locomotion": "axes"}, ShootingBirds.name)
    game = ShootingBirds(options, {}, arenas, 0, seed)
    weights = np.array([channel.default_weight for channel in game.channels])
    still = ActArrays(np.zeros((arenas, 2), np.float32), np.zeros((arenas, 2), np.int32))
    on_the_way = deque([still] * delay)
    ammo, gone = np.full(arenas, MAGAZINE), np.zeros((arenas, BIRDS), np.int64)
    reward = np.zeros(arenas)
    for _ in range(EPISODE_TICKS):
        axes, shots = np.zeros((arenas, 2)), np.zeros(arenas, np.int64)
        decide(game.arenas, game.world.obstacles, delay, _crosshair(game, on_the_way), ammo, gone, axes, shots)
        reloads = ammo == 0
        ammo = np.where(reloads, MAGAZINE, ammo - shots)
        choices = np.stack([shots, reloads], axis=1).astype(np.int32)
        if forgets:
            gone[:] = 0
        on_the_way.append(ActArrays(axes.astype(np.float32), choices))
        (step,) = game.step([on_the_way.popleft()])
        reward += step.rewards @ weights
    hits = [metric.name for metric in game.describe(options).behaviors[0].metrics].index("hits")
    assert step.metrics is not None  # the last decision ends every episode
    return float(reward.mean()), float(step.metrics[:, hits].mean())


def _crosshair(game: ShootingBirds, on_the_way: deque[ActArrays]) -> Array:
    """Return where the crosshair will be when what is on its way is done, units [arenas, 2]."""
    place = np.stack([game.arenas.x, game.arenas.y], axis=1)
    for act in on_the_way:
        place = np.clip(place + act.axes * STEP, (-REACH_X, -REACH_Y), (REACH_X, REACH_Y))
    return place


def main() -> None:
    """Print reward and hits for each delay."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arenas", type=int, default=28, help="episodes per delay (default: %(default)s)")
    parser.add_argument("--delays", type=int, nargs="+", default=[0, 1, 2, 5, 10, 15], help="in decisions of 20 ms")
    parser.add_argument("--forgets", action="store_true", help="forget which birds have been shot at")
    arguments = parser.parse_args()
    print("delay, ms   reward    hits")
    for delay in arguments.delays:
        reward, hits = play(delay, arguments.arenas, arguments.forgets)
        print(f"{delay * TICK * 1000:9.0f} {reward:8.1f} {hits:7.1f}", flush=True)


if __name__ == "__main__":
    main()
