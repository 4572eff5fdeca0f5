"""One thread for linear algebra, unless the environment says otherwise.

The planner's matrices are small: with BLAS's own threads a plan takes two to four times the
processor time, spinning, and is no sooner done. Libraries read these variables when they are
loaded, so `limit_threads` must run before numpy is imported; the package does it on import. In a
program that imported numpy first, numpy has its threads by then: `limited_threads` takes them away
while a plan is made. On a busy machine they wait for each other, and a part that takes a second to
prepare took more than ten.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

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


@contextmanager
def limited_threads() -> Iterator[None]:
    """Hold BLAS to the number of threads that :func:`limit_threads` set, for the whole process.

    Costs nothing where it has no more; the first call looks at the libraries that are loaded
    (20 ms).
    """
    # OpenMP takes a list, one number for each level of nesting.
    given = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    number = max(int(given), 1) if given.isdecimal() else 1
    controller = _blas()
    if all(library.num_threads <= number for library in controller.lib_controllers):
        yield
        return
    with controller.limit(limits=number):
        yield


@cache
def _blas() -> ThreadpoolController:
    from threadpoolctl import ThreadpoolController  # not on the way to whoever plans nothing

    return ThreadpoolController().select(user_api="blas")
