"""The ring gauge of Valdes, Di Giacomo & Paziani on simulated machines with drift, corrected.

Eight places, rooms of 19, 20 and 26 degC, and beside each ring of 180 mm one of 90 mm about the
same centre: raw errors from 2 to 45 um. The paper's claims, above 10 um at least 90 % less and
below at least 75 %, are about means: a ring's own share is limited by the machine's repeatability,
which leaves 0.55 um whatever the error was.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_runner import done, mtu
from numpy.typing import NDArray
from support import CONFIGS

from mtu_cli.stats.least_squares import FloatArray

RING = CONFIGS / "valdes-ring"
ROOMS = (20.0, 26.0, 19.0)
DIAMETERS = {"": {19: 180.0122, 20: 180.0124, 26: 180.0137}, "s": {19: 90.0061, 20: 90.0062,
             26: 90.00685}}  # fmt: skip
SEEDS = (1, 2)
OFFSETS = {"Y34": 280.0, "X23": -620.0, "Z12": 120.0, "Z45": -180.0}
"""Offsets of truth.yaml, mm, which the machine file knows to 0.5 mm."""
DRIFT = (
    *("--drift-positions", "ry_x: 0 300", "--drift-positions", "yaw_y: 0 300"),
    *("--settled-drift", "pos_y: 28 -4 -34 -38", "--settled-drift", "ry_x: 30 30"),
    *("--settled-drift", "yaw_y: 30 30", "--twin", "T_18_degC: T_02_degC"),
    # A warm-up and a cool-down: of four of them the rings come out the same to 0.1 %.
    *("--cycles", "2"),
)


def with_small_rings(path: Path) -> None:
    """The shipped part, with a ring of half the diameter in every ring."""
    part = yaml.safe_load((RING / "part.yaml").read_text())
    features, circles = part["features"], []
    for ring in part["circles"]:
        own = [features[name] for name in ring["features"]]
        place = np.array([[item["x_mm"], item["y_mm"]] for item in own])
        design = np.column_stack([2 * place, np.ones(len(place))])
        centre = np.linalg.lstsq(design, np.sum(place**2, axis=1), rcond=None)[0][:2]
        for name, item, (x, y) in zip(ring["features"], own, (place + centre) / 2, strict=True):
            features[f"s{name}"] = {"x_mm": float(x), "y_mm": float(y), "z_mm": item["z_mm"]}
        names = [f"s{name}" for name in ring["features"]]
        circles += [
            ring | {"calibrated_mm": DIAMETERS[""]},
            ring | {"id": f"s{ring['id']}", "features": names, "calibrated_mm": DIAMETERS["s"]},
        ]
    path.write_text(yaml.safe_dump(part | {"circles": circles}))


@dataclass(frozen=True)
class Rings:
    """Diameters less the true ones before and after (n,), um, and whether 95 % hold them."""

    before: FloatArray
    after: FloatArray
    held: NDArray[np.bool_]


def measured(folder: Path, seed: int) -> list[dict[str, object]]:
    """The rings of one machine as `correct` reports them."""
    truth = (RING / "truth.yaml").read_text()
    for rng, (name, value) in zip(np.random.default_rng(seed).spawn(4), OFFSETS.items(),
                                  strict=True):  # fmt: skip
        own = value + 0.5 * rng.standard_normal()
        truth, count = re.subn(rf"{name}: {{value: [-\d.]+", f"{name}: {{value: {own:.4f}", truth)
        assert count == 1
    (folder / "truth.yaml").write_text(truth)
    with_small_rings(folder / "part.yaml")
    rooms = [word for room in ROOMS for word in ("--cmm-room", room)]
    of_part = "T_ring_degC: 20 + 6*(sequence - 1) - 6.5*(sequence - 1)*(sequence - 2)"
    done(mtu("simulate", "-m", "truth.yaml", "-p", "part.yaml", "--seed", seed, "--passes", 5,
             "--positions", "x=0:500:8,y=0:350:8,z=-300:0:8", *DRIFT, *rooms, "--parts", 3,
             "--repeats", 1, "--cmm-u-um", 0.3, "--covariate", of_part, "--interval-min", 2,
             "--write-lbb", "laser.csv", "--write-drift", "drift.csv", "--write-cmm", "ring.csv",
             cwd=folder))  # fmt: skip
    done(mtu("thermal-fit", "-m", RING / "machine.yaml", "--drift", "drift.csv", "--model", "ridge",
             "-o", "t.json", "-q", cwd=folder))  # fmt: skip
    done(mtu("correct", "-m", RING / "machine.yaml", "-p", "part.yaml", "--laser", "laser.csv",
             "-c", "t.json", "--cmm", "ring.csv", "-o", "o.json", cwd=folder))  # fmt: skip
    found: list[dict[str, object]] = json.loads((folder / "o.json").read_text())["results"][
        "circles"
    ]
    return found


@pytest.fixture(scope="module")
def rings(tmp_path_factory: pytest.TempPathFactory) -> Rings:
    before, after, held = [], [], []
    for seed in SEEDS:
        for item in measured(tmp_path_factory.mktemp("machine"), seed):
            size = "s" if str(item["id"]).startswith("s") else ""
            true = DIAMETERS[size][round(float(str(item["temperature_degC"])))]
            found, interval = item["diameter_mm"], item["interval95_mm"]
            assert isinstance(found, dict)
            assert isinstance(interval, list)
            before.append(1e3 * (found["before"] - true))
            after.append(1e3 * (found["after"] - true))
            held.append(interval[0] <= true <= interval[1])
    assert len(before) == len(SEEDS) * len(ROOMS) * 16
    return Rings(np.array(before), np.array(after), np.array(held))


@pytest.mark.parametrize(
    ("low", "high", "share", "fewest"), [(10.0, 99.0, 90.0, 40), (4.0, 10.0, 75.0, 25)]
)
def test_errors_fall_as_the_paper_says(
    rings: Rings, low: float, high: float, share: float, fewest: int
) -> None:
    size = np.abs(rings.before)
    own = (size >= low) & (size < high)
    assert own.sum() >= fewest
    left = np.abs(rings.after[own])
    assert 100 * (1 - left.mean() / size[own].mean()) >= share
    # Single rings miss it where chance leaves more than the share of a small error.
    assert np.mean(100 * (1 - left / size[own]) >= share) >= 0.9


def test_no_residual_is_above_3_um(rings: Rings) -> None:
    assert np.abs(rings.after).max() <= 3
    assert np.abs(rings.before).max() > 40


def test_intervals_hold_the_true_diameter(rings: Rings) -> None:
    """Rings of one machine share its geometry and drift: they count as half their number."""
    number = len(rings.held) / 2
    assert abs(rings.held.mean() - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / number)
