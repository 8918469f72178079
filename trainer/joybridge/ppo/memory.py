"""What a policy remembers of an episode: a recurrent layer between the hidden layers of a tower and its head."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from joybridge.contract.tensors import Array

KINDS: dict[str, type[nn.GRU] | type[nn.LSTM]] = {"gru": nn.GRU, "lstm": nn.LSTM}


class Recall(NamedTuple):
    """To which sequences the rows of a batch belong: the rows of the first one come first, oldest first."""

    states: Tensor  # [sequences, state_size]: what is remembered before the first row of each
    lengths: Tensor  # int64 [sequences]


class Sequences(NamedTuple):
    """Where the sequences of a batch begin, how long they are, and what is remembered before each."""

    begins: Tensor  # int64 [sequences]
    lengths: Tensor  # int64 [sequences]
    states: Tensor  # [sequences, state_size]
    parts: Tensor  # int64 [sequences]: 0 for the first one of an episode, 1 for the one that continues it, and so on

    def rows(self, chosen: Tensor) -> Tensor:
        """Return the rows of the sequences with these numbers, one sequence after the other."""
        begins, lengths = self.begins[chosen], self.lengths[chosen]
        ends = lengths.cumsum(0)
        shifts = begins - (ends - lengths)  # from a row's place among those that are returned to its place in the batch
        return torch.arange(int(ends[-1]), device=ends.device) + torch.repeat_interleave(shifts, lengths)

    def to(self, device: torch.device) -> "Sequences":
        """Return the same on a device."""
        return Sequences(*(part.to(device) for part in self))


def cut(episodes: Array, length: int) -> tuple[Array, Array, Array]:
    """Return begins, lengths and parts of the sequences of rows whose episodes are side by side.

    episodes: a number for each row, which changes where an episode begins. length: of the longest sequence.
    """
    number = np.arange(len(episodes))
    new = np.concatenate([[True], episodes[1:] != episodes[:-1]])
    place = number - np.maximum.accumulate(np.where(new, number, 0))
    begins = np.flatnonzero(place % length == 0)
    return begins, np.diff(begins, append=len(episodes)), place[begins] // length


class Memory(nn.Module):
    """A gated recurrent unit (Cho et al. 2014), or a long short-term memory (Hochreiter and Schmidhuber 1997).

    state_size: numbers of a state: what was put out last and, of the second kind, the cells after it. A state of zeros
    remembers nothing.
    """

    def __init__(self, kind: str, inputs: int, size: int) -> None:
        """Take `inputs` features; return `size`. kind: "gru" or "lstm"."""
        super().__init__()
        self.kind = kind
        self.layer = KINDS[kind](inputs, size)
        self.state_size = size * (2 if kind == "lstm" else 1)

    def forward(self, features: Tensor, recall: Recall) -> tuple[Tensor, Tensor]:
        """Return the features that are remembered, [rows, size], and the states after each sequence.

        features [rows, inputs]. The states after a sequence that is shorter than others mean nothing.
        """
        (states, lengths), pairs = recall, self.kind == "lstm"
        longest = int(lengths.max())
        sequence = torch.repeat_interleave(torch.arange(len(lengths), device=lengths.device), lengths)
        place = torch.arange(len(features), device=lengths.device) - (lengths.cumsum(0) - lengths)[sequence]
        padded = features.new_zeros(longest, len(lengths), features.shape[1])
        padded[place, sequence] = features  # what follows the end of a sequence changes nothing before it
        begin = tuple(part.contiguous()[None] for part in states.chunk(2 if pairs else 1, dim=1))
        outputs, end = self.layer(padded, begin if pairs else begin[0])
        return outputs[place, sequence], torch.cat([part[0] for part in (end if pairs else (end,))], dim=1)
