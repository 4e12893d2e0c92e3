"""How often the checks say something about sound readings, temperatures and points."""

from pathlib import Path

from checks import damage, damage_points, test_damage, test_damage_points

SOUND_STUDIES = 500
MOST = 0.01
"""Share of sound studies with any alarm."""


def alarmed(number: int, folder: Path) -> bool:
    """Whether a study drawn by its number has any finding: readings, points or drift."""
    seed = damage.SEED + 1000 + number
    if number % 2:
        study = damage_points.STUDIES[number // 2 % len(damage_points.STUDIES)]
        sound = damage_points.simulate(folder, study, seed)
        return bool(test_damage_points.judged(sound, folder))
    of, name = ("drift", "valdes-ring") if number % 8 == 0 else ("lbb", damage.STUDIES[number % 3])
    return bool(test_damage.judged(name, of, damage.simulate(folder, of, name, seed)))


def test_sound_studies_seldom_raise_an_alarm(tmp_path: Path) -> None:
    alarms = sum(alarmed(number, tmp_path) for number in range(SOUND_STUDIES))
    print(f"\nalarms in {alarms} of {SOUND_STUDIES} sound studies")
    assert alarms <= MOST * SOUND_STUDIES
