"""Chance that depends on the seed of the episode alone, in whatever way the program asks for it.

What Python orders by address differs between a process and its fork. Sets of the program's own objects are the case
that occurs, so objects whose class has no hash of its own are hashed by a serial number.
"""

import builtins
import dataclasses
import os
import random
from hashlib import blake2b
from itertools import count
from typing import Any

import numpy as np

OF_NUMPY = ("RandomState", "MT19937", "PCG64", "PCG64DXSM", "Philox", "SFC64")
FIRST_SEED = 0  # of what the program does before the episodes part


class Chance:
    """All generators of the process."""

    def __init__(self) -> None:
        """Take the place of all sources of chance that are not seeded by the program."""
        self.seed, self._drawn = FIRST_SEED, 0
        self._early: dict[int, Any] = {}  # not seeded, made before the first frame
        self._begun = False  # whether the first frame has come
        self._reseed, self._make_numpy = random.Random.seed, np.random.default_rng

        def seed(generator: random.Random, a: Any = None, version: int = 2) -> None:
            self._reseed(generator, self.number() if a is None else a, version)
            self._note(generator, seeded=a is not None)

        def default_rng(seed: Any = None) -> np.random.Generator:
            generator = self._make_numpy(self.number() if seed is None else seed)
            self._note(generator, seeded=seed is not None)
            return generator

        random.Random.seed = seed
        random.seed = random._inst.seed
        np.random.default_rng = default_rng
        for name in OF_NUMPY:
            setattr(np.random, name, self._seeding(getattr(np.random, name)))
        os.urandom = random._urandom = self.bytes
        _hash_by_serial_numbers()
        self._seed_shared(FIRST_SEED)

    def begin(self, seed: int) -> None:
        """Begin an episode: seed every generator that the process shares, and those that the program has not seeded."""
        self._begun = True
        self._seed_shared(seed)
        for generator in self._early.values():
            if isinstance(generator, np.random.Generator):
                generator.bit_generator.state = self._make_numpy(self.number()).bit_generator.state
            elif isinstance(generator, np.random.RandomState):
                generator.seed(self.number() % 2**32)
            elif isinstance(generator, np.random.BitGenerator):
                generator.state = type(generator)(self.number()).state
            else:
                self._reseed(generator, self.number(), 2)

    def _seed_shared(self, seed: int) -> None:
        self.seed, self._drawn = seed, 0
        random.seed(self.number())
        np.random.seed(self.number() % 2**32)

    def _seeding(self, kind: Any) -> Any:
        """Return a kind of NumPy's older or bit generators whose seed comes from here if the program gives none."""
        chance = self

        class Seeded(kind):
            def __init__(self, seed: Any = None) -> None:
                super().__init__(chance.number() % 2**32 if seed is None else seed)
                chance._note(self, seeded=seed is not None)

        Seeded.__name__ = Seeded.__qualname__ = kind.__name__
        return Seeded

    def _note(self, generator: Any, *, seeded: bool) -> None:
        """Note a generator that is made or seeded before the first frame, and forget one that is seeded after all."""
        if seeded:
            self._early.pop(id(generator), None)
        elif not self._begun:
            self._early[id(generator)] = generator

    def number(self) -> int:
        """Return the next number below 2**64, for a generator that the program does not seed."""
        return int.from_bytes(self.bytes(8), "little")

    def bytes(self, size: int) -> bytes:
        """Return the next bytes."""
        self._drawn += 1
        blocks = range(-(-size // 64))
        data = [blake2b(b"%d %d %d" % (self.seed, self._drawn, block)).digest() for block in blocks]
        return b"".join(data)[:size]


_SERIAL = "_serial_number_of_object"
_serials = count()


def _serial_hash(one: object) -> int:
    fields = one.__dict__
    number = fields.get(_SERIAL)
    if number is None:
        number = fields[_SERIAL] = next(_serials)
    return int(number)


def _hash_by_serial_numbers() -> None:
    build, process = builtins.__build_class__, dataclasses._process_class

    own: tuple[Any, Any] = (object.__hash__, object.__eq__)

    def number(kind: Any) -> Any:
        plain = type(kind) is type and (kind.__hash__, kind.__eq__) == own
        if plain and kind.__dictoffset__ and not issubclass(kind, type):
            kind.__hash__ = _serial_hash
        return kind

    def build_class(*arguments: Any, **options: Any) -> Any:
        return number(build(*arguments, **options))

    def process_class(kind: Any, *arguments: Any, **options: Any) -> Any:
        if kind.__dict__.get("__hash__") is _serial_hash:  # a dataclass may get a hash by its fields
            del kind.__hash__
        return number(process(kind, *arguments, **options))

    builtins.__build_class__ = build_class
    dataclasses._process_class = process_class
