"""How matrix products are computed: in how many threads, and always alike."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import scipy.linalg.cython_blas  # noqa: F401  # loads the library of the compiled products, which is limited below
import torch
from threadpoolctl import threadpool_limits


def use_one_thread() -> None:
    """Compute matrix products in one thread, in this process.

    Networks this small are slower with more, above all while simulators keep the other cores busy.
    """
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")


@contextmanager
def in_threads(number: int) -> Iterator[None]:
    """Let PyTorch compute in so many threads meanwhile; as many threads have the same results each time."""
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def compute_alike() -> None:
    """Let a GPU compute the same bits each time; PyTorch raises RuntimeError where it has no such algorithm."""
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # before the first product
    torch.use_deterministic_algorithms(True)
    torch.backends.cudnn.benchmark = False
