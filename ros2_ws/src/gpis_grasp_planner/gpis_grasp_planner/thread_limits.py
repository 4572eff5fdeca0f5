"""One thread for linear algebra, unless the environment says otherwise.

The planner's matrices are small: with BLAS's own threads a plan takes two to four times the
processor time, spinning, and is no sooner done. Libraries read these variables when they are
loaded, so `limit_threads` must run before numpy is imported; the package does it on import. Where
a program imported numpy first, numpy keeps its threads.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping

# OpenBLAS, and what is built on OpenMP; numba's own pool, which the planner does not use.
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def limit_threads(environment: MutableMapping[str, str] | None = None) -> None:
    """Set the variables that are not set: to OMP_NUM_THREADS where that is, else to 1.

    Parameters
    ----------
    environment : mutable mapping, optional
        Default: that of this process, which its children inherit.
    """
    environment = os.environ if environment is None else environment
    number = environment.get("OMP_NUM_THREADS") or "1"
    for name in THREAD_VARIABLES:
        environment.setdefault(name, number)
