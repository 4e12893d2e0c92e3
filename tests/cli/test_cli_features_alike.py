"""Two features of a part at one place are asked about."""

from __future__ import annotations

from pathlib import Path

from cli_runner import done, mtu
from support import CONFIGS


def test_of_a_part(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: plate\nfeatures:\n"
        "  A: {x_mm: 10, y_mm: 20}\n  B: {x_mm: 50, y_mm: 20}\n  C: {x_mm: 10, y_mm: 20}\n"
    )
    machine = CONFIGS / "gilsinn-ling" / "machine.yaml"
    told = done(mtu("predict-points", "-m", machine, "-p", "part.yaml", "-q", cwd=tmp_path)).stderr
    assert "part.yaml:6: features.C: features at the same nominal place: A, C" in told
