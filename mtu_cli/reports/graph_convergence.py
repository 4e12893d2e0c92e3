"""What graph simulate and sweep say of trials that ended before their digits, and of chances."""

from __future__ import annotations

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.reports.numbers import plus_minus, significant, with_u
from mtu_cli.stats.rare_jumps import UNSEEN

BOUNDS = f"< and >: none or all of n trials are 1, and {UNSEEN:g}/n bounds the chance (95 %)"


def not_converged(trials: int, digits: int, what: str) -> Finding:
    """The warning of so many trials; `what`: of which places, or how far they have come."""
    goal = f"{counted(digits, 'significant digit')} of u (JCGM 101, 7.9.4), {what}"
    return finding("not-converged", trials=trials, goal=goal)


def one_sided(chance: float, error: float) -> bool:
    """Whether none or all of the trials of what varies hit: there is a bound, and no spread."""
    return error > 0.0 and chance in (0.0, 1.0)


def chance_text(chance: float, error: float, trials: int) -> str:
    """ "0.796 ± 0.016", or the bound that is left where none or all of the trials hit.

    With a chance of 3/n, n trials hit nothing one time in 20: (1 - p)^n is about e^(-n p).
    """
    if not one_sided(chance, error):
        return plus_minus(chance, error)
    bound = min(UNSEEN / trials, 1.0)
    return f"< {significant(bound)}" if chance == 0.0 else f"> {with_u(1.0 - bound, bound)[0]}"
