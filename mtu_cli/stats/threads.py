"""How many processors there are, and one thread for linear algebra: small matrices gain nothing
from more, and bytes depend on it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import Any

MOST_THREADS = 8
"""Each thread holds its own scratch arrays: more would break the memory promised."""


def available_threads() -> int:
    """Processors this process may use, at most `MOST_THREADS`."""
    if hasattr(os, "sched_getaffinity"):
        return min(MOST_THREADS, len(os.sched_getaffinity(0)))
    return min(MOST_THREADS, os.cpu_count() or 1)


@contextmanager
def workers(threads: int) -> Iterator[ThreadPoolExecutor]:
    """Threads; where the caller is interrupted they are not waited for: it may have met the lock of
    their queue.
    """
    executor = ThreadPoolExecutor(threads)
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()


def one_blas_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS and LAPACK work with a single thread."""
    return _libraries("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas")


@cache
def _libraries(scipy: bool) -> Any:
    """The linear algebra of numpy and, once it is loaded, that of `scipy`: looking for them takes
    as long as some thousands of trials.
    """
    # No stubs are published for it.
    from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

    return ThreadpoolController()
