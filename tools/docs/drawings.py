"""Draw what the paper's approaches put out and what its agent senses: `python -m tools.docs.drawings`.

Both drawings are made from the code: the approaches from the layouts on the device of Shooting Birds, the rays from a
state of that game and its sensor. Each SVG file has a background of its own, which follows the reader's theme.
"""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from joybridge.contract.spec import choose_options
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.levels import OBSTACLES
from joybridge.games.shooting_birds.rules import WALL_X, WALL_Y
from joybridge.games.shooting_birds.sensing import ABSENT, BIRD_RADIUS, RAY_LENGTH, RAY_X, RAY_Y, SIZE_CODE
from joybridge.layouts import AxisRange, AxisTable, JointTable, Threshold, list_roles
from joybridge.v1 import bridge_pb2 as pb

DOCS = Path(__file__).parents[2] / "docs"
STYLE = """\
svg { --ink: #1f2328; --back: #ffffff; --soft: #eef1f4; --line: #8c959f;
  --one: #0969da; --two: #bc4c00; --three: #57606a; }
@media (prefers-color-scheme: dark) {
  svg { --ink: #e6edf3; --back: #0d1117; --soft: #1c2430; --line: #6e7681;
    --one: #58a6ff; --two: #f0883e; --three: #9da7b3; }
}
text { font: 13px system-ui, sans-serif; fill: var(--ink); } .head { font-weight: 600; font-size: 15px; }
.quiet { font-size: 12px; fill: var(--three); }
.back { fill: var(--back); } .box { fill: var(--soft); stroke: var(--line); }
.line { fill: none; stroke: var(--line); } .thin { fill: none; stroke: var(--line); stroke-dasharray: 2 3; }
.one { fill: var(--one); } .three { fill: var(--three); fill-opacity: 0.35; }
.curve { fill: none; stroke: var(--one); stroke-width: 1.5; } .part { fill: var(--one); fill-opacity: 0.35; }
.to-bird { stroke: var(--one); stroke-width: 2; }
.to-obstacle { stroke: var(--two); stroke-width: 6; stroke-opacity: 0.5; }
.aim { fill: none; stroke: var(--ink); stroke-width: 2; }"""
APPROACHES = {
    "threshold-0.0": ("threshold", "one policy, all of it continuous"),
    "bucket-11": ("bucket", "one policy, all of it discrete"),
    "multiagent": ("multiagent", "two policies, one of each kind"),
}
COLUMN, ROW, GLYPH = 256, 56, 74  # width of an approach, height of an output and width of its distribution, px
UNIT = 19.0  # px per unit of the game


def svg(width: float, height: float, label: str, parts: Iterable[str]) -> str:
    """Return an SVG file. label: what it shows, for those who do not see it."""
    lines = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" role="img" aria-label="{label}">\n<style>\n{STYLE}\n</style>\n'
        f'<rect class="back" width="{width:g}" height="{height:g}" rx="8"/>\n{lines}\n</svg>\n'
    )


def text(x: float, y: float, words: str, kind: str = "") -> str:
    """Return a text that begins at (x, y)."""
    return f'<text x="{x:g}" y="{y:g}" class="{kind}">{words}</text>'


def approaches() -> str:
    """Return the drawing of what the policies of each approach put out, and what this does to the device."""
    spec = ShootingBirds.describe(choose_options(ShootingBirds.options, {}, ShootingBirds.name))
    device, parts = spec.behaviors[0].device, []
    for column, (layout, (title, subtitle)) in enumerate(APPROACHES.items()):
        x, y = 16.0 + COLUMN * column, 88.0
        parts += [text(x, 30, title, "head"), text(x, 50, subtitle, "quiet")]
        for role in list_roles(layout, spec):
            outputs = [*role.layout.continuous, *role.layout.discrete]
            parts.append(
                f'<rect class="box" x="{x:g}" y="{y - 20:g}" width="{COLUMN - 24}" '
                f'height="{ROW * len(outputs) + 26:g}" rx="8"/>'
            )
            parts.append(text(x + 10, y - 2, "policy" if role.name == "hunter" else f"policy “{role.name}”", "quiet"))
            for number, output in enumerate(outputs):
                parts += _output(x + 10, y + 8 + ROW * number, output, device)
            y += ROW * len(outputs) + 36
    return svg(COLUMN * 3 + 8, 340, "What the policies of the three approaches put out, and what it does", parts)


