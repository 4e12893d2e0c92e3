"""Columns that a CSV table lacks, and which of its others is probably meant."""

from __future__ import annotations

import re

from mtu_cli.errors import Problem, closest, is_near, shorten
from mtu_cli.files.column_lengths import deviation_along, in_other_unit, renaming
from mtu_cli.files.column_words import AXIS, may_name, meant_by, plain
from mtu_cli.files.csv_table import TableSpec
from mtu_cli.units import UNITS, plain_unit

RUNS = ("run", "durchgang", "durchlauf", "lauf", "trial", "versuch")
"""Of repeats, or of anything else."""
REPEATS = ("repeat", "rep", "replicate", "replication", "repetition", "wiederholung", "wdh", *RUNS)
MEASUREMENTS = ("measurement", "meas", "messung", "mess")
"""Of a point, where they are numbered; without a number they are what was measured."""
POS = "pos"
"""In a list of characteristics their number; beside names and numbers of others nobody knows."""
OTHER_WORDS = {
    "part": ("serial", "serial_number", "serial_no", "workpiece", "piece", "sn", "s/n"),
    "feature": ("hole", "bore", "point", "ring", "feature_id", "element", "label", POS),
    "sequence": ("seq",),
    "repeat": REPEATS,
    "pass": ("passes", *REPEATS),
    "cycle": ("warm_up", "zyklus"),
    "direction": ("dir", "dirn"),
    "component": ("error_component", "error_type", "error_name", "channel", "parameter", *AXIS),
    "error": ("value", "reading", "deviation"),
    "position_mm": (
        "pos",
        "position",
        "target",
        "target_position",
        "soll",
        "sollposition",
        "zielposition",
        "nominal",
        "nominal_position",
        "axis_position",
        "coordinate",
    ),
}
"""What other programs call a column, in lower case with underscores."""
MEASURED_WORDS = ("mes", "mesure", "mess", "meas", "measured", "actual", "act", "ist")
OTHER_WORDS |= {
    f"{axis}_mm": tuple(f"{a}{gap}{b}" for word in MEASURED_WORDS for gap in ("", "_")
                        for a, b in ((axis, word), (word, axis)))
    for axis in "xyz"
}  # fmt: skip
"""A measured coordinate, in English, French and German: Xmes, x_ist, actual_y."""
NAMED = ("part", "feature")
BARE = ("id", "name", "ident", "code", "tag", "bezeichnung", POS)
"""What is called by a name that does not say of what it is one."""
UNIT = "_mm"
"""Other programs leave it out."""
COORDINATES = ("x_mm", "y_mm", "z_mm")
IN_MM = re.compile(r"[ _]*(?:[\[(] *mm *[\])]|in_mm|[/.] *mm)$", re.IGNORECASE)
OF_MACHINE = ", its cells being components of the machine file"
"""What else a column has to be that tells an axis alone."""
_BY_UNIT = re.compile(r"(.*?)[ _]*(?:[\[(] *([^\])]+?) *[\])]|[ _/]([^\W_]+(?:/m)?))")
"""The name and the unit of a column such as `error [um]`, `deviation (arcsec)`, `err_um`."""


def missing_column(
    name: str, shown: str, row: int, header: tuple[str, ...], spec: TableSpec
) -> Problem:
    """The Problem of a column that is not there, with the one that was probably meant."""
    others = [other for other in header if other and not spec.named(other)]
    axis = name[0] if name in COORDINATES else None
    along = {other: deviation_along(other) for other in others} if axis else {}
    others = [other for other in others if not along.get(other)]
    near = column_for(name, others)
    if near is not None:
        hint = renaming(near, name)
        hint += OF_MACHINE if name == "component" and squeezed(near) in AXIS else ""
    elif name == "unit" and (told := _told_units(others)):
        hint = f"a column 'unit', with {told} in each row"
    elif own := [other for other, of in along.items() if of == axis]:
        hint = f"a column {name!r} with the measured coordinate, nominal plus deviation, in mm "
        hint += f"({own[0]!r} looks like the deviation)"
    elif len(bare := [other for other in others if name in NAMED and plain(other) in BARE]) == 1:
        hint = f"a column {name!r}: {bare[0]!r} may be it, renamed"
    else:
        hint = f"a column {name!r} (the columns are {', '.join(map(shorten, header))})"
    return Problem(what=f"the column {name!r} is missing", file=shown, row=row, expected=hint)


def column_for(name: str, others: list[str]) -> str | None:
    """The one of other columns that was probably meant."""
    near = next((other for other in others if in_other_unit(other, (name,))), None)
    return near or _by_words(name, others)


def _by_words(name: str, others: list[str]) -> str | None:
    """The column that is called nearly so, or so by another program; none where several are."""
    same = [other for other in others if plain(other) == name]
    own = [other for other in others if meant_by(other) == name]
    if name.endswith(UNIT) and not own:
        word = squeezed(name.removesuffix(UNIT))
        own = [other for other in others if squeezed(IN_MM.sub("", other)) == word]
    if same or len(own) == 1:
        return (same or own)[0]
    if own:
        return None
    # What is surely another column is no slip of this one, nor is a `Temperature` of a feature, nor
    # an `Error type` that holds the names of errors one of their sizes.
    names = OTHER_WORDS["component"]
    free = [other for other in others if meant_by(other) is None and _folded(other) not in names]
    if name in COORDINATES:
        free = [other for other in free if plain(other)[:1] == name[:1]]
    near = closest(name, free)
    if near is not None and (is_near(name, near) or _shortened(squeezed(near), name)):
        return near
    if any(may_name(other) for other in others):
        others = [other for other in others if plain(other) != POS]
    return _by_another_word(name, others)


def _shortened(other: str, name: str) -> bool:
    """Whether one of two names is the beginning of the other: `val` of `value`."""
    return len(other) > 2 and (name.startswith(other) or other.startswith(name))


def _folded(other: str) -> str:
    """As the words of other programs are written."""
    return plain(other).strip().replace(" ", "_")


def _by_another_word(name: str, others: list[str]) -> str | None:
    """The column that another program calls so: by its own word, or without the unit."""
    words = (*OTHER_WORDS.get(name, ()), name.removesuffix(UNIT))
    bare = {IN_MM.sub("", other).removesuffix(UNIT): other for other in others}
    folded = {_folded(word): other for word, other in bare.items()}
    return next((folded[word] for word in words if word in folded), None)


def _told_units(others: list[str]) -> str | None:
    """The unit of readings that the header of the column of errors tells, in words."""
    for other in others:
        parted = _BY_UNIT.fullmatch(other.strip())
        unit = plain_unit(parted[2] or parted[3]) if parted else None
        if parted and unit in UNITS and column_for("error", [parted[1]]):
            return f"{unit!r} (of {other!r})"
    return None


def squeezed(name: str) -> str:
    """A name in lower case without accents, blanks and what stands for them."""
    return re.sub("[-_ .]", "", plain(name))
