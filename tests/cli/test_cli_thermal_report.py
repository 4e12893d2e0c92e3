"""A thermal-fit report in the hands of the commands that use it."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, mtu, refused

MACHINE = """\
schema: mtu/machine/1
name: m
components:
  a: {unit: um, coefficients: [1], u_future: 0.1, thermal: {gradients: {T_a_degC: 2.0}}}
  b: {unit: um, coefficients: [1], u_future: 0.1, thermal: {gradients: {T_b_degC: -1.0}}}
equations: {Ex: a, Ey: b}
"""
PART = "schema: mtu/part/1\nname: p\nfeatures: {f: {x_mm: 1, y_mm: 2, z_mm: 0}}\n"


@pytest.mark.parametrize(("cycles", "times"), [(2, 1), (3, 0)])
def test_a_model_that_nothing_was_held_out_of_says_so_once(
    tmp_path: Path, cycles: int, times: int
) -> None:
    (tmp_path / "m.yaml").write_text(MACHINE)
    (tmp_path / "p.yaml").write_text(PART)
    done(mtu("simulate", "-m", "m.yaml", "-p", "p.yaml", "--cycles", cycles, "--write-drift",
             "d.csv", cwd=tmp_path))  # fmt: skip
    fitted = done(mtu("thermal-fit", "-m", "m.yaml", "--drift", "d.csv", "-o", "t.json",
                      cwd=tmp_path))  # fmt: skip
    assert fitted.stderr.count("[not-held-out]") == 2 * times
    predicted = done(mtu("predict-points", "-m", "m.yaml", "-p", "p.yaml", "-c", "t.json",
                         "--at", "T_a_degC=23", "--at", "T_b_degC=23", cwd=tmp_path))  # fmt: skip
    assert predicted.stderr.count("[reported]") == 2 * times
    assert ("warning: t.json: a: there are two cycles: " in predicted.stderr) == (times > 0)
    # A report of drifts alone gives no components.
    known = "unit: um, coefficients: [1], u_future: 0.1,"
    (tmp_path / "m.yaml").write_text(MACHINE.replace(known, "unit: um,"))
    message = refused(tmp_path, "predict-points", "-m", "m.yaml", "-p", "p.yaml", "-c", "t.json")
    for name in ("a", "b"):
        assert f"components.{name}: an estimate of {name} is missing; exp" in message
    assert "coefficients here, or a components" in message