def _output(x: float, y: float, output: object, device: pb.Device) -> Iterator[str]:
    """Draw one output of a policy: its distribution, and what it sets."""
    match output:
        case AxisRange():
            yield from _gaussian(x, y, -math.inf)
            name, rule = device.axes[output.axis].name, f"{output.low:g} to {output.high:g}"
        case Threshold():
            yield from _gaussian(x, y, output.threshold)
            name, rule = device.branches[output.branch].name, f"pressed above {output.threshold:g}"
        case AxisTable():
            yield from _bars(x, y, len(output.values))
            values = output.values
            name = device.axes[output.axis].name
            rule = f"{len(values)} values, {values[0]:g} to {values[-1]:g}"
        case JointTable():
            yield from _bars(x, y, len(output.values))
            names = [device.branches[branch].name for branch in output.branches]
            pressed = ["".join(n for n, value in zip(names, row, strict=True) if value) for row in output.values]
            name, rule = ", ".join(names), " / ".join(each or "none" for each in pressed)
        case _:
            raise ValueError(f"no drawing of {output}; the approaches have axes, thresholds and tables")
    yield text(x + GLYPH + 12, y + 17, name)
    yield text(x + GLYPH + 12, y + 34, rule, "quiet")


def _gaussian(x: float, y: float, above: float) -> Iterator[str]:
    """Draw a bell curve from -3 to 3; the part above a value is filled, and a line is drawn there."""
    shares = np.linspace(-1.0, 1.0, 41)
    points = [(x + GLYPH * (s + 1) / 2, y + 36 - 32 * math.exp(-4.5 * (s - 0.25) ** 2)) for s in shares]
    if math.isfinite(above):
        inside = [point for point, share in zip(points, shares, strict=True) if share >= above]
        edge = inside[0][0]
        outline = " ".join(f"{a:.1f},{b:.1f}" for a, b in [(edge, y + 36), *inside, (x + GLYPH, y + 36)])
        yield f'<polygon class="part" points="{outline}"/>'
        yield f'<path class="line" d="M{edge:g} {y + 2:g}V{y + 40:g}"/>'
    yield f'<polyline class="curve" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in points)}"/>'
    yield f'<path class="line" d="M{x:g} {y + 36:g}h{GLYPH}"/>'


def _bars(x: float, y: float, number: int) -> Iterator[str]:
    """Draw so many probabilities."""
    width = GLYPH / number
    for bar in range(number):
        share = (bar + 0.5) / number * 2 - 1
        height = 32 * (0.12 + 0.88 * math.exp(-4.5 * (share - 0.25) ** 2))
        yield (
            f'<rect class="one" x="{x + width * (bar + 0.1):.1f}" y="{y + 36 - height:.1f}" '
            f'width="{0.8 * width:.1f}" height="{height:.1f}"/>'
        )
    yield f'<path class="line" d="M{x:g} {y + 36:g}h{GLYPH}"/>'


def rays() -> str:
    """Return the drawing of the twelve rays in a state of the game, and of what three of them report."""
    options = choose_options(ShootingBirds.options, {"level": "0"}, ShootingBirds.name)
    game = ShootingBirds(options, {}, 1, 0, 0)
    arena = game.arenas[0]
    arena.x, arena.y = -3.6, 0.4
    for bird, (x, y, size) in zip(game.arenas.birds[0], BIRDS, strict=True):
        bird["x"], bird["y"], bird["kind"] = x, y, size
    (step,) = game.observe()
    names = [sensor.name for sensor in ShootingBirds.numbers(options)]
    hit = step.observations[names.index("rays")][0]
    parts = [*_field(game), *_rays(arena.x, arena.y, hit), "</g>", *_legend(hit)]
    return svg(UNIT * 2 * WALL_X + 32, UNIT * 2 * WALL_Y + 172, "The rays with which the agent senses", parts)


BIRDS = (
    (5.6, 0.8, 1),
    (2.4, 4.2, 0),
    (-3.4, 8.8, 2),
    (-9.4, 3.7, 2),
    (-14.6, 0.6, 0),
    (-3.9, -6.1, 1),
    (3.3, -3.6, 2),
    (13.5, 6.8, 1),
    (15.2, -4.4, 2),
    (-16.0, -7.0, 0),
)


