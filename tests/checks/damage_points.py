"""Damage done to sound points, parts and machines: what is mistyped, exported or pasted wrongly.

Kinds and sizes are drawn by a fixed seed from simulated parts of the shipped studies.
"""

import json
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from checks.damage import CONFIGS, DRAWS, SEED, Frame, Random
from mtu_cli.cli.main import exit_code

Document = dict[str, Any]


class Study(NamedTuple):
    """Machine and part of simulated points, and what else `mtu simulate` is told."""

    machine: str
    part: str
    options: tuple[str, ...] = ()


STUDIES = (
    Study("gilsinn-ling-simulated/truth.yaml", "gilsinn-ling-simulated/part.yaml"),
    Study("gilsinn-ling-parts/truth.yaml", "gilsinn-ling/part.yaml",
          ("--scatter", "Ex: 1e-3*sqrt(253.7 + 0.1677*x - 0.3933*y)", "--cmm-u-um", "0.95",
           "--scatter", "Ey: 1e-3*sqrt(504.4 + 0.6400*x - 0.2568*y)")),
    Study("valdes-ring/truth.yaml", "valdes-ring/part.yaml",
          ("--cmm-room", "20", "--cmm-u-um", "0.3")),
)  # fmt: skip


class Case(NamedTuple):
    """One study as it is damaged."""

    points: Frame
    part: Document
    machine: Document


class Damage(NamedTuple):
    """What is done, the words that name it, and how many of STUDIES it is done to."""

    words: str
    change: Callable[[Case, Random], Case | None]
    studies: int = len(STUDIES)


def _measured(case: Case) -> list[str]:
    return [name for name in ("x_mm", "y_mm", "z_mm") if name in case.points]


def _nominal(case: Case) -> Frame:
    common = {"z_mm": case.part.get("z_mm")}
    places = {name: common | place for name, place in case.part["features"].items()}
    names = case.points.feature.astype(str)
    return Frame({c: [places[n][c] for n in names] for c in _measured(case)}, case.points.index)


def _a_part(case: Case, draw: Random) -> pd.Series:
    return case.points.part == draw.choice(case.points.part.unique())


def _all(case: Case, draw: Random) -> pd.Series:
    return case.points.part.notna()


Rows = Callable[[Case, Random], pd.Series]
Change = Callable[[Case, Random], Case | None]
Values = Callable[[Frame, Frame, Random], Frame]


def _of(rows: Rows, values: Values, *, one_axis: bool = False) -> Change:
    """Other coordinates of some rows, by what was measured and the nominal ones."""

    def change(case: Case, draw: Random) -> None:
        names = [draw.choice(["x_mm", "y_mm"])] if one_axis else _measured(case)
        own, nominal = rows(case, draw), _nominal(case)[names]
        case.points.loc[own, names] = values(case.points.loc[own, names], nominal, draw).round(6)

    return change


def _times(rows: Rows, factors: list[float], *, one_axis: bool = False) -> Change:
    return _of(rows, lambda own, _, draw: own * draw.choice(factors), one_axis=one_axis)


def _swapped(rows: Rows) -> Change:
    return _of(rows, lambda own, _, draw: own.assign(x_mm=own.y_mm, y_mm=own.x_mm))


def _mirrored(rows: Rows) -> Change:
    """Counted from the other end of the part, or from the same origin the other way."""

    def values(own: Frame, nominal: Frame, draw: Random) -> Frame:
        return draw.choice([0.0, 1.0]) * (nominal.min() + nominal.max()) - own

    return _of(rows, values, one_axis=True)


def _moved(rows: Rows) -> Change:
    def values(own: Frame, _: Frame, draw: Random) -> Frame:
        by = draw.choice([-1, 1], 2) * draw.uniform(2, 80, 2).round(3)
        return own.assign(x_mm=own.x_mm + by[0], y_mm=own.y_mm + by[1])

    return _of(rows, values)


def _a_cell(rows: Callable[[float, Random], float]) -> Change:
    """Another value of one cell."""

    def change(case: Case, draw: Random) -> None:
        row, name = draw.choice(case.points.index), draw.choice(["x_mm", "y_mm"])
        case.points.loc[row, name] = rows(case.points.loc[row, name], draw)

    return change


def _slip(low: float, high: float) -> Change:
    return _a_cell(
        lambda value, draw: (
            value + draw.choice([-1, 1]) * np.exp(draw.uniform(*np.log([low, high]))).round(4)
        )
    )


