"""What a page and this program send each other: JSON objects, whose key `type` says which message it is.

From a page, read by `read_message`:
    start   seed, options, parameters      play from the beginning under these settings
    clock   running                        let the game run at its own speed, or hold it
    discard                                let nobody learn from the present episode, or from the one that just ended
    act     turn, id, seat, axes, choices, decide
            what is pressed; `turn` must be that of the last message `turn`. It is played once it is time, or, with
            `decide`, at once. `id` is any number; the page learns from `played` which act was played.

To a page:
    game    the game, its settings and the controls; then a first turn
    turn    the state after a decision; so many binary messages with a JPEG each follow as `pictures` says: of the
            arena, one per tick in their order or one of its end, then of the rival
    recorded where what is played is recorded, and whether the episode is discarded
    people  of several people that play together: for whom the game waits
    waiting how many people are still missing before they begin
    lost    the simulator cannot be reached; it is tried again until it answers
    refused the settings cannot be played; or the page sent what is no message
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Protocol

from PIL import Image

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Arena, Pressed, Settings
from joybridge.viewer.controls import make_controls
from joybridge.viewer.scores import Scores

if TYPE_CHECKING:  # it needs torch
    from joybridge.viewer.run_opponent import Rival

MAX_MESSAGE_BYTES = 1 << 20  # bytes of a message from a page
QUALITY = 90  # of the JPEG pictures; lower values are not drawn faster
MAX_SEED = 2**64 - 1


class MessageError(JoybridgeError, ValueError):
    """A page sent what is no message."""


class Shown(Protocol):
    """What a page shows: an `Arena`, or the one in which the policies of a run are watched."""

    spec: pb.GameSpec
    settings: Settings
    scores: Scores
    acts: list[ActArrays]
    turn: int
    pictures: list[Array]

    @property
    def steps(self) -> Sequence[StepArrays]:
        """The present observations, masks and who decides."""


class Clock(NamedTuple):
    """The page lets the game run, or holds it."""

    running: bool


class Discard(NamedTuple):
    """Nobody shall learn from this episode."""


class Act(NamedTuple):
    """What is pressed in a turn."""

    turn: int
    id: int
    seat: int | None
    pressed: Pressed
    decide: bool


Message = Settings | Clock | Discard | Act


def read_message(data: str | bytes, arena: Arena | None) -> Message | None:
    """Return the message in what a page has sent; None for an act without an arena. Raises MessageError."""
    try:
        message = json.loads(data, parse_constant=_refuse)
        json.dumps(message, ensure_ascii=False).encode()  # half a character, such as "\\ud800", is no text
    except (ValueError, RecursionError) as error:
        raise MessageError(f"got no JSON ({error}), expected an object") from None
    kind = message.get("type") if isinstance(message, dict) else None
    if kind == "start":
        return _settings(message)
    if kind == "clock" and isinstance(message.get("running"), bool):
        return Clock(message["running"])
    if kind == "discard":
        return Discard()
    if kind == "act":
        return None if arena is None else _act(message, arena)
    return _refuse(message)


def _refuse(value: object) -> NoReturn:
    raise MessageError(f"got {str(value)[:100]!r}, expected a message of the type start, clock, discard or act")


def _settings(message: dict[str, Any]) -> Settings:
    seed, options, parameters = (message.get(key) for key in ("seed", "options", "parameters"))
    # A string: numbers of JavaScript have 53 bits.
    if not isinstance(seed, str) or not (seed.isascii() and seed.isdecimal()) or len(seed) > 20 or int(seed) > MAX_SEED:
        raise MessageError(f"seed: got {str(seed)[:40]!r}, expected the digits of a number of 0..{MAX_SEED}")
    if not isinstance(options, dict) or not all(isinstance(choice, str) for choice in options.values()):
        raise MessageError("options: expected an object with the choice of each")
    if not isinstance(parameters, dict):
        raise MessageError("parameters: expected an object with the value of each")
    return Settings(int(seed), options, {name: _number(value, name) for name, value in parameters.items()})


def _act(message: dict[str, Any], arena: Arena) -> Act:
    spec, seat = arena.spec, message.get("seat")
    if seat is not None:
        seat = _integer(seat, "seat", len(arena.scores.seats))
    axes, choices = (_list(message.get(key), key, len(spec.behaviors)) for key in ("axes", "choices"))
    pressed = Pressed([], [])
    for behavior, values, chosen in zip(spec.behaviors, axes, choices, strict=True):
        branches = behavior.device.branches
        values = _list(values, f"axes of {behavior.name}", len(behavior.device.axes))
        chosen = _list(chosen, f"choices of {behavior.name}", len(branches))
        pressed.axes.append([_number(value, "an axis") for value in values])
        pressed.choices.append(
            [
                _integer(choice, branch.name, len(branch.choices))
                for choice, branch in zip(chosen, branches, strict=True)
            ]
        )
    return Act(
        _integer(message.get("turn"), "turn", 2**53),
        _integer(message.get("id"), "id", 2**53),
        seat,
        pressed,
        message.get("decide") is True,
    )


def _list(value: object, name: str, count: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != count:
        raise MessageError(f"{name}: got {str(value)[:40]!r}, expected a list of {count}")
    return value


def _integer(value: object, name: str, end: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < end:
        raise MessageError(f"{name}: got {str(value)[:40]!r}, expected an integer of 0..{end - 1}")
    return value


def _number(value: object, name: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300 and math.isfinite(value):
        return float(value)
    raise MessageError(f"{name}: got {str(value)[:40]!r}, expected a number")


def game_message(arena: Shown, seat: int | None = None, *, fixed: bool = False) -> str:
    """Return the message `game`. seat: the one that the person holds at first, None: all. fixed: it holds no other."""
    spec, settings = arena.spec, arena.settings
    chosen = choose_options(spec.options, settings.options, spec.name)
    return _write(
        "game",
        name=spec.name,
        description=spec.description,
        interval=spec.tick_seconds * spec.decision_interval,  # s between two decisions; 0: the game waits for them
        tick=spec.tick_seconds,  # s that each of several pictures of a decision is shown
        picture=[spec.picture.width, spec.picture.height] if spec.HasField("picture") else None,
        seed=str(settings.seed),
        options=[
            {**_named(option), "choices": list(option.choices), "value": chosen[option.name]} for option in spec.options
        ],
        parameters=[
            {
                **_named(parameter),
                "low": parameter.low,
                "high": parameter.high,
                "default": parameter.default_value,
                "value": settings.parameters.get(parameter.name, parameter.default_value),
            }
            for parameter in spec.parameters
        ],
        behaviors=[
            _behavior(behavior, act.axes[0]) for behavior, act in zip(spec.behaviors, make_acts(spec, 1), strict=True)
        ],
        seats=[one._asdict() for one in arena.scores.seats],
        seat=seat,
        fixed=fixed,
        controls=[asdict(control) for control in make_controls(spec)],
    )


def turn_message(arena: Shown, played: int | None, rival: "Rival | None", **more: Any) -> str:
    """Return the message `turn`. played: the act that led here. more: what the page of `watch` shows besides."""
    behaviors = []
    for act, step, scores in zip(arena.acts, arena.steps, arena.scores.now, strict=True):
        lanes = range(len(scores))
        behaviors.append(
            {
                "axes": act.axes.tolist(),
                "choices": act.choices.tolist(),
                "scores": scores.tolist(),
                "channels": step.rewards.tolist(),
                "deciding": [True] * len(scores) if step.deciding is None else step.deciding.tolist(),
                # per agent and branch, the choices that the next decision may not take
                "forbidden": [[(~mask[lane]).nonzero()[0].tolist() for mask in step.masks or ()] for lane in lanes],
            }
        )
    return _write(
        "turn",
        turn=arena.turn,
        played=played,
        behaviors=behaviors,
        ended=arena.scores.ended,
        pictures=len(arena.pictures),
        rival=rival and _rival(rival),
        **more,
    )


def _rival(rival: "Rival") -> dict[str, Any]:
    scores = rival.scores
    return {
        "title": rival.title,
        "scores": [now.tolist() for now in scores.now],
        "ended": scores.ended,
        "pictures": len(rival.pictures),
    }


def recorded_message(folder: Path, *, discarded: bool) -> str:
    """Return the message `recorded`."""
    return _write("recorded", folder=str(folder), discarded=discarded)


def people_message(place: int, awaited: Sequence[int]) -> str:
    """Return the message `people`. place: of the page. awaited: the places of those who do not let the game run."""
    names = ["you" if other == place else f"player {other + 1}" for other in awaited]
    return _write("people", text=f"you are player {place + 1}" + (f"; waits for {', '.join(names)}" if names else ""))


def waiting_message(here: int, places: int) -> str:
    """Return the message `waiting`."""
    return _write(
        "waiting", text=f"{here} of {places} players are here. The others open the same URL in tabs of their own."
    )


def error_message(kind: str, error: Exception, *, playing: bool = False) -> str:
    """Return the message `lost` or `refused` with a sentence. playing: whether the game before can go on."""
    return _write(kind, text=str(error), playing=playing)


def encode_picture(picture: Array) -> bytes:
    """Return a picture as a JPEG."""
    file = BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=QUALITY, subsampling=0)
    return file.getvalue()


def _behavior(behavior: pb.Behavior, rest: Array) -> Mapping[str, Any]:
    device = behavior.device
    return {
        **_named(behavior),
        "axes": [
            {**_named(axis), "low": axis.low, "high": axis.high, "rest": value}
            for axis, value in zip(device.axes, rest.tolist(), strict=True)
        ],
        "branches": [{**_named(branch), "choices": list(branch.choices)} for branch in device.branches],
        "channels": [{**_named(channel), "weight": channel.default_weight} for channel in behavior.channels],
        "metrics": [_named(metric) for metric in behavior.metrics],
    }


def _named(thing: Any) -> dict[str, str]:
    return {"name": thing.name, "description": thing.description}


def _write(kind: str, **values: object) -> str:
    return json.dumps({"type": kind, **values}, separators=(",", ":"), allow_nan=False)
