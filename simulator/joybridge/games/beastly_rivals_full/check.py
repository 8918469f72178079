"""Checks of arenas that come with a snapshot: it may be damaged or forged, and compiled rules check no index."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals_full.state import DECISION_TICKS, HUNT, MAX_DECISIONS, OVER, Rules
from joybridge.simulator import check_range

MAX_VALUE = 1e6  # larger than any number of units, degrees or rewards
MAX_TICK = MAX_DECISIONS * DECISION_TICKS
MAX_DELAY = 1000  # ticks; of what is planned
PARTS = ("players", "beast", "ball")


def check_arenas(arenas: Array, rules: Rules) -> None:
    """Raise ValueError if arenas, records of dtype ARENA, are in a state that cannot occur under these rules."""
    parts = [("", arenas), *((part, arenas[part]) for part in PARTS)]
    for part, records in parts:
        for name in records.dtype.names or ():
            if name in PARTS:
                continue
            values = records[name]
            low, high = _range(name, values.dtype, rules)
            check_range(
                f"{part} {name}".strip(), values.view(np.uint8) if values.dtype.kind == "b" else values, low, high
            )
    players = arenas["players"]
    if not players["out"][:, rules.players :].all() or ((~players["out"]).sum(axis=1) < 2).any():
        raise ValueError(f"players out: expected at least two of {rules.players} in a match, and nobody else")
    if (arenas["ball"]["flying"] & (arenas["target"] < 0)).any():
        raise ValueError("a ball is flying to no target")
    if ((arenas["phase"] != HUNT) & (arenas["phase_tick"] <= arenas["tick"])).any():
        raise ValueError("phase_tick is not after tick")


def _range(name: str, dtype: np.dtype[np.generic], rules: Rules) -> tuple[float, float]:
    """Return the lowest and the highest value of a field."""
    if dtype.kind == "b":
        return 0, 1
    if name in ("carrier", "target", "last", "victim", "pass_to", "throw_to"):
        return -1, rules.players - 1
    if name == "seat":
        return 0, 7
    if name == "phase":
        return 0, OVER - 1
    if name == "lives":
        return 0, rules.lives
    if name == "tick":
        return 0, MAX_TICK - 1
    if dtype.kind == "i":
        return -MAX_TICK, MAX_TICK + MAX_DELAY
    return -MAX_VALUE, MAX_VALUE
