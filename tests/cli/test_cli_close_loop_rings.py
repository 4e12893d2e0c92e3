"""`mtu close-loop --datum offset,diameter`: points of rings of unknown centres and diameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_runner import report

MACHINE = """
schema: mtu/machine/1
name: measuring machine
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0.01, 0], [0, 1.0e-6]]}
  py: {of: y, unit: um, coefficients: [0, 0], covariance: [[0.01, 0], [0, 1.0e-6]]}
equations: {Ex: px, Ey: py}
"""
NOISE_UM = 0.4


def rings(folder: Path, errors: np.ndarray, several: bool) -> None:
    """Ten set-ups of one ring, or of two, off by 20 um and 5 um larger or smaller at random; of
    each 16 points, unevenly about it. `errors` (2, 2) by x and y: dE/d(x, y).
    """
    rng = np.random.default_rng(4)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 16))
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    lines = ["part,operation,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm"]
    for part in range(10):
        for k, centre in enumerate(((150, 120), (420, 260))[: 1 + several]):
            place = centre + 90 * outward
            found = place + place @ errors.T + rng.normal(0, 0.02, 2)
            found += rng.normal(0, 0.005) * outward + NOISE_UM / 1e3 * rng.normal(size=(16, 2))
            for i, row in enumerate(np.hstack([place, found])):
                numbers = ",".join(f"{value:.6f}" for value in row)
                lines.append(f"{part},ring{k},r{k}_{i},{numbers}")
    (folder / "cmm.csv").write_text("\n".join(lines) + "\n", "utf-8")
    (folder / "machine.yaml").write_text(MACHINE, "utf-8")


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize(
    ("errors", "names", "parameter", "size"),
    [
        ([[0, 0], [0, 0]], set(), "", 0.0),
        # The mean of both scales is the diameter.
        ([[20e-6, 0], [0, 0]], {"scale-x", "scale-y"}, "scale", 20.0),
        ([[0, -15e-6], [0, 0]], {"squareness-xy"}, "angle", np.degrees(15e-6) * 3600),
    ],
)
def test_what_is_left_of_a_ring_shows_squareness_and_scale(
    tmp_path: Path, errors: object, names: set[str], parameter: str, size: float, several: bool
) -> None:
    rings(tmp_path, np.array(errors), several)
    call = ("-m", "machine.yaml", "--cmm", "cmm.csv", "--datum", "offset,diameter")
    found = report("close-loop", *call, "--exclude", "cyclic", cwd=tmp_path)["results"]
    if not names:
        assert found["verdict"] == "none"
        return
    (effect,) = found["effects"]
    assert set(effect["class"]) == names
    own = effect["parameters"][parameter]
    assert abs(abs(own["value"]) - size) < 3 * own["u"] < 0.3 * size
    assert found["after"]["rms_um"] < 1.1 * NOISE_UM < found["before"]["rms_um"]
