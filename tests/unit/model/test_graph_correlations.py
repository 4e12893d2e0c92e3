"""Correlations of a graph that contradict each other: which pair, and what it may be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from graph_examples import graph_of

from mtu_cli.findings import InputError

TEXT = """
places:
  a: {{kind: constant, value: 1, u: 1}}
  b: {{kind: constant, value: 1, u: 1}}
  c: {{kind: constant, value: 1, u: 1}}
  d: {{kind: constant, value: 1, u: 1}}
  s: {{kind: constant}}
transitions:
  - {{do: compute, in: [a, b, c, d], out: s, formula: a + b + c + d}}
correlations: {pairs}
"""


def test_the_pair_and_its_range(tmp_path: Path) -> None:
    """Of r_ab = 0.9, r_bc = 0.9: r_ac from 2*0.81 - 1 = 0.62 to 1."""
    text = TEXT.format(pairs="[[a, b, 0.9], [b, c, 0.9], [a, c, -0.9]]")
    with pytest.raises(InputError, match=r"'a, c, -0.9'; expected 0\.62 to 1, as") as error:
        graph_of(tmp_path, text)
    assert "correlations[2]: the correlations contradict" in str(error.value)


@pytest.mark.parametrize(("r", "sound"), [(0.62, True), (0.619, False), (1.0, True)])
def test_the_ends_of_the_range(tmp_path: Path, r: float, sound: bool) -> None:
    text = TEXT.format(pairs=f"[[a, b, 0.9], [b, c, 0.9], [a, c, {r}]]")
    matrix = np.array([[1, 0.9, r], [0.9, 1, 0.9], [r, 0.9, 1]])
    assert (np.linalg.eigvalsh(matrix)[0] > -1e-9) == sound
    if sound:
        graph_of(tmp_path, text)
    else:
        with pytest.raises(InputError, match=r"expected 0\.62 to 1"):
            graph_of(tmp_path, text)


def test_where_no_single_pair_is_to_blame(tmp_path: Path) -> None:
    """All six at -0.6: each three of them contradict each other already."""
    names = ("a", "b", "c", "d")
    pairs = [f"[{x}, {y}, -0.6]" for x in names for y in names if x < y]
    with pytest.raises(InputError, match="not positive semi-definite"):
        graph_of(tmp_path, TEXT.format(pairs=f"[{', '.join(pairs)}]"))