def another_order(case: Case, draw: Random) -> None:
    """The features of a part from another start: as of a program that began elsewhere."""
    own = _a_part(case, draw)
    shift = int(draw.integers(1, case.points.feature.nunique() - 1))
    for rows in case.points[own].groupby("repeat").groups.values():
        case.points.loc[rows, "feature"] = np.roll(case.points.loc[rows, "feature"], shift)


def two_exchanged(case: Case, draw: Random) -> None:
    own = _a_part(case, draw)
    one, other = draw.choice(case.points.feature.unique(), 2, replace=False)
    names = case.points.loc[own, "feature"]
    case.points.loc[own, "feature"] = names.replace({one: other, other: one})


def copied_part(case: Case, draw: Random) -> None:
    one, other = draw.choice(case.points.part.unique(), 2, replace=False)
    rows, source = (case.points.part == each for each in (one, other))
    names = _measured(case)
    case.points.loc[rows, names] = case.points.loc[source, names].to_numpy(copy=True)


def copied_repeat(case: Case, draw: Random) -> None:
    own, names = _a_part(case, draw), _measured(case)
    rows, source = (own & (case.points["repeat"] == each) for each in (2, 1))
    case.points.loc[rows, names] = case.points.loc[source, names].to_numpy(copy=True)


def pasted_twice(case: Case, draw: Random) -> Case:
    """All repeats one measurement, its rows pasted again, without a column that numbers them."""
    rows = case.points[case.points["repeat"] == 1].drop(columns="repeat")
    return case._replace(points=pd.concat([rows, rows], ignore_index=True))


def another_case(case: Case, draw: Random) -> None:
    """Parts are named p1, p2, ...; one of them is P2 in half of its rows."""
    case.points["part"] = "p" + case.points.part.astype(str)
    own = _a_part(case, draw) & (case.points["repeat"] == 2)
    written = draw.choice(["upper", "blank"])
    names = case.points.loc[own, "part"]
    case.points.loc[own, "part"] = (
        names.str.upper() if written == "upper" else names.str[0] + " " + names.str[1:]
    )


def tolerance_in_mm(case: Case, draw: Random) -> None:
    case.part["lengths"][int(draw.integers(3))]["tolerance_um"] = float(draw.choice([0.02, 0.1]))


def part_in_unit(case: Case, draw: Random) -> None:
    factor = float(draw.choice([1 / 25.4, 1e3, 1e-3]))
    for place in case.part["features"].values():
        place.update({name: round(value * factor, 6) for name, value in place.items()})


def a_place_twice(case: Case, draw: Random) -> None:
    one, other = draw.choice(list(case.part["features"]), 2, replace=False)
    case.part["features"][one] = dict(case.part["features"][other])


def a_place_mistyped(case: Case, draw: Random) -> None:
    place = case.part["features"][draw.choice(list(case.part["features"]))]
    place[draw.choice(["x_mm", "y_mm"])] += float(draw.choice([-10, 10, 1, 0.9]))


def _coefficients(factor: float) -> Change:
    def change(case: Case, draw: Random) -> None:
        names = [name for name in case.machine["components"] if name[0] == "d"]
        own = case.machine["components"][draw.choice(names)]
        own["coefficients"] = [value * factor for value in own["coefficients"]]

    return change


def constant_in_um(case: Case, draw: Random) -> None:
    case.machine["constants"]["z"] *= 1e3


def travel_in_metres(case: Case, draw: Random) -> None:
    axis = case.machine["axes"][draw.choice(["x", "y"])]
    axis["travel_mm"] = [value / 1e3 for value in axis["travel_mm"]]


