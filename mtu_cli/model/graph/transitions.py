"""The transitions: one entry of a registry for every use of one.

A place is an array of m trials: a coordinate or constant (m,), a point or vector (3, m), a line or
plane (2, 3, m), a frame (4, 3, m) of its origin and its axes. What an entry computes takes the
arrays of its inputs in the order of the file and gives those of its outputs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from mtu_cli.files.graph_contract import COORDINATES
from mtu_cli.findings import InputError
from mtu_cli.language import Node, evaluate, names
from mtu_cli.language.derivative import derivatives
from mtu_cli.language.tree import Call, walk
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph import constructions as make
from mtu_cli.model.graph import fits
from mtu_cli.model.graph.constructions import norm, unit
from mtu_cli.model.graph.fits import Construction
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PLAIN, internal

Values = dict[str, FloatArray]
Nominal = Sequence[FloatArray]
Unit = str | None
UNKNOWN = "?"
"""A place of which no kind is known."""
NAMED_BY_COORDINATE = ("point", "vector")
"""Kinds that a formula takes by their coordinates, ``H1.x``."""
INVERSE = ("asin", "acos", "atan", "atan2")
_SLOT = re.compile(r"(?P<kinds>[a-z|]+)(?:\.(?P<axis>[xyz]))?(?:\*(?P<least>\d)(?P<most>-\d?)?)?")


@dataclass(frozen=True, slots=True)
class Use:
    """One use of a transition.

    `signature`: the places that it takes and makes, in their order. ``coordinate.x`` is one along
    x, ``point*3-`` stands for three or more of them, ``constant*0-1`` may be left out.
    `construct`: the arrays of its outputs from those of its inputs; of a `fit` from the nominal
    inputs, where it starts. `unit` of what it makes: "same" as its first input, a "product" of
    both, or that of a "formula". `length`: number of the input that must be a length. `guard`: a
    test of nominal inputs (.., ), and what is wrong where they pass it: they determine nothing.
    """

    signature: str
    construct: Construction | None = None
    unit: str = "mm"
    length: int | None = None
    guard: tuple[Callable[..., bool], str] | None = None
    fit: Callable[[Nominal], Construction] | None = None

    def fits(self, side: int, places: Sequence[str]) -> bool:
        """Whether places, as `described`, are its inputs (side 0) or outputs (side 1)."""
        pattern = _pattern(self.signature.split("->")[side])
        return pattern.fullmatch("".join(f"{place};" for place in places)) is not None

    def words(self, side: int) -> str:
        """Its inputs or outputs for people."""
        return ", ".join(map(_in_words, _slots(self.signature.split("->")[side]))) or "nothing"


def described(kind: str, axis: str | None) -> str:
    """A place in words: ``a coordinate x``."""
    return f"a {kind} {axis}" if axis else f"a {kind}"


def _slots(side: str) -> list[tuple[str, str, int, int | None]]:
    """Kinds, axis, least and largest number of every input or output."""
    found = []
    for slot in _SLOT.finditer(side):
        least, most = int(slot["least"] or 1), slot["most"]
        upper = least if most is None else int(most[1:]) if most[1:] else None
        found.append((slot["kinds"], slot["axis"] or "", least, upper))
    return found


@cache
def _pattern(side: str) -> re.Pattern[str]:
    """Of places as `described`, each with a semicolon; what is not known fits anything."""
    parts = []
    for kinds, axis, least, most in _slots(side):
        place = rf"a (?:{kinds})(?: {axis or '[xyz]'})?"
        parts.append(rf"(?:(?:\{UNKNOWN}|{place});){{{least},{'' if most is None else most}}}")
    return re.compile("".join(parts))


def _in_words(slot: tuple[str, str, int, int | None]) -> str:
    kinds, axis, least, most = slot
    text = " or ".join(kinds.split("|")) + (f" {axis}" if axis else "")
    if most is None:
        return f"{least} or more of {text}"
    return text if least == most == 1 else f"{least or 'optional'} {text}"


SHORT = (make.no_length, "a vector has no length")
AIMLESS = (make.no_direction, "a vector has no length")
ONE_POINT = (make.coincide, "the two points coincide")
PARALLEL_PLANES = (make.parallel, "the planes are parallel")
PARALLEL_LINES = (make.parallel, "the lines are parallel")
UPRIGHT = (make.parallel, "the line is perpendicular to the plane")
NO_PIERCING = (make.no_piercing, "the line is parallel to the plane")
GLANCING = (make.glancing, "the vector is parallel to the plane")
NO_CORNER = (make.no_corner, "the three planes meet in no single point")

TRANSITIONS: dict[str, tuple[Use, ...]] = {
    "meas": (Use("-> coordinate"), Use("-> point")),
    "displace": (
        Use("coordinate constant -> coordinate", np.add, length=1),
        Use("point vector -> point", np.add, length=1),
    ),
    "middle": (Use("point point -> point", make.middle),),
    "vector": (Use("point point -> vector", make.between),),
    "unit_v": (
        Use("vector -> vector", unit, unit="1", guard=SHORT),
        Use("point point -> vector", make.unit_between, unit="1", guard=ONE_POINT),
    ),
    "ratio": (
        Use("vector constant -> vector", np.multiply, unit="product"),
        Use("constant constant -> constant", np.multiply, unit="product"),
    ),
    "length": (
        Use("vector -> constant", norm, unit="same"),
        Use("point point -> constant", make.distance),
    ),
    "ball": (
        Use("coordinate.x*2 coordinate.y*2 coordinate.z constant -> point", make.ball, length=5),
    ),
    "hole": (Use("coordinate.x*2 coordinate.y*2 constant*0-1 -> point", make.hole, length=4),),
    "circle": (Use("point*3- -> point constant*0-1", fit=fits.circle_through),),
    "sphere": (
        Use("point*4- -> point constant*0-1", fit=fits.sphere_through),
        Use("point*4- constant -> point", fit=fits.sphere_of_radius_through, length=-1),
    ),
    "line": (
        Use("point point -> line", make.line_through, guard=ONE_POINT),
        Use("plane plane -> line", make.meet, guard=PARALLEL_PLANES),
    ),
    "aline": (Use("point vector -> line", make.along, guard=AIMLESS),),
    "plane": (
        Use("point*3- -> plane", fit=fits.plane_through),
        Use("point vector -> plane", make.along, guard=AIMLESS),
    ),
    "point": (
        Use("line plane -> point", make.pierce, guard=NO_PIERCING),
        Use("plane plane plane -> point", make.three_planes, guard=NO_CORNER),
    ),
    "normal": (Use("plane -> vector", make.direction, unit="1"),),
    "direction": (Use("line -> vector", make.direction, unit="1"),),
    "project": (Use("point vector plane -> point", make.project, guard=GLANCING),),
    "per_proj": (
        Use("point plane -> point", make.foot_in_plane),
        Use("point line -> point", make.foot_on_line),
    ),
    "distance": (
        Use("point point -> constant", make.distance),
        Use("point line -> constant", make.to_line),
        Use("point plane -> constant", make.to_plane),
        Use("line line -> constant", make.between_lines, guard=PARALLEL_LINES),
    ),
    "angle": (Use("vector vector -> constant", make.angle, unit="rad", guard=SHORT),),
    "frame": (Use("plane line point -> frame", make.frame, guard=UPRIGHT),),
    "transform": (Use("frame point -> point", make.transform),),
    "compute": (Use("constant|coordinate|point|vector*1- -> constant", unit="formula"),),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A transition of a graph whose places are known and of the right kinds.

    `index` in the file; `use` of those of its transition, `formula` that of compute.
    """

    index: int
    do: str
    use: Use
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    formula: Node | None = None

    @property
    def may_jump(self) -> bool:
        """Whether its formula has a step, so that few trials may see no change at all."""
        nodes = () if self.formula is None else walk(self.formula)
        return any(isinstance(node, Call) and node.function == "step" for node in nodes)

    def unit(self, units: dict[str, Unit]) -> Unit:
        """Of what it makes, by the units of its inputs; None where they do not tell it.

        Raises InputError where dimensions of a formula do not agree.
        """
        if self.formula is not None:
            known = {name: units[place_of(name)] for name in names(self.formula)}
            return formula_unit(self.formula, known)
        first, last = units[self.inputs[0]], units[self.inputs[-1]]
        if self.use.unit != "product":
            return first if self.use.unit == "same" else self.use.unit
        one, other = _exponent(first), _exponent(last)
        if one is None or other is None:
            return None
        return _named(one + other, angle="rad" in (first, last))


