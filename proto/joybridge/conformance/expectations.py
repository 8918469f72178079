"""How a check reports its result: it returns, or it raises Violation, Suspicion or NotApplicable."""

from joybridge.contract.errors import JoybridgeError


class Unreachable(JoybridgeError):
    """No server responds at an address, or it has nothing to check."""


class Violation(JoybridgeError):
    """The server violates the rule of the check that raises this."""

    def __init__(self, got: object, expected: object) -> None:
        super().__init__(f"got {got}, expected {expected}")
        self.got, self.expected = str(got), str(expected)


class TimedOut(Violation):
    """The server did not respond before the deadline."""

    def __init__(self, seconds: float) -> None:
        """Name the deadline."""
        super().__init__(f"no response within {seconds:g} s", "a response; --deadline lets a slow server take longer")


class Suspicion(JoybridgeError):
    """The server may be right, but what the check saw is usually a mistake: a warning."""

    def __init__(self, got: object, expected: object) -> None:
        super().__init__(f"got {got}, expected {expected}")
        self.got, self.expected = str(got), str(expected)


class NotApplicable(JoybridgeError):
    """The game lacks the feature that a check tests; the text names the feature."""


def expect(condition: object, got: object, expected: object) -> None:
    """Raise Violation unless a condition is true."""
    if not condition:
        raise Violation(got, expected)


def expect_equal(got: object, expected: object, what: str) -> None:
    """Raise Violation unless two values are equal."""
    expect(got == expected, f"{what} {got!r}", f"{expected!r}")


def skip_unless(condition: object, reason: str) -> None:
    """Raise NotApplicable unless the game has the feature that a check tests."""
    if not condition:
        raise NotApplicable(reason)
