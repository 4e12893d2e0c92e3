"""What graph simulate and sweep say of trials that ended before their digits."""

from __future__ import annotations

from mtu_cli.model.settings import Warned


def not_converged(trials: int, digits: int, what: str) -> Warned:
    """The warning of so many trials; `what`: of which places, or how far they have come."""
    plural = "s" if digits > 1 else ""
    return Warned(
        code="not-converged",
        message=f"{trials} Monte Carlo trials: not converged to {digits} significant "
        f"digit{plural} of u (JCGM 101, 7.9.4), {what}",
    )
