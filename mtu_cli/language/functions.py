"""The functions that equations know, with their number of arguments."""

from __future__ import annotations

MACHINE_FUNCTIONS: dict[str, int] = {
    "sin": 1,
    "cos": 1,
    "exp": 1,
    "log": 1,
    "sqrt": 1,
    "abs": 1,
    "step": 1,
}
"""`step(u)` is 0 for u < 0, else 1."""

BUDGET_FUNCTIONS: dict[str, int] = MACHINE_FUNCTIONS | {
    "tan": 1,
    "asin": 1,
    "acos": 1,
    "atan": 1,
    "atan2": 2,
}
"""Budgets and graphs know the other circular functions too."""
