"""Finds out which keys a program reads, by pressing keys that it may not know and seeing what it compares them with.

What a program keeps in sets and dictionaries is not seen, nor what screens read that the play does not reach; so this
confirms and completes what `scan.py` finds in the sources.
"""

from typing import Any

from joybridge.adapters.pygame_programs.inside.hands import KEYS, SCANCODES, Hands, KeyStates

MAX_STATES = 64  # of keys in `get_pressed`; a program that looks at more looks at all of them
STEP = 17  # from one pressed key to the next, in the order of their numbers
NUMBERS = sorted(set(KEYS.values()))


class Watch:
    """Presses one key after the other, and notes which keys the program asks for."""

    def __init__(self, hands: Hands) -> None:
        """Let the hands of a program show keys and states that note what they are compared with."""
        self._hands = hands
        self._compared: set[int] = set()
        self._states: set[int] = set()
        self._number = 0
        hands.key_shown, hands.states_shown = self._key, self._pressed

    def press(self) -> None:
        """Press the next key."""
        self._number += STEP
        self._hands.press_keys([NUMBERS[self._number % len(NUMBERS)]])

    def read(self) -> list[int]:
        """Return the numbers of the keys that the program has read."""
        return sorted(self._compared | (self._states if len(self._states) <= MAX_STATES else set()))

    def _key(self, key: int) -> int:
        compared = self._compared

        class WatchedKey(int):
            def __eq__(self, other: object) -> bool:
                if isinstance(other, int) and int(other) != int(self):  # sets and dictionaries compare equal ones only
                    compared.add(int(other))
                return int(self) == other

            def __ne__(self, other: object) -> bool:
                return not self == other

            __hash__ = int.__hash__

        return WatchedKey(key)

    def _pressed(self, held: list[bool]) -> Any:
        states = self._states

        class WatchedStates(KeyStates):
            def __getitem__(self, key: Any) -> Any:
                states.add(int(key))
                return super().__getitem__(key)

        assert len(held) == SCANCODES
        return WatchedStates(held)
