"""Arrays by name, as the state of a run holds them: names begin with whose they are."""

from joybridge.contract.tensors import Array


def select(arrays: dict[str, Array], prefix: str) -> dict[str, Array]:
    """Return the arrays whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
