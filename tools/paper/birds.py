"""What policies of Shooting Birds do with the birds on the field.

The sensors do not show where all birds are, so the policy plays the game itself, in this process. A bird is *open* if
its center is within the crosshair's reach and a part of it is not behind an obstacle. That birds hide each other does
not count.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from joybridge.config.game_settings import fixed
from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.game import REACH_X, REACH_Y, ShootingBirds
from joybridge.games.shooting_birds.levels import LEVELS, OBSTACLES, Obstacles
from joybridge.games.shooting_birds.rules import BIRDS, EPISODE_TICKS
from joybridge.games.shooting_birds.sensing import BIRD_RADIUS, covered, front
from joybridge.play.playing import Policies
from joybridge.run.folder import play_config
from joybridge.simulator.compiled import compiled

MIDDLE = 3.0  # units: a crosshair that is nearer to the middle of the field than this is still on its former side
HALF = (0.25, 0.75)  # fraction behind obstacles of a bird that is half hidden
NEAR = 4.0  # units between the centers of neighbors
DENSE = 2  # neighbors of a bird in a dense region
LARGE = 0  # the size of birds that nothing hides

# Points spread evenly over the unit disc, in a spiral by the golden angle.
_ORDER = np.arange(40)
POINTS = np.sqrt((_ORDER + 0.5) / 40)[:, None] * np.stack(
    [np.cos(2.399963 * _ORDER), np.sin(2.399963 * _ORDER)], axis=1
)


@dataclass(frozen=True)
class Field:
    """What is on the field before each decision, [decisions, arenas, …]. Lengths are in units of the game."""

    crosshair: Array  # [decisions, arenas, 2]
    birds: Array  # [decisions, arenas, birds, 2]: their centers
    size: Array  # int [decisions, arenas, birds]: 0 large, 1 medium, 2 small
    hidden: Array  # [decisions, arenas, birds]: fraction behind obstacles
    hit: Array  # int [decisions, arenas]: index of the bird that the decision hits, or -1

    @property
    def open(self) -> Array:
        """Return which birds can be hit where they are, bool [decisions, arenas, birds]."""
        x, y = np.moveaxis(abs(self.birds), -1, 0)
        return np.asarray((x <= REACH_X) & (y <= REACH_Y) & (self.hidden < 1.0))

    @property
    def hits(self) -> Array:
        """Return which birds are hit, bool [decisions, arenas, birds]."""
        return np.asarray(self.hit[..., None] == np.arange(self.birds.shape[2]))


def side_changes(field: Field) -> float | None:
    """Return how many times as often the crosshair changes sides when its side is cleared as it else does.

    Both are changes per time on a side. A side, left or right, is cleared if no open bird is there.
    """
    x = field.crosshair[..., 0]
    side = np.sign(x)
    cleared = ~(field.open & (np.sign(field.birds[..., 0]) == side[..., None])).any(axis=-1)
    left, stayed = np.zeros(2), np.zeros(2)  # with birds on the side, without
    for arena in range(x.shape[1]):
        on_side = np.flatnonzero(abs(x[:, arena]) >= MIDDLE)
        changes = np.diff(side[on_side, arena]) != 0
        empty = cleared[on_side, arena][:-1]
        left += changes[~empty].sum(), changes[empty].sum()
        stayed += (~empty).sum(), empty.sum()
    return _ratio(left[1], left[0] / max(stayed[0], 1) * stayed[1])


def half_hidden_hits(field: Field) -> float | None:
    """Return hits of half hidden birds over those expected if they were hit as often per time as birds in full view.

    Only medium and small birds count, each size by itself, because nothing hides large ones.
    """
    half = (HALF[0] <= field.hidden) & (field.hidden <= HALF[1])
    hits = expected = 0.0
    for size in range(LARGE + 1, len(BIRD_RADIUS)):
        birds = field.open & (field.size == size)
        rate = _ratio((birds & (field.hidden == 0.0) & field.hits).sum(), (birds & (field.hidden == 0.0)).sum())
        hits += (birds & half & field.hits).sum()
        expected += (rate or 0.0) * (birds & half).sum()
    return _ratio(hits, expected)


def dense_hits(field: Field) -> float | None:
    """Return hits per time of birds in dense regions over those of birds that are alone.

    A bird is alone if no other open bird is within NEAR of it, and in a dense region if DENSE others are.
    """
    apart = field.birds[:, :, :, None] - field.birds[:, :, None]
    near = (np.square(apart).sum(axis=-1) <= NEAR**2) & field.open[:, :, None]
    neighbors = near.sum(axis=-1) - field.open  # without itself
    dense, alone = field.open & (neighbors >= DENSE), field.open & (neighbors == 0)
    rate = _ratio((alone & field.hits).sum(), alone.sum())
    return _ratio((dense & field.hits).sum(), (rate or 0.0) * dense.sum())


def _ratio(count: float, expected: float) -> float | None:
    return float(count / expected) if expected > 0 else None


def measure_birds(field: Field) -> dict[str, float | None]:
    """Return all measures, rounded; None for what did not happen."""
    found = {
        "side_changes": side_changes(field),
        "half_hidden_hits": half_hidden_hits(field),
        "dense_hits": dense_hits(field),
    }
    return {name: None if value is None else round(value, 4) for name, value in found.items()}


def watch(run: Path, *, episodes: int, seed: int) -> Field:
    """Play an episode of a run in so many arenas or a few more, as many per level.

    Raises CheckpointError and ConfigError.
    """
    config = play_config(run, ())
    options = choose_options(ShootingBirds.options, config.options, config.game)
    spec, arenas = ShootingBirds.describe(options), LEVELS * -(-episodes // LEVELS)
    game = ShootingBirds(options, fixed(config.parameters), arenas, 0, seed)
    game.arenas.fixed_level = np.repeat(np.arange(LEVELS), arenas // LEVELS)
    game.begin_episodes()
    policies = Policies(run, config, spec, arenas, seed)
    shoot = [branch.name for branch in spec.behaviors[0].device.branches].index("shoot")
    shape = (EPISODE_TICKS, arenas, BIRDS)
    crosshair, centers = np.empty((*shape[:2], 2)), np.empty((*shape, 2))
    size, hidden, hit = np.empty(shape, int), np.zeros(shape), np.full(shape[:2], -1)
    steps = game.observe()
    policies.begin(steps)
    for t in range(EPISODE_TICKS):
        birds = game.arenas.birds
        crosshair[t], size[t] = np.stack([game.arenas.x, game.arenas.y], axis=-1), birds["kind"]
        centers[t] = np.stack([birds["x"], birds["y"]], axis=-1)
        hide(game.arenas, OBSTACLES, POINTS, hidden[t])
        acts = policies.act(steps)
        for arena in np.flatnonzero((acts[0].choices[:, shoot] == 1) & (game.arenas.ammo > 0)):
            hit[t, arena] = max(front(game.arenas[arena], OBSTACLES), -1)  # type: ignore[no-untyped-call]
        steps = game.step(acts)
        policies.store(steps)
    return Field(crosshair, centers, size, hidden, hit)


@compiled
def hide(arenas: Array, obstacles: Obstacles, points: Array, hidden: Array) -> None:
    """Write which fraction of each bird is behind obstacles into `hidden` [arenas, birds], by points of its disc."""
    for i in range(len(arenas)):
        level = arenas[i].level
        for j in range(len(arenas[i].birds)):
            bird = arenas[i].birds[j]
            if bird.kind == LARGE:
                hidden[i, j] = 0.0
                continue
            radius, behind = BIRD_RADIUS[bird.kind], 0
            for k in range(len(points)):
                x, y = bird.x + radius * points[k, 0], bird.y + radius * points[k, 1]
                behind += covered(x, y, bird.z, level, obstacles)  # type: ignore[no-untyped-call]
            hidden[i, j] = behind / len(points)
