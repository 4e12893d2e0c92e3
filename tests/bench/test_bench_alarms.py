"""How often the checks say something about sound readings and temperatures."""

from __future__ import annotations

import sys
from pathlib import Path

from checks.damage import SEED, STUDIES, simulate
from checks.test_damage import judged

SOUND_STUDIES = 500
MOST = 0.01
"""Share of sound studies with any alarm."""


def test_sound_studies_seldom_raise_an_alarm(tmp_path: Path) -> None:
    mtu = str(Path(sys.executable).parent / "mtu")
    alarms = 0
    for number in range(SOUND_STUDIES):
        of, study = ("lbb", STUDIES[number % 3]) if number % 4 else ("drift", "valdes-ring")
        frame = simulate(mtu, tmp_path, of, study, SEED + 1000 + number)
        alarms += bool(judged(study, of, frame))
    print(f"\nalarms in {alarms} of {SOUND_STUDIES} sound studies")
    assert alarms <= MOST * SOUND_STUDIES
