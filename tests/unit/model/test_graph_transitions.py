"""Every transition against a value worked out by hand; nominals that determine none; chances."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_examples import graph_of

from mtu_cli.model.graph.transitions import TRANSITIONS

# P1..P4 and the planes, lines and frames that follow from them are simple enough for a head.
PLACES = """
uncertainty: {axis_um: 1}
places:
  xa: {kind: coordinate, axis: x, nominal_mm: 1}
  xb: {kind: coordinate, axis: x, nominal_mm: 5}
  ya: {kind: coordinate, axis: y, nominal_mm: 2}
  yb: {kind: coordinate, axis: y, nominal_mm: 4}
  za: {kind: coordinate, axis: z, nominal_mm: 10}
  c: {kind: constant, value: 1.5}
  r: {kind: constant, value: 3*sqrt(3)}
  O: {kind: point, nominal_mm: [0, 0, 0]}
  P: {kind: point, nominal_mm: [3, 4, 0]}
  Q: {kind: point, nominal_mm: [3, 4, 12]}
  A: {kind: point, nominal_mm: [6, 0, 0]}
  B: {kind: point, nominal_mm: [0, 6, 0]}
  D: {kind: point, nominal_mm: [0, 0, 6]}
  E: {kind: point, nominal_mm: [6, 6, 0]}
  F: {kind: point, nominal_mm: [6, 6, 6]}
  OP: {kind: vector}
  Oz: {kind: vector}
  xy: {kind: plane}
  yz: {kind: plane}
  zx: {kind: plane}
  tilted: {kind: plane}
  OA: {kind: line}
  BF: {kind: line}
  W: {kind: frame}
  result: {kind: KIND, AXIS}
  second: {kind: constant}
transitions:
  - {do: meas, out: xa}
  - {do: meas, out: xb}
  - {do: meas, out: ya}
  - {do: meas, out: yb}
  - {do: meas, out: za}
  - {do: meas, out: O, along: x}
  - {do: meas, out: P, along: x}
  - {do: meas, out: Q, along: x}
  - {do: meas, out: A, along: x}
  - {do: meas, out: B, along: x}
  - {do: meas, out: D, along: x}
  - {do: meas, out: E, along: x}
  - {do: meas, out: F, along: x}
  - {do: vector, in: [O, P], out: OP}
  - {do: vector, in: [O, D], out: Oz}
  - {do: plane, in: [O, A, B], out: xy}
  - {do: plane, in: [O, B, D], out: yz}
  - {do: plane, in: [O, D, A], out: zx}
  - {do: plane, in: [A, B, D], out: tilted}
  - {do: line, in: [O, A], out: OA}
  - {do: line, in: [B, F], out: BF}
  - {do: frame, in: [yz, BF, P], out: W}
  - {STEP}
