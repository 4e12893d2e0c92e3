"""Damage done to sound readings, drift and temperatures: what a tired person or a logger does.

Kinds and sizes are drawn by a fixed seed from the shipped studies, the drift from that of the
ring gauge."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from mtu_cli.cli.main import exit_code

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SEED, DRAWS = 45, 4
STUDIES = ("gilsinn-ling-simulated", "undeclared", "valdes-ring")
Frame = pd.DataFrame
Random = np.random.Generator

SIMULATE = {
    "gilsinn-ling-simulated": ["--positions", "10:150:8"],
    "undeclared": ["--positions", "10:150:8"],
    "valdes-ring": ["--positions", "x=0:500:8,y=0:350:8,z=-300:0:8"],
}
DRIFT = ["--drift-positions", "ry_x: 0 300", "--drift-positions", "yaw_y: 0 300",
         "--settled-drift", "pos_y: 28 -4 -34 -38", "--settled-drift", "ry_x: 30 30",
         "--settled-drift", "yaw_y: 30 30", "--interval-min", "5"]  # fmt: skip


class Damage(NamedTuple):
    """What is done, to which kind of file, and a pattern of the words that name it."""

    of: str
    words: str
    change: Callable[[Frame, Random], Frame]


def _a_pass(frame: Frame, draw: Random) -> pd.Series:
    """The rows of one pass, one direction, of a component with positions."""
    known = frame[frame.position_mm.notna()]
    own = known.iloc[draw.integers(len(known))]
    names = ["component", "pass", "direction"]
    return (frame[names] == own[names]).all(axis=1)


def _times(column: str, factor: float) -> Callable[[Frame, Random], Frame]:
    return lambda frame, draw: frame.assign(**{column: frame[column] * factor})


def pass_unit(frame: Frame, draw: Random) -> Frame:
    rows = _a_pass(frame, draw)
    frame.loc[rows, "error"] *= draw.choice([1e3, 1e-3, 25.4])
    return frame


def swapped(frame: Frame, draw: Random) -> Frame:
    frame = frame[frame.position_mm.notna()]
    return frame.assign(position_mm=frame.error, error=frame.position_mm)


def copied_pass(frame: Frame, draw: Random) -> Frame:
    rows = _a_pass(frame, draw)
    own = frame[rows].iloc[0]
    other = frame[
        (frame.component == own.component)
        & (frame["direction"] == own["direction"])
        & (frame["pass"] == own["pass"] % 5 + 1)
    ]
    values = dict(zip(other.position_mm, other.error, strict=True))
    frame.loc[rows, "error"] = frame[rows].position_mm.map(values)
    return frame


def mirrored_pass(frame: Frame, draw: Random) -> Frame:
    frame.loc[_a_pass(frame, draw), "error"] *= -1
    return frame


def spike(frame: Frame, draw: Random) -> Frame:
    at = draw.integers(len(frame))
    spread = float(np.ptp(frame[frame.component == frame.component.iloc[at]].error))
    frame.loc[frame.index[at], "error"] += draw.choice([-1, 1]) * (5 + 100 * draw.random()) * spread
    return frame


def distances(frame: Frame, draw: Random) -> Frame:
    """Whole distances in mm for deviations of lengths (axes that are angles left out)."""
    frame = frame[frame.position_mm.notna() & (frame.unit == "um")]
    frame = frame[frame.component == draw.choice(frame.component.unique())]
    start = draw.choice([0.0, 1381.0])
    return frame.assign(error=start + frame.position_mm + frame.error / 1e3, unit="mm")


def copied_rows(frame: Frame, draw: Random) -> Frame:
    """Another component's readings once more under this name, as from a file copied."""
    kinds = frame[frame.position_mm.notna()].groupby("unit").component.unique()
    names = draw.permutation(max(kinds, key=len))[:2]
    copy = frame[frame.component == names[0]].assign(component=names[1])
    return pd.concat([frame[frame.component != names[1]], copy])


def _sensors(frame: Frame) -> list[str]:
    return [name for name in frame.columns if name.startswith("T_")]


def _sensor(change: Callable[[np.ndarray, Random], np.ndarray]) -> Callable[[Frame, Random], Frame]:
    def damaged(frame: Frame, draw: Random) -> Frame:
        name = draw.choice(_sensors(frame))
        return frame.assign(**{name: change(frame[name].to_numpy().copy(), draw)})

    return damaged


def _code(value: float) -> Callable[[np.ndarray, Random], np.ndarray]:
    def coded(values: np.ndarray, draw: Random) -> np.ndarray:
        values[draw.choice(len(values), draw.integers(1, 6), replace=False)] = value
        return values

    return coded


def sensor_spike(values: np.ndarray, draw: Random) -> np.ndarray:
    values[draw.integers(5, len(values) - 5)] += 15.0
    return values


