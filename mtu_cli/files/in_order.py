"""Work on the pieces of a file on all cores, its results in the order of the pieces."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from typing import TypeVar

_KEPT = 31 << 20
_MOST_THREADS = 4

Piece = TypeVar("Piece")
Result = TypeVar("Result")


def in_order(work: Callable[[Piece], Result], pieces: Iterable[Piece]) -> Iterator[Result]:
    """`work` of every piece in order; few pieces are taken, and done, ahead of their use."""
    rest = iter(pieces)
    first = list(islice(rest, 2))
    threads = min(_MOST_THREADS, os.cpu_count() or 1)
    if threads < 2 or len(first) < 2:
        yield from map(work, chain(first, rest))
        return
    # The C library hands the memory of every piece back to the system, to ask for it again,
    # until it has seen a larger one freed (glibc; at most 32 MiB). This takes no memory.
    bytes(_KEPT)
    with ThreadPoolExecutor(threads) as pool:
        pending: deque[Future[Result]] = deque()
        try:
            for piece in chain(first, rest):
                pending.append(pool.submit(work, piece))
                if len(pending) > 2 * threads:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
