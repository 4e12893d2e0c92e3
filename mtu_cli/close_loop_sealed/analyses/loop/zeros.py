"""Where effects of a covariate are none, by their equations."""

from __future__ import annotations

import math

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.findings import InputError
from mtu_cli.language import Node, evaluate, linear_form, names, parse

DIGITS = 14
"""Of a zero: two roundings of a product and a quotient are less."""
ANYWHERE = ((1.6180339887498949, 0.7182818284590452), (0.5772156649015329, 1.4142135623730951))
"""Two choices of what else an equation depends on, each a first value and a step from name to name:
no place or direction by chance makes it 0.
"""


def zeros_of(effect: FoundEffect) -> tuple[float, ...]:
    """The values of its covariate at which an effect is 0 along one of its axes, but for its
    levels; ascending, none of an equation that is not linear in it, or that is 0 at another value
    with what else it depends on.
    """
    found = (_zero(effect, text) for text in effect.equations.values())
    return tuple(sorted({zero for zero in found if zero is not None}))


def _zero(effect: FoundEffect, text: str) -> float | None:
    """That of one equation, of which all sizes must have it."""
    if effect.covariate is None:
        return None
    levers = linear_form(parse(text), [name for name, *_ in effect.parameters]).coefficients
    own = [levers[name] for name, *_ in effect.sizes if name in levers]
    zeros = {_of_lever(lever, effect.covariate) for lever in own}
    return zeros.pop() if len(zeros) == 1 else None


def _of_lever(lever: Node, covariate: str) -> float | None:
    """Where a c + b is 0 in a covariate c, -b/a, whatever a and b depend on."""
    try:
        form = linear_form(lever, [covariate])
    except InputError:
        return None
    if covariate not in form.coefficients:
        return None
    others = [name for name in names(lever) if name != covariate]
    zeros = set()
    for first, step in ANYWHERE:
        at = {name: first + step * i for i, name in enumerate(others)}
        a = float(evaluate(form.coefficients[covariate], at))
        b = 0.0 if form.remainder is None else float(evaluate(form.remainder, at))
        if a == 0 or not math.isfinite(b / a):
            return None
        zeros.add(float(f"{-b / a:.{DIGITS}g}") + 0.0)
    return zeros.pop() if len(zeros) == 1 else None