def stuck(values: np.ndarray, draw: Random) -> np.ndarray:
    start = draw.integers(len(values) // 4)
    values[start:] = values[start]
    return values


def drift_spike(frame: Frame, draw: Random) -> Frame:
    at = draw.integers(5, len(frame) - 5)
    frame.loc[frame.index[at], "error"] += 1e3
    return frame


def all_degf(frame: Frame, draw: Random) -> Frame:
    return frame.assign(**{name: frame[name] * 1.8 + 32 for name in _sensors(frame)})


UNIT = r"unit|inch|\bmm\b|\bnm\b|\bum\b|large|small"
DAMAGES = {
    "mm marked um": Damage("lbb", UNIT, _times("error", 1e-3)),
    "nm marked um": Damage("lbb", UNIT, _times("error", 1e3)),
    "a pass in another unit": Damage("lbb", UNIT, pass_unit),
    "positions in inches": Damage("lbb", r"inch", _times("position_mm", 1 / 25.4)),
    "positions in metres": Damage("lbb", r"metre|\bm\b", _times("position_mm", 1e-3)),
    "positions in um": Damage("lbb", r"\bum\b", _times("position_mm", 1e3)),
    "position and error swapped": Damage("lbb", r"swap|exchang", swapped),
    "a copied pass": Damage("lbb", r"cop|same|equal", copied_pass),
    "a copied component": Damage("lbb", r"cop|same|equal", copied_rows),
    "a mirrored pass": Damage("lbb", r"sign|mirror|opposite", mirrored_pass),
    "a spike": Damage("lbb", r"outl|mistyped|stand", spike),
    "distances for errors": Damage("lbb", r"distance|subtract", distances),
    "a drift reading off": Damage("drift", r"outl|robust|stand", drift_spike),
    "drift in mm marked um": Damage("drift", UNIT, _times("error", 1e-3)),
    "sensor code 999": Damage("drift", r"sensor|degC|error code", _sensor(_code(999.0))),
    "sensor code -60": Damage("drift", r"sensor|spike|error code", _sensor(_code(-60.0))),
    "sensor code 0": Damage("drift", r"sensor|spike|error code", _sensor(_code(0.0))),
    "a sensor spike": Damage("drift", r"sensor|spike|outl", _sensor(sensor_spike)),
    "a stuck sensor": Damage("drift", r"stuck|dead|constant|same|moved", _sensor(stuck)),
    "a column in degF": Damage("drift", r"degF|[Ff]ahrenheit", _sensor(lambda v, _: 1.8 * v + 32)),
    "a column in K": Damage("drift", r"kelvin|\bK\b", _sensor(lambda v, _: v + 273.15)),
    "all columns in degF": Damage("drift", r"degF|[Ff]ahrenheit", all_degf),
}


def simulate(folder: Path, of: str, study: str, seed: int) -> Frame:
    to, config = folder / "sound.csv", CONFIGS / study
    rest = [*SIMULATE[study], *(DRIFT if of == "drift" else ["--passes", "5"])]
    call = ["simulate", "-q", "-m", config / "truth.yaml", "-p", config / "part.yaml", *rest]
    assert exit_code([*map(str, call), "--seed", str(seed), f"--write-{of}", str(to)]) == 0
    return pd.read_csv(to, comment="#")


def draws(folder: Path) -> Iterator[tuple[str, str, Frame, Frame]]:
    """(kind of damage, study, sound, damaged) of every draw."""
    sound: dict[tuple[str, str, int], Frame] = {}
    for kind, damage in DAMAGES.items():
        for turn in range(DRAWS):
            study = "valdes-ring" if damage.of == "drift" else STUDIES[turn % len(STUDIES)]
            key = damage.of, study, turn // 3 if damage.of == "lbb" else turn % 2
            if key not in sound:
                sound[key] = simulate(folder, damage.of, study, SEED + key[2])
            draw = np.random.default_rng([SEED, turn, *map(ord, kind)])
            yield kind, study, sound[key], damage.change(sound[key].copy(), draw)


NAMELESS = "no unit, sign, order or origin explains it"
"""What is said where no mistake is known by name."""


def counted(
    kinds: Mapping[str, str], judged: Iterable[tuple[str, list[tuple[str, str]]]]
) -> dict[str, Counter[str]]:
    """Of every kind of damage how often it was found, called by a wrong name or missed.

    `kinds`: the pattern of the words that name each; `judged`: a kind and what was found of one
    draw, (code, message) each.
    """
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    for kind, found in judged:
        messages = [message.replace(NAMELESS, "") for _, message in found]
        named = any(re.search(kinds[kind], message) for message in messages)
        counts[kind]["found" if named else "wrong name" if found else "missed"] += 1
    return counts
