"""Effects of `simulate` in another unit than is meant: asked about, and written all the same."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, mtu, prepared

ASKS = "more than a machine errs by; expected mm, 0.003 for 3 um"


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A copy of the small study."""
    return prepared(tmp_path / "work")


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (["--effect", "Ex: 3*dir_x"], "--effect Ex is 3 mm in part 1 at feature 'A'"),
        (
            ["--effect", "Ey: -0.8*sequence*dir_y", "--reverse-every", "2"],
            "--effect Ey is -2.4 mm in part 3 at feature 'A'",
        ),
        (
            ["--scatter", "Ey: 2 + 0.01*x", "--repeats", "3"],
            "--scatter Ey is 4 mm in part 1 at feature 'C'",
        ),
        (
            ["--effect", "Ex: 1*(T_a_degC - 20)", "--covariate", "T_a_degC: 22"],
            "--effect Ex is 2 mm in part 1 at feature 'A'",
        ),
        (["--effect", "Ex: 0.003*dir_x", "--effect", "Ey: 0.2*sequence"], ""),
        (["--effect", "Ex: 0.001*(T_a_degC - 20)", "--covariate", "T_a_degC: 30 + sequence"], ""),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_an_effect_above_all_machines_is_asked_about(
    call: list[str], told: str, work: Path
) -> None:
    result = done(mtu("simulate", "--write-cmm", "a.csv", "--parts", "3", *call, cwd=work))
    assert (work / "a.csv").is_file()
    found = [line for line in result.stderr.splitlines() if "effect-too-large" in line]
    assert found == ([f"warning: {told}, {ASKS} [effect-too-large]"] if told else [])
