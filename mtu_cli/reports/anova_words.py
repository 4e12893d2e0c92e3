"""What an analysis of variance says in sentences: what stands out, what cannot be had."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.anova import AnovaResult
from mtu_cli.analyses.anova.axis_scatter import AxisScatter
from mtu_cli.analyses.anova.features import UnusualFeature
from mtu_cli.analyses.anova.parts import FAMILY_RATE, UnusualPart
from mtu_cli.reports.numbers import p_value, significant, span, with_u
from mtu_cli.stats.scatter_ratio import FEWEST_ROWS
from mtu_cli.units import ARCSEC, UM

SIGNIFICANT = 0.05
MOST_NAMED = 6
UNITS = {"feature": ("um", UM), "length": ("um", UM), "angle": ("arcsec", ARCSEC)}


def sentences(result: AnovaResult) -> list[str]:
    """What can be had, unusual parts and features, and the axes' scatter, in words."""
    rate = f"{100 * FAMILY_RATE:g} %"
    found = _limits(result)
    parts = len(result.features.tables.parts)
    if result.unusual is None and parts > 1:
        found.append(f"{parts} parts are too few to say whether one stands out.")
    elif result.unusual == ():
        found.append(f"No part stands out (false alarm rate {rate} over the whole study).")
    found += [_unusual(item) for item in result.unusual or ()]
    found += _features(result)
    found += [_axes(item) for item in result.axis_scatter]
    if sum(bool(np.isfinite(item.test.p)) for item in result.axis_scatter) > 1:
        found[-1] += " These p hold for all operations together (Holm)."
    return found


def _limits(result: AnovaResult) -> list[str]:
    one = result.features.one_way
    repeats, several = bool((one.df_within > 0).any()), bool((one.df_between > 0).any())
    if not several and not repeats:
        return [
            "One part, measured once: its errors are below. The scatter from part to part needs "
            "further parts, the CMM's a repeated measurement."
        ]
    if not several:
        return [
            "One part: its mean errors and the CMM's scatter are below. The scatter from part to "
            "part, and so an uncertainty for a future part, needs further parts."
        ]
    if not repeats:
        return [
            "No repeats: the scatter from part to part holds the CMM's. To tell them apart, "
            "measure some parts twice."
        ]
    return []


def _unusual(item: UnusualPart) -> str:
    operation, name, axis = item.where
    unit, size = UNITS.get(axis, UNITS["feature"])
    deviation, typical = item.deviation / size, significant(item.typical / size)
    kinds = {"length": "in its lengths", "angle": "in its right angles"}
    place = kinds.get(axis, f"in {axis}")
    if name:
        place = f"at {'' if axis in kinds else 'feature '}{name} {place}"
    place += f" ({operation})" if operation else ""
    if item.why == "distance":
        text = f"is {significant(deviation)} {unit} off {place} (root mean square)"
    else:
        text = f"lies {with_u(deviation, item.typical / size)[0]} {unit} from the mean {place}"
        text += "" if name else ", all features together"
    return f"Part {item.part} stands out: it {text}; other parts: {typical} {unit} ({_p(item.p)})."


def _features(result: AnovaResult) -> list[str]:
    found = [_feature(item) for item in result.unusual_features[:MOST_NAMED]]
    more = result.unusual_features[MOST_NAMED:]
    if more:
        names = dict.fromkeys(" ".join(word for word in item.where if word) for item in more)
        listed = ", ".join(list(names)[:MOST_NAMED])
        rest = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        found.append(f"Likewise {listed}{rest}.")
    return found


def _feature(item: UnusualFeature) -> str:
    operation, name, axis = item.where
    deviation, typical = item.deviation / UM, item.typical / UM
    place = f"in {axis}" + (f" ({operation})" if operation else "")
    return (
        f"Feature {name} stands out: its mean error {place} lies "
        f"{with_u(deviation, typical)[0]} um "
        f"from the other features'; they scatter by {significant(typical)} um ({_p(item.p)})."
    )


def _p(value: float) -> str:
    shown = p_value(value)
    return f"p {shown}" if shown.startswith("<") else f"p = {shown}"


def _axes(item: AxisScatter) -> str:
    text = _compared(item)
    if item.operation:
        return f"{item.operation}: {text}"
    # A sentence begins with a capital, the letter of an axis stays as it is.
    return text if text[1] == " " else text[0].upper() + text[1:]


def _compared(item: AxisScatter) -> str:
    test = item.test
    if test.rows < FEWEST_ROWS:
        return f"{test.rows} parts are too few to compare the scatter in x and y."
    if not np.isfinite(test.p):
        return "nothing scatters from part to part in x or y."
    p, sure = _p(test.p_familywise), test.p_familywise <= SIGNIFICANT
    of = "from part to part" if item.apart else "in their part means, the CMM's scatter included"
    s, low, high = (float(np.sqrt(value)) for value in (test.ratio, *item.interval))
    if np.isnan(low):
        axis, other = ("x", "y") if s == 0 else ("y", "x")
        chance = "" if sure else ", which may be chance"
        return f"parts scatter in {axis}, and not to be seen in {other} ({p}{chance})."
    if not sure:
        known = f"s ratio y/x {significant(s)}, " if np.isfinite(s) else "s ratio y/x "
        return (
            f"no sign that y scatters more than x or less {of} ({known}{_within(low, high)}, {p})."
        )
    more, less = ("y", "x") if not s < 1 else ("x", "y")
    if more == "x":
        s, low, high = (1 / value if value > 0 else float("inf") for value in (s, high, low))
    if low <= 1:
        return f"{more} scatters more than {less} {of} ({p})."
    if not np.isfinite(high) or not np.isfinite(s):
        return f"{more} scatters at least {significant(low)} times as much as {less} {of} ({p})."
    times = f"{significant(s)} times as much as"
    return f"{more} scatters {times} {less} {of} ({_within(low, high)}, {p})."


def _within(low: float, high: float) -> str:
    """A 95 % interval in words; it may begin at 0 and be open above."""
    if not np.isfinite(high):
        return f"95 %: {significant(low)} or more" if low > 0 else "95 %: no bounds"
    return f"95 %: {span(significant(low), significant(high))}"
