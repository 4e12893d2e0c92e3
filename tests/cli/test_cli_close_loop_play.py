"""`mtu close-loop` of lost motion that begins at one part, as after a crash."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runner import done, mtu
from plain_mill import MACHINE, PLACES

PLAY = 3.0
"""um; half the reversal value."""


@pytest.mark.parametrize("first", [6, 13])
def test_lost_motion_from_one_part_on_is_told_with_its_part(first: int, tmp_path: Path) -> None:
    """Of twenty parts, in which every hole is reached from both sides in turn."""
    rng = np.random.default_rng(first)
    (tmp_path / "machine.yaml").write_text(MACHINE, "utf-8")
    features = "".join(f"  h{i}: {{x_mm: {x}, y_mm: {y}}}\n" for i, (x, y) in enumerate(PLACES))
    text = "schema: mtu/part/1\nname: plate\nfeatures:\n" + features
    (tmp_path / "part.yaml").write_text(text, "utf-8")
    rows = ["part,feature,x_mm,y_mm,sequence,dir_x,dir_y"]
    for part in range(1, 21):
        for i, (x, y) in enumerate(PLACES):
            way = (-1) ** (part + i), (-1) ** (part + i // 2)
            ex, ey = rng.normal(0, 1.3e-3, 2)
            ey += 1e-3 * PLAY * way[1] * (part >= first)
            rows.append(f"{part},h{i},{x + ex:.5f},{y + ey:.5f},{part},{way[0]},{way[1]}")
    (tmp_path / "cmm.csv").write_text("\n".join(rows) + "\n", "utf-8")
    result = mtu(
        "close-loop", "-m", "machine.yaml", "--part", "part.yaml", "--cmm", "cmm.csv",
        "-o", "o.json", cwd=tmp_path,
    )  # fmt: skip
    said = " ".join(done(result).stdout.split())
    assert f"um at reversal from part {first} on (backlash-step-y)" in said
    found = json.loads((tmp_path / "o.json").read_text("utf-8"))["results"]
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    play = effect["parameters"]["lost_motion"]
    assert abs(play["value"] - PLAY) < 4 * play["u"]
    assert play["u"] < 0.3