report: [xa, xb, ya, yb, za, c, r, OP, Oz, Q, E, xy, yz, zx, tilted, OA, BF, W, REPORT]
"""
S2, S3 = math.sqrt(2), math.sqrt(3)
N3 = [1 / S3] * 3
CASES: list[tuple[Any, ...]] = [
    ("meas, out: result", "coordinate", 7.0),
    ("displace, in: [xa, c]", "coordinate", 2.5),
    ("displace, in: [P, Oz]", "point", [3, 4, 6]),
    ("middle, in: [A, F]", "point", [6, 3, 3]),
    ("vector, in: [P, F]", "vector", [3, 2, 6]),
    ("unit_v, in: [OP]", "vector", [0.6, 0.8, 0]),
    ("unit_v, in: [P, F]", "vector", [3 / 7, 2 / 7, 6 / 7]),
    ("ratio, in: [OP, c]", "vector", [4.5, 6, 0]),
    ("ratio, in: [c, c]", "constant", 2.25),
    ("length, in: [OP]", "constant", 5),
    ("length, in: [O, Q]", "constant", 13),
    ("ball, in: [xa, xb, ya, yb, za, c]", "point", [3, 3, 8.5]),
    ("hole, in: [xa, xb, ya, yb]", "point", [3, 3, 0]),
    ("hole, in: [xa, xb, ya, yb, c]", "point", [3, 3, 1.5]),
    # A, B, D: equilateral, side 6 sqrt 2; O, A, E, B: a square of side 6.
    ("circle, in: [A, B, D], out: [result, second]", "point", [2, 2, 2], 2 * math.sqrt(6)),
    ("circle, in: [O, A, E, B], out: [result, second]", "point", [3, 3, 0], 3 * S2),
    ("sphere, in: [O, A, B, D], out: [result, second]", "point", [3, 3, 3], 3 * S3),
    ("sphere, in: [O, A, B, D, E, F], out: [result, second]", "point", [3, 3, 3], 3 * S3),
    ("sphere, in: [O, A, B, D, r]", "point", [3, 3, 3]),
    ("line, in: [A, F]", "line", [[6, 0, 0], [0, 1 / S2, 1 / S2]]),
    ("line, in: [xy, zx]", "line", [[0, 0, 0], [-1, 0, 0]]),
    ("aline, in: [A, OP]", "line", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("plane, in: [D, A, B]", "plane", [[0, 0, 6], N3]),
    ("plane, in: [O, B, E, A]", "plane", [[3, 3, 0], [0, 0, -1]]),
    ("plane, in: [A, OP]", "plane", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("point, in: [BF, xy]", "point", [0, 6, 0]),
    ("point, in: [OA, tilted]", "point", [6, 0, 0]),
    ("point, in: [xy, yz, zx]", "point", [0, 0, 0]),
    ("point, in: [xy, yz, tilted]", "point", [0, 6, 0]),
    ("normal, in: [tilted]", "vector", N3),
    ("direction, in: [BF]", "vector", [1 / S2, 0, 1 / S2]),
    # O along (3, 4, 0) onto x + y + z = 6: t = 6/7.
    ("project, in: [O, OP, tilted]", "point", [18 / 7, 24 / 7, 0]),
    ("per_proj, in: [F, tilted]", "point", [2, 2, 2]),
    ("per_proj, in: [Q, OA]", "point", [3, 0, 0]),
    ("distance, in: [P, Q]", "constant", 12),
    ("distance, in: [Q, OA]", "constant", math.hypot(4, 12)),
    ("distance, in: [F, tilted]", "constant", 12 / S3),
    ("distance, in: [OA, BF]", "constant", 6),
    ("angle, in: [OP, Oz]", "constant", math.pi / 2),
    # In W: z along yz's normal x, x along BF's projection z, y = z x x = -y of the machine.
    ("frame, in: [xy, BF, D]", "frame", [[0, 0, 6], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("transform, in: [W, F]", "point", [6, -2, 3]),
    ("compute, in: [xa, c], formula: xa**2 + 2*c", "constant", 4),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case[0]))
def test_transition(case: tuple[Any, ...], tmp_path: Path) -> None:
    step, kind, expected, *radius = case
    step = f"do: {step}" + ("" if "out:" in step else ", out: result")
    axis = {"coordinate": "axis: x", "constant": "unit: '1'"}.get(kind, "says: it")
    if step.startswith("do: meas"):
        axis += ", nominal_mm: 7"
    text = PLACES.replace("STEP", step).replace("KIND", kind).replace("AXIS", axis)
    report = "result, second" if radius else "result"
    text = text.replace("REPORT", report)
    if not radius:
        text = text.replace("  second: {kind: constant}\n", "")
    found = graph_of(tmp_path, text).nominal
    assert found["result"][..., 0] == pytest.approx(np.array(expected, float), abs=1e-14)
    if radius:
        assert found["second"][0] == pytest.approx(radius[0], rel=1e-14)


def test_every_transition_is_tried() -> None:
    assert {step.split(",")[0] for step, *_ in CASES} == set(TRANSITIONS)