def place_of(name: str) -> str:
    """The place of a name in a formula: H1 of ``H1.x``."""
    return name.partition(".")[0]


def _exponent(unit: Unit) -> int | None:
    """Of length in mm, mm^n, rad (0) or 1 (0); None where the unit is not known."""
    if unit is None or unit in ("1", "rad"):
        return None if unit is None else 0
    return 1 if unit == "mm" else int(unit.removeprefix("mm^"))


def _named(exponent: int, *, angle: bool) -> str:
    if exponent == 0:
        return "rad" if angle else "1"
    return "mm" if exponent == 1 else f"mm^{exponent}"


def formula_unit(node: Node, units: dict[str, Unit]) -> Unit:
    """The unit of a formula's value, or None where the units of its inputs do not tell it.

    Raises InputError where dimensions do not agree.
    """
    known = {name: _exponent(unit) for name, unit in units.items()}
    lengths = {name: internal(power) for name, power in known.items() if power is not None}
    algebra = Algebra(units=lengths, factor=PLAIN)
    result = algebra.of(node)
    if algebra.faults:
        raise InputError(algebra.faults)
    if not result.known:
        return None
    circular = isinstance(node, Call) and node.function in INVERSE
    return _named(int(result.exponents[0]), angle=circular or set(units.values()) == {"rad"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """A computing transition, ready to run on arrays of trials."""

    step: Step
    construct: Construction

    @classmethod
    def ready(cls, step: Step, nominal: Values) -> Computed:
        """Its outputs at nominal are put beside its inputs in `nominal`, where a fit starts.

        Raises GeometryError for nominal inputs that do not determine it.
        """
        made = {name: nominal[name] for name in step.inputs}
        given = [nominal[name] for name in step.inputs]
        found = cls(step=step, construct=_construction(step, given))
        with np.errstate(all="ignore"):
            found.run(made)
        if not all(np.isfinite(made[name]).all() for name in step.outputs):
            raise GeometryError(found.why_not_finite(made).removeprefix(": ") or "it is not finite")
        nominal.update({name: made[name] for name in step.outputs})
        return found

    def run(self, values: Values) -> None:
        """Puts the outputs beside the inputs in `values`."""
        made = self.construct(*(values[name] for name in self.step.inputs))
        outputs = made if isinstance(made, tuple) else (made,)
        values.update(zip(self.step.outputs, outputs, strict=False))

    def why_not_finite(self, values: Values, trial: int = 0) -> str:
        """What in its formula has no finite value in a trial, and where in the formula."""
        formula = self.step.formula
        if formula is None:
            return ""
        at = {name: float(_read(values[place_of(name)], name)[trial]) for name in names(formula)}
        faults = derivatives(formula, at, ()).faults
        if not faults:
            return f": it is {float(evaluate(formula, at)):g}"
        facts, column = faults[0].facts, faults[0].column
        return f": no finite {facts['what']}{facts['where']}, column {column} of the formula"


def _construction(step: Step, nominal: Nominal) -> Construction:
    """What a step computes; a fit starts from, and is oriented as, its `nominal` inputs."""
    if step.formula is not None:
        return _computing(step.formula, step.inputs)
    use = step.use
    if use.guard is not None and use.guard[0](*(place[..., 0] for place in nominal)):
        raise GeometryError(use.guard[1])
    found = use.construct if use.fit is None else use.fit(nominal)
    assert found is not None
    return found


def _computing(formula: Node, inputs: Sequence[str]) -> Construction:
    at = {name: inputs.index(place_of(name)) for name in names(formula)}

    def compute(*places: FloatArray) -> FloatArray:
        value = evaluate(formula, {name: _read(places[i], name) for name, i in at.items()})
        return np.broadcast_to(np.asarray(value, dtype=np.float64), places[0].shape[-1:])

    return compute


def _read(place: FloatArray, name: str) -> FloatArray:
    """What a formula means by ``H1.x``, or by the name of a whole place."""
    coordinate = name.partition(".")[2]
    known = (COORDINATES[kind] for kind in NAMED_BY_COORDINATE)
    row = next((item.index(coordinate) for item in known if coordinate in item), None)
    return place if row is None else np.asarray(place[row])
