"""`mtu close-loop` on the readings of an axis whose scale grows from its zero as it warms up."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from cli_runner import done, mtu

MACHINE = """schema: mtu/machine/1
name: axis
components:
  pos: {of: x, unit: um}
equations: {Ex: pos}
"""
TARGETS = (0, 50, 110, 170, 240, 300, 345, 400)


def read(folder: Path, seed: int, growth: float, scatter: float = 0.8) -> None:
    """Six passes there and back, a reading a minute, of an axis that grows by `growth` um/m/K from
    x = 0; the line and `scatter` um from pass to pass are not known.
    """
    rng = np.random.default_rng(seed)
    rows, minute = ["component,position_mm,pass,direction,error,unit,time_min,T_x_degC"], 0
    for number in range(1, 7):
        of_pass = rng.normal(0, scatter)
        for x, way in [(x, "forward") for x in TARGETS] + [(x, "reverse") for x in TARGETS[::-1]]:
            minute += 1
            warm = 6 * (1 - np.exp(-minute / 40)) + rng.normal(0, 0.05)
            error = 2 + 0.03 * x + of_pass + 1e-3 * growth * x * warm + rng.normal(0, 0.6)
            rows.append(f"pos,{x},{number},{way},{error:.2f},um,{minute},{20 + warm:.2f}")
    (folder / "laser.csv").write_text("\n".join(rows) + "\n", "utf-8")
    (folder / "machine.yaml").write_text(MACHINE, "utf-8")


def test_a_scale_that_grows_from_zero_is_named_and_no_scatter_any_more(tmp_path: Path) -> None:
    """The axis with its growth declared is as certain as one that does not grow: neither its
    coefficients nor its passes hold the growth again, by readings or by the report.
    """
    read(tmp_path, 1, 0.0)
    laser = ("--laser", "laser.csv")
    done(mtu("fit-components", "-m", "machine.yaml", *laser, "-o", "quiet.json", cwd=tmp_path))
    read(tmp_path, 1, 11.0)
    done(mtu("close-loop", "-m", "machine.yaml", *laser, "--write-machine", "m.yaml",
             "--write-components", "c.json", "-o", "o.json", cwd=tmp_path))  # fmt: skip
    # About the middle it is a growth and a drift, of which neither shows without the other.
    found = json.loads((tmp_path / "o.json").read_text("utf-8"))["results"]
    assert found["verdict"] in ("named", "class")
    effect = found["effects"][0]
    assert effect["name"] == "thermal-growth-x"
    growth = effect["parameters"]["growth"]
    assert growth["unit"] == "um/m/K"
    assert abs(growth["value"] - 11.0) < 4 * growth["u"]
    assert growth["u"] < 1.0
    assert found["after"]["rms_um"] < 0.5 * found["before"]["rms_um"]
    done(mtu("fit-components", "-m", "machine.yaml", *laser, "-o", "before.json", cwd=tmp_path))
    done(mtu("fit-components", "-m", "m.yaml", *laser, "-o", "after.json", cwd=tmp_path))
    quiet, before, after, written = (
        json.loads((tmp_path / f"{name}.json").read_text("utf-8"))["results"]["components"]["pos"]
        for name in ("quiet", "before", "after", "c")
    )
    assert after == written
    scatter = [item["s_pass"] for item in (quiet, before, after)]
    assert scatter[1] > 5 * scatter[0]
    assert scatter[2] < 1.5 * scatter[0]