ONE = r"mistyped|outl|slip|is expected|expected about|off the other|decimal|sign"
SAME = r"same|cop|equal|twice"
WAY = r"sign|mirror|other way|revers"
DAMAGES = {
    "all in inches": Damage(r"inch", _times(_all, [1 / 25.4])),
    "all in um": Damage(r"\bum\b", _times(_all, [1e3])),
    "all in metres": Damage(r"metre|\bm\b", _times(_all, [1e-3])),
    "a part in another unit": Damage(
        r"inch|\bum\b|metre|\bm\b|unit", _times(_a_part, [1 / 25.4, 1e3, 1e-3])
    ),
    "an axis in another unit": Damage(
        r"inch|\bum\b|metre|\bm\b|unit", _times(_all, [1 / 25.4, 1e3], one_axis=True)
    ),
    "x and y swapped": Damage(r"swap|exchang", _swapped(_all)),
    "x and y of a part swapped": Damage(r"swap|exchang", _swapped(_a_part)),
    "an axis mirrored": Damage(WAY, _mirrored(_all)),
    "an axis of a part mirrored": Damage(WAY, _mirrored(_a_part)),
    "another origin": Damage(r"origin", _moved(_all)),
    "another origin of a part": Damage(r"origin", _moved(_a_part)),
    "features in another order": Damage(r"order", another_order),
    "two features exchanged": Damage(rf"order|exchang|swap|{ONE}", two_exchanged),
    "a copied part": Damage(SAME, copied_part),
    "a copied repeat": Damage(SAME, copied_repeat),
    "points pasted twice": Damage(SAME, pasted_twice),
    "a slip of millimetres": Damage(ONE, _slip(1.0, 100.0)),
    "a slip of tenths": Damage(ONE, _slip(0.1, 1.0)),
    "a lost sign": Damage(r"lost sign", _a_cell(lambda value, _: -value)),
    "a decimal point": Damage(
        r"decimal point", _a_cell(lambda value, draw: value * draw.choice([0.1, 10.0, 100.0]))
    ),
    "a part of the drawing": Damage(r"nominal|drawing", _of(_a_part, lambda _, at, __: at)),
    "an axis of the drawing": Damage(
        r"nominal|drawing", _of(_all, lambda _, at, __: at, one_axis=True)
    ),
    "errors for coordinates": Damage(
        r"errors", _of(_all, lambda own, at, draw: (own - at) * draw.choice([1.0, 1e3]))
    ),
    "a part in other letters": Damage(r"case|blank|alike", another_case),
    "a tolerance in mm": Damage(r"tolerance", tolerance_in_mm, 1),
    "the part in another unit": Damage(r"inch|\bum\b|metre|\bm\b|unit|travel", part_in_unit, 1),
    "a place twice": Damage(r"place|same|alike", a_place_twice, 1),
    "a place mistyped": Damage(rf"place|{ONE}|every part|all parts", a_place_mistyped, 1),
    "coefficients in nm": Damage(r"coefficient|large|unit", _coefficients(1e3), 1),
    "coefficients in mm": Damage(r"coefficient|small|unit", _coefficients(1e-3), 1),
    "a constant in um": Damage(r"constant|large|unit", constant_in_um, 1),
    "a travel in metres": Damage(r"travel|metre", travel_in_metres, 1),
}


def simulate(folder: Path, study: Study, seed: int) -> Case:
    """Eight sound parts, each measured twice."""
    to = folder / "sound.csv"
    machine, part = CONFIGS / study.machine, CONFIGS / study.part
    call = ["simulate", "-q", "-m", machine, "-p", part, "--parts", "8", "--repeats", "2"]
    call += [*study.options, "--seed", seed, "--write-cmm", to]
    assert exit_code([*map(str, call)]) == 0
    documents = [yaml.safe_load(path.read_text("utf-8")) for path in (part, machine)]
    return Case(pd.read_csv(to, comment="#"), *documents)


def draws(folder: Path) -> Iterator[tuple[str, Case, Case]]:
    """(kind of damage, sound, damaged) of every draw."""
    sound: dict[tuple[Study, int], Case] = {}
    for kind, damage in DAMAGES.items():
        for turn in range(DRAWS):
            key = STUDIES[turn % damage.studies], turn // damage.studies
            if key not in sound:
                sound[key] = simulate(folder, key[0], SEED + key[1])
            case = Case(sound[key].points.copy(), *map(deepcopy, sound[key][1:]))
            draw = np.random.default_rng([SEED, turn, *map(ord, kind)])
            yield kind, sound[key], damage.change(case, draw) or case


def written(case: Case, folder: Path) -> tuple[Path, Path, Path]:
    points, part, machine = (folder / name for name in ("cmm.csv", "part.yaml", "machine.yaml"))
    case.points.to_csv(points, index=False)
    for path, document in ((part, case.part), (machine, case.machine)):
        # JSON is YAML, too, and quickly made.
        path.write_text(json.dumps(document), "utf-8")
    return points, part, machine
