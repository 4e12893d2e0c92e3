"""Nobody computes something else: results against each other, before anything is timed."""

from __future__ import annotations

from collections.abc import Sequence

from peers_bench.accuracy import plain_errors
from peers_bench.problem import ARCSEC, Found
from peers_bench.workers import Worker

TRIALS = 100_000
SIGMAS = 4.5
"""Standard errors that the largest of some twenty differences does not reach by chance."""
FIRST_ORDER = 1e-5
"""Relative difference of first-order u: derivatives by differences have no more digits."""


class DisagreementError(Exception):
    """Two packages answer the same question differently."""


def check(workers: Sequence[Worker]) -> list[str]:
    """A line for each form; the first worker is `mtu`, the others are held against it.

    Raises DisagreementError.
    """
    ours = Found(*workers[0].ask("drawn", trials=10 * TRIALS, seed=7)["found"])
    value, u = workers[0].ask("first_order")["found"]
    lines = [f"mtu: u {ARCSEC * ours.u:.4f} arcsec, first order {ARCSEC * u:.4f}"]
    of_u, of_ends = plain_errors(TRIALS)
    for worker in workers[1:]:
        said = [worker.tool.name + ":"]
        if worker.tool.monte_carlo:
            found = Found(*worker.ask("drawn", trials=TRIALS, seed=11)["found"])
            allowed = (of_u, of_ends, of_ends)
            off = [(a - b) / ours.u / se for a, b, se in zip(found, ours, allowed, strict=True)]
            said.append("u, low, high off by " + ", ".join(f"{x:+.1f}" for x in off) + " se")
            if max(map(abs, off)) > SIGMAS:
                raise DisagreementError(" ".join(said))
        if worker.tool.first_order:
            own_value, own_u = worker.ask("first_order")["found"]
            off = [own_u / u - 1, (own_value - value) / u]
            said.append("first order off by " + ", ".join(f"{x:+.0e}" for x in off))
            if max(map(abs, off)) > FIRST_ORDER:
                raise DisagreementError(" ".join(said))
        lines.append(" ".join(said))
    return lines
