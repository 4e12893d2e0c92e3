"""Columns that a CSV table lacks, and which of its others is probably meant."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from mtu_cli.errors import Problem, closest, is_near, shorten
from mtu_cli.files.column_lengths import deviation_along, in_other_unit, renaming
from mtu_cli.files.column_words import AXIS, may_name, meant_by, plain
from mtu_cli.files.csv_table import TableSpec
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS, plain_unit

RUNS = ("run", "durchgang", "durchlauf", "lauf", "trial", "versuch")
"""Of repeats, or of anything else."""
REPEATS = ("repeat", "rep", "rpt", "repl", "replicate", "replication", "repetition",
           "wiederholung", "wiederh", "wdh", *RUNS)  # fmt: skip
CYCLES = ("cycle", "zyklus")
"""Of points the repeats, or anything else; of readings a warm-up."""
MEASUREMENTS = ("measurement", "meas", "messung", "mess")
"""Of a point, where they are numbered; without a number they are what was measured."""
POS = "pos"
"""In a list of characteristics their number; beside names and numbers of others nobody knows."""
OTHER_WORDS = {
    "part": ("serial", "serial_number", "serial_no", "workpiece", "piece", "sn", "s/n"),
    "feature": ("hole", "bore", "point", "ring", "feature_id", "element", "label", POS),
    "sequence": ("seq",),
    "repeat": (*REPEATS, *CYCLES),
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
    name: str,
    shown: str,
    row: int,
    header: tuple[str, ...],
    spec: TableSpec,
    meant: Mapping[str, str | None] | None = None,
) -> Finding:
    """The Problem of a column that is not there, with the one that was probably meant; `meant` are
    those of all that are missing, as `meant_columns` finds them.
    """
    meant = meant_columns([name], header, spec) if meant is None else meant
    every = [other for other in header if other and not spec.named(other)]
    others = [other for other in every if other not in meant.values()]
    along = {other: deviation_along(other) for other in others} if name in COORDINATES else {}
    near = meant[name]
    if near is not None:
        hint = renaming(near, name)
        hint += OF_MACHINE if name == "component" and squeezed(near) in AXIS else ""
    elif name == "unit" and (told := _told_units(every)):
        hint = f"a column 'unit', with {told} in each row"
    elif own := [other for other, of in along.items() if of == name[0]]:
        hint = f"a column {name!r} with the measured coordinate, nominal plus deviation, in mm "
        hint += f"({own[0]!r} looks like the deviation)"
    elif told := _bare(name, others, meant):
        hint = f"a column {name!r}: {told}, renamed"
    else:
        hint = f"a column {name!r} (the columns are {', '.join(map(shorten, header))})"
    return Problem(what=f"the column {name!r} is missing", file=shown, row=row, expected=hint)


def meant_columns(
    absent: Sequence[str], header: Sequence[str], spec: TableSpec
) -> dict[str, str | None]:
    """The other column that each missing one probably is, None where none is: one that may be two
    of them is the one whose name it fits best.
    """
    others = [other for other in header if other and not spec.named(other)]
    meant: dict[str, str | None] = dict.fromkeys(absent)
    for surely in (True, False):
        for name in (name for name in absent if meant[name] is None):
            taken = meant.values()
            free = [
                other
                for other in others
                if other not in taken and not (name in COORDINATES and deviation_along(other))
            ]
            near = column_for(name, free)
            if near is not None and not (surely and meant_by(near) != name):
                meant[name] = near
    return meant


def _bare(name: str, others: Sequence[str], meant: Mapping[str, str | None]) -> str | None:
    """That the one column with a bare name may be the missing one; where both that may have it are
    missing, once for both.
    """
    bare = [other for other in others if plain(other) in BARE]
    if name not in NAMED or len(bare) != 1:
        return None
    lacking = [own for own in NAMED if own in meant and meant[own] is None]
    if lacking[0] != name:
        return None
    also = "".join(f" or the column {own!r}" for own in lacking[1:])
    return f"{bare[0]!r} may be it{also}"


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
