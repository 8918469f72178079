"""The number of threads that matrix products use."""

import scipy.linalg.cython_blas  # noqa: F401  # loads the library of the compiled products, which is limited below
import torch
from threadpoolctl import threadpool_limits


def use_one_thread() -> None:
    """Compute matrix products in one thread, in this process.

    Networks this small are slower with more, above all while simulators keep the other cores busy.
    """
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")
