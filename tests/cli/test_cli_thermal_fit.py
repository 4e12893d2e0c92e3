"""The installed `mtu thermal-fit` on drift that the published gradients make."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from cli_runner import done, mtu
from support import CONFIGS

CMM = CONFIGS / "valdes-cmm" / "machine.yaml"
TWINS = ("T_02_degC", "T_18_degC")
SENSOR_NOISE, READING_NOISE = 0.015, 0.25
UNIT = {"pos_y": "um", "ry_x": "um", "yaw_y": "arcsec"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drift tests of the machine of Valdes et al. by its printed gradients alone, and the fit.

    Four cycles, thermocouples that read to 0.015 K and an instrument that reads to 0.25 um. The
    drifts are of 30 to 60 um rms: see `floor` for why they cannot be much smaller.
    """
    path = tmp_path_factory.mktemp("cmm")
    machine, count = re.subn(r"s_leftover: 0\.\d+", "s_leftover: 0", CMM.read_text("utf-8"))
    assert count == 3
    (path / "machine.yaml").write_text(machine, "utf-8")
    done(mtu("simulate", "-m", "machine.yaml", "--seed", 2, "--write-drift", "drift.csv",
             "--interval-min", 1, "--sensor-noise-degC", SENSOR_NOISE,
             "--reading-noise-um", READING_NOISE, "--reading-noise-arcsec", READING_NOISE,
             "--twin", "T_18_degC: T_02_degC", "--settled-drift", "pos_y: 56 -8 -68 -76",
             "--settled-drift", "ry_x: 60", "--settled-drift", "yaw_y: 60", cwd=path))  # fmt: skip
    done(mtu("thermal-fit", "-m", "machine.yaml", "--drift", "drift.csv", "-o", "t.json",
             "--csv", "t.csv", cwd=path))  # fmt: skip
    return path


def floor(name: str) -> float:
    """What single readings of the sensors leave of a drift whose true gradients g are known.

    u^2 = s^2 + mean over positions of sum_s (g_s u_s)^2, with the reading's noise s and the
    sensors' u_s, that of the twins' mean by sqrt 2 less. It is 0.40 to 0.46 um (arcsec) here: no
    model of the same readings takes 98 % off drifts of less than 20 to 23 um rms.
    """
    thermal = yaml.safe_load(CMM.read_text("utf-8"))["components"][name]["thermal"]
    gradients = {sensor: np.atleast_1d(g) for sensor, g in thermal["gradients"].items()}
    squares = sum(g**2 / (2 if sensor in TWINS else 1) for sensor, g in gradients.items())
    return float(np.sqrt(READING_NOISE**2 + np.mean(squares) * SENSOR_NOISE**2))


@pytest.fixture(scope="module")
def found(folder: Path) -> dict[str, Any]:
    components: dict[str, Any] = json.loads((folder / "t.json").read_text())["results"][
        "components"
    ]
    assert set(components) == set(UNIT)
    return components


def test_held_out_errors_come_near_to_what_noise_leaves(found: dict[str, Any]) -> None:
    """White noise fitted with k columns of N independent rows each read m times over.

    The mean held-out variance is 1 + k/(N - k - 1)/m floors: three cycles of 190 min, in which
    draughts of 15 min memory pass, make N about 40 of the 573 readings, and 17 sensors give
    1.06. Its own standard deviation, of 764 readings and of how the cycles happen to differ, is
    0.05 each: the rms is 1.03 +- 0.04 floors, and three standard deviations are allowed. Over the
    components it is no worse than that of all sensors by least squares: on a single one chance
    decides between models that are alike.
    """
    ratios = []
    for name, item in found.items():
        held, unit = item["held_out"], UNIT[name]
        before, after = held[f"rms_before_{unit}"], held[f"rms_after_{unit}"]
        assert item["unit"] == unit
        assert before > 50 * floor(name)
        assert after <= 0.02 * before
        assert (1.03 - 3 * 0.04) * floor(name) < after < (1.03 + 3 * 0.04) * floor(name)
        ratios.append(after / held[f"ordinary_{unit}"])
    assert np.mean(ratios) <= 1
    assert (found["pos_y"]["degree"], found["ry_x"]["degree"]) == (3, 0)
    assert found["pos_y"]["positions_mm"] == [0, 75, 200, 300]


def test_angles_without_a_machine_are_told_in_arcsec(folder: Path, tmp_path: Path) -> None:
    """Their numbers are those of the same fit with the machine; lengths stay in um."""
    lines = (folder / "drift.csv").read_text().splitlines()
    head = [line for line in lines if line.startswith("component")]
    kept = [line for line in lines if line.startswith(("yaw_y,", "ry_x,"))]
    (tmp_path / "d.csv").write_text("\n".join([*head, *kept]))
    done(mtu("thermal-fit", "--drift", "d.csv", "--model", "ridge", "-o", "t.json", cwd=tmp_path))
    done(mtu("thermal-fit", "-m", folder / "machine.yaml", "--drift", "d.csv", "--model", "ridge",
             "-o", "m.json", cwd=tmp_path))  # fmt: skip
    alone, known = (
        json.loads((tmp_path / name).read_text())["results"]["components"]
        for name in ("t.json", "m.json")
    )
    for name in ("yaw_y", "ry_x"):
        assert alone[name]["unit"] == UNIT[name]
        key = f"rms_after_{UNIT[name]}"
        assert alone[name][key] == pytest.approx(known[name][key], rel=1e-6)
