"""A mill of two axes that errs by nothing that its model has, and eight holes of a part."""

from __future__ import annotations

MACHINE = """schema: mtu/machine/1
name: mill
components:
  px: {of: x, unit: um, coefficients: [0]}
  py: {of: y, unit: um, coefficients: [0]}
equations: {Ex: px, Ey: py}
"""
PLACES = [(20, 15), (140, 140), (265, 290), (380, 30), (35, 270), (150, 20), (270, 150), (390, 280)]
