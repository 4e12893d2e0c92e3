"""What the graph's commands are given: the file, `--vary` and `--of`, from text to values."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.option_values import no_number
from mtu_cli.cli.options import Options
from mtu_cli.files.graph import load_graph
from mtu_cli.findings import Finding, InputError, error, finding, suggestion
from mtu_cli.model.graph.examine import examine
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, build_graph

EXAMPLE = "--vary axis_um=0.5:2.5:5, say (from 0.5 to 2.5 in 5 steps), or --vary repeats=1,2,4"
MOST = 10_000
DIGITS = 12
"""Digits of a value that count."""


def loaded_graph(inputs: Inputs) -> MeasurementGraph:
    """The graph of the call's file, checked whole."""
    loaded = load_graph(inputs.options.file, examine)
    inputs.sources.append(loaded.source)
    return build_graph(loaded)


def outputs_wanted(options: Options) -> tuple[str, ...]:
    """The places or coordinates of --of."""
    return tuple(options.of or ())


def varied(options: Options, known: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """The values of every --vary, by name, in the order given.

    Raises InputError for all that cannot be read, at once.
    """
    if not options.vary:
        raise error("option-form", path="--vary", form="NAME=VALUES", expected=EXAMPLE)
    found: dict[str, tuple[float, ...]] = {}
    faults: list[Finding] = []
    for text in options.vary:
        name, equals, listed = (part.strip() for part in text.partition("="))
        own = f"--vary {name}"
        values = _values(listed) if equals else None
        if equals and name not in known:
            near = suggestion(name, known)
            faults.append(finding("unknown-name", path="--vary", what="name", value=name, **near))
        elif equals and _bad_count(listed):
            expected = f"LOW:HIGH:COUNT with a count from 2 to {MOST}"
            faults.append(finding("out-of-range", path=own, value=listed, expected=expected))
        elif bad := _bad_number(own, listed):
            faults.append(bad)
        elif values is None:
            form = "NAME=VALUES"
            faults.append(
                finding("option-form", path="--vary", form=form, value=text, expected=EXAMPLE)
            )
        elif name in found or len(set(values)) < len(values):
            faults.append(finding("appears-twice", what=own, value=text))
        else:
            found[name] = values
    if faults:
        raise InputError(faults)
    return found


def _bad_count(text: str) -> bool:
    """Whether ``low:high:count`` has a whole count that is too small or too large."""
    try:
        return text.count(":") == 2 and not 2 <= int(text.split(":")[2]) <= MOST
    except ValueError:
        return False


def _bad_number(option: str, text: str) -> Finding | None:
    """The first of listed numbers, or of both ends of a range and their count, that is none."""
    parts = text.split(":") if ":" in text else text.split(",")
    if not all(part.strip() for part in parts):
        return None
    found = (
        no_number(option, part, whole=":" in text and place == 2)
        for place, part in enumerate(parts)
    )
    return next((bad for bad in found if bad), None)


def _values(text: str) -> tuple[float, ...] | None:
    """Numbers from ``low:high:count``, downwards too, or ``a,b,c``; None where it is neither."""
    try:
        if ":" not in text:
            values = [float(part) for part in text.split(",")]
        else:
            low, high, count = text.split(":")
            first, last, steps = float(low), float(high), int(count)
            if not 2 <= steps <= MOST:
                return None
            width = (last - first) / (steps - 1)
            values = [first + i * width for i in range(steps - 1)] + [last]
    except ValueError:
        return None
    # 1:5:5 has whole steps but for rounding.
    values = [float(f"{value:.{DIGITS}g}") for value in values]
    return tuple(values) if all(map(math.isfinite, values)) else None