def _place(x: float, y: float) -> tuple[float, float]:
    return 16 + UNIT * (WALL_X + x), 16 + UNIT * (WALL_Y - y)


def _field(game: ShootingBirds) -> Iterator[str]:
    """Draw the walls, the obstacles where their colliders are, and the birds, and open a group within the walls."""
    left, top = _place(-WALL_X, WALL_Y)
    frame = f'x="{left:g}" y="{top:g}" width="{UNIT * 2 * WALL_X:g}" height="{UNIT * 2 * WALL_Y:g}"'
    yield f'<clipPath id="field"><rect {frame}/></clipPath><rect class="box" {frame}/><g clip-path="url(#field)">'
    for left, bottom, right, top, _ in OBSTACLES.boxes[0, : OBSTACLES.box_count[0]]:
        x, y = _place(left, top)
        size = f'width="{UNIT * (right - left):.1f}" height="{UNIT * (top - bottom):.1f}"'
        yield f'<rect class="three" x="{x:.1f}" y="{y:.1f}" {size}/>'
    for x, y, radius, _ in OBSTACLES.discs[0, : OBSTACLES.disc_count[0]]:
        x, y = _place(x, y)
        yield f'<circle class="three" cx="{x:.1f}" cy="{y:.1f}" r="{UNIT * radius:.1f}"/>'
    for bird in game.arenas.birds[0]:
        x, y = _place(bird["x"], bird["y"])
        yield f'<circle class="one" cx="{x:.1f}" cy="{y:.1f}" r="{UNIT * BIRD_RADIUS[bird["kind"]]:.1f}"/>'


def _rays(x: float, y: float, hit: np.ndarray) -> Iterator[str]:
    """Draw each ray: dashed as far as it reaches, broad to the nearest obstacle, narrow to the nearest bird."""
    start = _place(x, y)

    def line(number: int, length: float, kind: str) -> str:
        end = _place(x + length * RAY_X[number], y + length * RAY_Y[number])
        return f'<path class="{kind}" d="M{start[0]:.1f} {start[1]:.1f}L{end[0]:.1f} {end[1]:.1f}"/>'

    for number, (bird, _, obstacle) in enumerate(hit):
        yield line(number, RAY_LENGTH, "thin")
        if obstacle != ABSENT:
            yield line(number, RAY_LENGTH * obstacle, "to-obstacle")
        if bird != ABSENT:
            yield line(number, RAY_LENGTH * bird, "to-bird")
    yield f'<circle class="aim" cx="{start[0]:.1f}" cy="{start[1]:.1f}" r="9"/>'


def _legend(hit: np.ndarray) -> Iterator[str]:
    """Write what the lines mean, and the three values of some rays."""
    top = _place(0.0, -WALL_Y)[1]
    for row, (kind, words) in enumerate(
        (
            ("to-bird", "to the nearest bird"),
            ("to-obstacle", "to the nearest obstacle"),
            ("thin", f"a ray of {RAY_LENGTH:g} units"),
        )
    ):
        y = top + 28 + 24 * row
        yield f'<path class="{kind}" d="M20 {y - 4:g}h40"/>' + text(70, y, words)
    sizes = ", ".join(f"{code:g} {name}" for code, name in zip(SIZE_CODE, ("large", "medium", "small"), strict=True))
    yield text(20, top + 126, "Birds and obstacles do not hide each other from the rays.", "quiet")
    heads = ("ray", "bird: distance", "its size", "obstacle: distance")
    columns = (300, 370, 490, 580)
    yield from (text(x, top + 28, head, "quiet") for x, head in zip(columns, heads, strict=True))
    for row, number in enumerate((0, 2, 5)):
        cells = (f"{30 * number}°", *(f"{value:.2f}" if value != ABSENT else "-1 (nothing)" for value in hit[number]))
        yield from (text(x, top + 52 + 22 * row, cell) for x, cell in zip(columns, cells, strict=True))
    yield text(20, top + 144, f"Distances are fractions of the ray. Sizes: {sizes}.", "quiet")


DRAWINGS = {"approaches.svg": approaches, "rays.svg": rays}

if __name__ == "__main__":
    for name, draw in DRAWINGS.items():
        (DOCS / name).write_text(draw(), encoding="utf-8")
