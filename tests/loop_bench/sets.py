"""Kinds of simulated data sets: what files of one hold, what is true, and what to foretell.

A set is known by its kind, its base seed and its index. Of the index come family, design, what
the machine file tells of the scatter of parts, and the day, so that any run of indices covers
them all. Nothing here comes from the package that is judged with it.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from shop_day import (
    FAMILIES,
    MISSHAPEN,
    NOISES,
    OUTSIDE,
    Noise,
    Rivals,
    ShopDay,
    Truth,
    effect,
    measure_repeats,
    misshapen_effect,
    oracle_gain,
    outside_effect,
    runs,
    write_csv,
    write_machine,
    write_part,
)
from shop_day.day import Floats
from shop_day.effects import parameters
from shop_day.noise import SIG_PART
from shop_day.oracle import SCATTERS, tellable_pair
from shop_day.plates import WARM, Plate, short_plate, warm_plate, warm_scatter

FOLDS, DAYS = 7, 8
FIRST_DAY = {1: 0, 2: 5000, 3: 6000, 4: 7000, 5: 8000, 6: 9000}
"""Of tuning (base seed 1) and of judging (from 2 on). Judging days move on when the loop was
changed after a judgement: those before stay where the change left all that is said of them.
"""
TUNING, JUDGING = 1, 6
HELD_OUT = 6
"""The first base that is judged by what is held out now: those before had led to its change."""


@dataclass(frozen=True, kw_only=True)
class Ask:
    """Places (n, 2 or 3) mm and covariates to predict at, and what is true there: the mean error
    and a future reading (n, axes), um; half the width of the latter's 95 % interval if all were
    known. They lie in the measured ranges, at none of the measured places.
    """

    at: dict[str, float]
    places: Floats
    true: Floats
    future: Floats | None = None
    known_half: Floats | None = None


@dataclass(kw_only=True)
class Drawn:
    """`names` of the true effects with, of each, the names that are the same on this data; `sizes`
    as a report states them, by name and parameter; `d` their separation from the best rival.
    """

    arguments: list[str]
    names: list[str | None] = field(default_factory=list)
    families: list[str] = field(default_factory=list)
    aliases: list[list[str]] = field(default_factory=list)
    d: list[float | None] = field(default_factory=list)
    sizes: dict[str, dict[str, float]] = field(default_factory=dict)
    searched: dict[str, float] = field(default_factory=dict)
    covariate: str | None = None
    oracle: tuple[float, float] | None = None
    known: list[str] | None = None
    asks: list[Ask] = field(default_factory=list)

    def add(
        self,
        name: str | None,
        family: str,
        sizes: Mapping[str, float] | None = None,
        aliases: Sequence[str] = (),
        d: float | None = None,
    ) -> None:
        """One more true effect."""
        self.names.append(name)
        self.families.append(family)
        self.aliases.append(list(aliases))
        self.d.append(d)
        if name is not None:
            self.sizes[name] = dict(sizes or {})

    def truth(self) -> dict[str, Any]:
        """As records keep it."""
        kept = ("names", "families", "aliases", "d", "sizes", "searched", "covariate", "oracle")
        return {name: getattr(self, name) for name in kept}


@dataclass(frozen=True)
class Kind:
    """`counts`: of records, and of the full bench (both designs together)."""

    name: str
    draw: Callable[[Kind, Turn, Path], Drawn]
    counts: tuple[int, int]
    families: Sequence[str] = ("",)
    amplitude: float = 0.0
    noise: Noise = "normal"
    parts: int = 21
    missing: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Turn:
    """What the index of a set stands for."""

    rng: np.random.Generator
    index: int
    family: str
    design: str
    scatter_known: bool
    day: int


def turn_of(kind: Kind, base: int, index: int) -> Turn:
    number, family = divmod(index, len(kind.families))
    plan = number + family
    day = FIRST_DAY[base] + (number // 4 + family + family // DAYS) % DAYS
    return Turn(
        rng=np.random.default_rng([base, zlib.crc32(kind.name.encode()), index]),
        index=index,
        family=kind.families[family],
        design="AB"[plan % 2],
        scatter_known=plan // 2 % 2 == 0,
        day=day,
    )


@lru_cache(maxsize=64)
def day_of(design: str, seed: int, parts: int) -> ShopDay:
    return ShopDay("A" if design == "A" else "B", seed=seed, parts=parts)


@lru_cache(maxsize=32)
def rivals_of(day: ShopDay, *, margins: bool = False) -> Rivals:
    return Rivals(day, margins=margins)


def _table(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """A shop day, measured on a CMM."""
    day = day_of(turn.design, turn.day, kind.parts)
    truths = _truths(kind, turn, day)
    repeats = measure_repeats(day, turn.rng, truths, kind.noise)
    return _shop(kind, turn, folder, day, truths, repeats)


def _shop(
    kind: Kind, turn: Turn, folder: Path, day: ShopDay, truths: Sequence[Truth], repeats: Floats
) -> Drawn:
    cells = turn.rng.random((day.P, day.H)) >= kind.missing if kind.missing else None
    write_machine(folder / "machine.yaml", scatter=SIG_PART if turn.scatter_known else None)
    write_part(day, folder / "part.yaml")
    write_csv(day, repeats, folder / "cmm.csv", cells=cells)
    drawn = Drawn(arguments=["-m", "machine.yaml", "-p", "part.yaml", "--cmm", "cmm.csv"])
    for truth in truths:
        signal = rivals_of(day, margins=True).signal(truth)
        also, d = (signal.aliases, signal.d) if signal else ((), None)
        drawn.add(truth.name, truth.family, parameters(truth), also, d)
        drawn.searched |= truth.searched
        drawn.covariate = truth.covariate
    whole = not kind.missing and kind.parts == 21
    if whole and len(truths) == 1 and truths[0].family not in SCATTERS:
        drawn.oracle = oracle_gain(repeats.mean(axis=-1), truths[0], FOLDS)
    return drawn


def _truths(kind: Kind, turn: Turn, day: ShopDay) -> tuple[Truth, ...]:
    if not kind.amplitude:
        return ()
    if kind.name.startswith("pairs"):
        return tellable_pair(rivals_of(day), turn.rng, kind.amplitude)
    make = effect
    if turn.family in OUTSIDE:
        make = outside_effect
    elif kind.name.startswith("misshapen"):
        make = misshapen_effect
    return (make(day, turn.family, turn.rng, kind.amplitude),)


def _offset_step(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """A step with a small constant offset beside it."""
    day = day_of(turn.design, turn.day, kind.parts)
    truth = effect(day, turn.family, turn.rng, kind.amplitude)
    repeats = measure_repeats(day, turn.rng, [truth])
    (a,) = truth.axes
    level = 0.8 * float(turn.rng.choice([-1, 1]))
    repeats[:, :, a] += truth.level[a] + level
    drawn = _shop(kind, turn, folder, day, [truth], repeats)
    drawn.oracle, drawn.asks = None, []
    # On both faces of the part.
    places = np.column_stack([turn.rng.uniform(20, 130, (3, 2)), [0.0, 25.0, 0.0]])
    first = int(truth.searched["at"] + 2)
    for late, part in ((False, 3), (True, int(turn.rng.integers(first, day.P + 1)))):
        true = np.zeros((3, 2))
        true[:, a] = level + late * float(truth.coefficients[0])
        at = {name: float(day.full(name)[part - 1, 0]) for name in day.covariates}
        ask = Ask(at=at, places=places, true=true)
        if turn.scatter_known:
            # All of the scatter that the machine file states is that of whole parts.
            future = true + turn.rng.normal(0, SIG_PART, true.shape)
            ask = replace(ask, future=future, known_half=np.full(true.shape, 1.96 * SIG_PART))
        drawn.asks.append(ask)
    return drawn


def _hidden_scale(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """Warm parts: an axis grows from 20 degC on, and in two of three sets has a scale, too."""
    rng, name = turn.rng, "T_scale_degC"
    plate = warm_plate(rng, scaled=turn.index % 3 > 0)
    drawn = _plate(plate, folder)
    if turn.scatter_known:
        write_machine(folder / "machine.yaml", scatter=WARM, repeat=WARM)
    axis = "xy"[plate.axis or 0]
    drawn.add(f"thermal-growth-{axis}", "thermal-growth", {"growth": 1e3 * plate.growth})
    if plate.scale:
        drawn.add(f"scale-{axis}", "scale")
    drawn.covariate = name
    for warm in rng.uniform(24.5, 27.5, 2).tolist():
        inside = rng.uniform([40, 40], [390, 270], (3, 2))
        true = plate.true(inside, warm)
        ask = Ask(at={name: warm, "sequence": 8.0}, places=inside, true=true)
        if turn.scatter_known:
            half = np.full(true.shape, 1.96 * np.sqrt(2) * WARM)
            ask = replace(ask, future=true + warm_scatter(rng, 3, 1)[:, 0], known_half=half)
        drawn.asks.append(ask)
    return drawn


def _equal_scale(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """Of half of the plates the datum is fitted."""
    plate = short_plate(turn.rng)
    drawn = _plate(plate, folder)
    if turn.index % 2:
        drawn.arguments += ["--datum", "offset,rotation"]
    drawn.add("scale", "scale", {"scale": 1e3 * plate.scale})
    return drawn


def _plate(plate: Plate, folder: Path) -> Drawn:
    write_machine(folder / "machine.yaml")
    plate.write_csv(folder / "cmm.csv")
    return Drawn(arguments=["-m", "machine.yaml", "--cmm", "cmm.csv"])


def _laser(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """Of design A nothing was known before; of B the components, with their scatter from pass to
    pass, by an earlier run without the effect.
    """
    rng = turn.rng
    run = runs.layout(rng, planted=bool(kind.amplitude))
    change: Floats | float = 0.0
    drawn = _axis(folder)
    if kind.amplitude:
        column = run.column(turn.family, rng)
        size = kind.amplitude * run.size(column) * float(rng.choice([-1, 1]))
        change = size * column
        parameter, factor = runs.UNITS.get(turn.family, ("", 0.0))
        sizes = {parameter: factor * size} if parameter else {}
        # Its two or three periods in the travel are a smooth profile as well as a wave.
        also = ("profile-x",) if turn.family == "cyclic" else ()
        drawn.add(f"{turn.family}-x", turn.family, sizes, also)
        drawn.covariate = "sequence" if turn.family == "trend" else None
    if turn.design == "B":
        (folder / "before.csv").write_text(run.readings(rng))
        drawn.known = ["-m", "machine.yaml", "--laser", "before.csv"]
    (folder / "laser.csv").write_text(run.readings(rng, change))
    return drawn


def _axis(folder: Path) -> Drawn:
    (folder / "machine.yaml").write_text(runs.MACHINE)
    return Drawn(arguments=["-m", "machine.yaml", "--laser", "laser.csv"])


def _profile(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """`amplitude` in standard uncertainties of a target's mean. Regular targets for families that
    say so, else uneven ones; every other axis was zeroed at the start of each run.
    """
    rng = turn.rng
    shape, _, where = turn.family.partition(" ")
    travel, count = float(rng.choice([400, 600, 1000])), 11 if where == "regular" else 21
    x = runs.targets(rng, count, travel, regular=where == "regular")
    size = kind.amplitude * 0.5 / np.sqrt(10)
    drawn = _axis(folder)
    made: dict[str, tuple[str | None, Callable[[], runs.Profile]]] = {
        "straight": (None, lambda: runs.wave(travel, 0.0, rng)),
        "bend": ("profile-x", lambda: runs.bend(travel, size, rng)),
        "wave": ("cyclic-x", lambda: runs.wave(float(rng.uniform(8, 14)), size, rng)),
    }
    name, profile = made[shape]
    axis = runs.Axis(targets=x, profile=profile(), zeroed=turn.index // 2 % 2 == 1)
    if name is not None:
        drawn.add(name, shape)
    drawn.add("backlash-x", "backlash", {"lost_motion": axis.lost / 2})
    (folder / "laser.csv").write_text(axis.readings(rng))
    inside = rng.uniform(0, travel, 6)
    ask = Ask(
        at={"dir_x": 1.0, "sequence": 3.0},
        places=np.stack([inside, np.zeros(6)], axis=1),
        true=axis.true(inside)[:, None],
        future=axis.future(inside, rng)[:, None],
        known_half=axis.half_width(inside)[:, None],
    )
    drawn.asks = [ask]
    return drawn


def _reversal(kind: Kind, turn: Turn, folder: Path) -> Drawn:
    """An indicator at one place, approached from both sides."""
    rng = turn.rng
    lost, passes = float(rng.choice([-1, 1])) * rng.uniform(2, 8), int(rng.integers(5, 11))
    direction = np.tile([1, -1], passes)
    levels = np.repeat(rng.normal(0, 0.3, passes), 2)
    error = lost * direction + levels + rng.normal(0, rng.uniform(0.1, 0.6), 2 * passes)
    number = np.repeat(np.arange(passes) + 1, 2)
    (folder / "lbb.csv").write_text(runs.csv("px", None, number, direction, error, digits=1))
    (folder / "machine.yaml").write_text(runs.MACHINE.replace("of: x, ", ""))
    drawn = Drawn(arguments=["-m", "machine.yaml", "--lbb", "lbb.csv"])
    drawn.add("backlash", "backlash")
    return drawn


SIX = ("thermal-drift", "trend", "warm-up")
OTHER_SIX = ("backlash", "scale", "curvature", "squareness")
PROFILES = ("bend regular", "bend uneven", "wave uneven")


def _kinds() -> Iterator[Kind]:
    for noise in NOISES:
        yield Kind(f"null-{noise}", _table, (40, 1000), noise=noise)
    for a in (0.5, 1.0, 2.0):
        yield Kind(f"library-{a:g}", _table, (140, 400), FAMILIES, a)
    yield Kind("pairs-1", _table, (120, 200), amplitude=1.0)
    for a in (0.5, 1.0, 2.0):
        yield Kind(f"misshapen-{a:g}", _table, (44, 200), tuple(MISSHAPEN), a)
    yield Kind("outside-1", _table, (84, 300), tuple(OUTSIDE), 1.0)
    yield Kind("laser-clean", _laser, (60, 500))
    for a, count in ((0.5, 32), (1.0, 48), (2.0, 32)):
        yield Kind(f"laser-{a:g}", _laser, (count, 200), runs.RUN_FAMILIES, a)
    yield Kind("missing-null", _table, (24, 200), missing=0.08)
    yield Kind("missing-1", _table, (60, 200), FAMILIES, 1.0, missing=0.08)
    yield Kind("six-null", _table, (24, 200), parts=6)
    yield Kind("six-drift", _table, (36, 200), SIX, 2.0, parts=6)
    yield Kind("six-other", _table, (24, 200), OTHER_SIX, 1.0, parts=6)
    yield Kind("hidden-scale", _hidden_scale, (42, 200))
    yield Kind("offset-step", _offset_step, (42, 200), ("step",), 1.0)
    yield Kind("equal-scale", _equal_scale, (40, 200))
    yield Kind("straight", _profile, (40, 200), ("straight regular", "straight uneven"))
    for a in (4.0, 10.0, 30.0):
        yield Kind(f"profile-{a:g}", _profile, (36, 200), PROFILES, a)
    yield Kind("reversal", _reversal, (20, 50))


KINDS = tuple(_kinds())


def drawn(kind: Kind, base: int, index: int, folder: Path) -> tuple[Turn, Drawn]:
    """Writes the files of a set into an empty folder."""
    turn = turn_of(kind, base, index)
    return turn, kind.draw(kind, turn, folder)
