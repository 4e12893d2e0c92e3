"""Correlations of a graph that contradict each other."""

from __future__ import annotations

from pathlib import Path

import pytest
from graph_examples import graph_of

from mtu_cli.findings import InputError

TEXT = """
places:
  a: {{kind: constant, value: 1, u: 1}}
  b: {{kind: constant, value: 1, u: 1}}
  c: {{kind: constant, value: 1, u: 1}}
  s: {{kind: constant}}
transitions:
  - {{do: compute, in: [a, b, c], out: s, formula: a + b + c}}
correlations: [[a, b, 0.9], [b, c, 0.9], [a, c, {r}]]
"""


@pytest.mark.parametrize(("r", "sound"), [(0.62, True), (0.619, False), (1.0, True)])
def test_the_ends_of_the_range(tmp_path: Path, r: float, sound: bool) -> None:
    """Of r_ab = 0.9, r_bc = 0.9: r_ac from 2*0.81 - 1 = 0.62 to 1."""
    if sound:
        graph_of(tmp_path, TEXT.format(r=r))
    else:
        with pytest.raises(InputError, match=r"correlations: .* not positive semi-definite"):
            graph_of(tmp_path, TEXT.format(r=r))
