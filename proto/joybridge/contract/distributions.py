"""The checks of distributions of parameters; see PARAMETERS PER EPISODE in bridge.proto."""

import math
from collections.abc import Collection, Mapping

from joybridge.contract.limits import MAX_VALUES
from joybridge.contract.spec import SpecError, choose_parameters
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["choose_distributions"]


def choose_distributions(
    spec: pb.GameSpec, chosen: Mapping[str, pb.Distribution], fixed: Collection[str] = ()
) -> dict[str, pb.Distribution]:
    """Return the given distributions, checked. fixed: parameters that the same message gives a value.

    Raises SpecError for a game without distributions, an unknown name, a number out of the range of its parameter, or a
    distribution that cannot be drawn from.
    """
    if chosen and not spec.parameters_per_episode:
        names = ", ".join(chosen)
        text = f"{spec.name}: its parameters cannot be drawn per episode; give {names} a value, or leave it out"
        raise SpecError(text, pb.REASON_NO_DISTRIBUTIONS, f"distributions[{next(iter(chosen))}]")
    known = [parameter.name for parameter in spec.parameters]
    for name, distribution in chosen.items():
        if name in known and (problem := _problem(distribution, name in fixed)):
            text = f"{spec.name}: the distribution of parameter {name!r} {problem}"
            raise SpecError(text, pb.REASON_WRONG_DISTRIBUTION, f"distributions[{name}]")
        for value in _numbers(distribution):
            choose_parameters(spec.parameters, {name: value}, spec.name, "distributions")
    return dict(chosen)


def _problem(distribution: pb.Distribution, fixed: bool) -> str:
    """Return why a distribution cannot be drawn from, "" if it can. Ranges of parameters are not looked at."""
    kind = distribution.WhichOneof("distribution")
    if fixed:
        return "came with a value of this parameter; give one of them"
    if kind is None:
        return "is empty, or of a kind that this server does not know; give uniform, log_uniform or choice"
    if kind == "choice":
        count = len(distribution.choice.values)
        return "" if 1 <= count <= MAX_VALUES else f"has {count} values, expected 1 to {MAX_VALUES}"
    interval = getattr(distribution, kind)
    if not interval.low < interval.high:
        return f"has low {interval.low:g} and high {interval.high:g}, expected low below high"
    if kind == "log_uniform" and interval.low <= 0:
        return f"has low {interval.low:g}, expected more than 0"
    if kind == "log_uniform" and interval.high / interval.low == math.inf:
        return f"is from {interval.low:g} to {interval.high:g}, expected numbers whose ratio is finite"
    return ""


def _numbers(distribution: pb.Distribution) -> list[float]:
    """Return all numbers of a distribution, at least one."""
    if distribution.choice.values:
        return list(distribution.choice.values)
    interval = distribution.log_uniform if distribution.HasField("log_uniform") else distribution.uniform
    return [interval.low, interval.high]
