"""The library of effects: candidates for what a machine's equations lack, on a given table.

Families are data (``effects.yaml``, and users' own files): this module fills their names in
with the axes and columns of a table, and builds the columns.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mtu_cli.close_loop_sealed.files.effect_templates import (
    LoadedEffects,
    LoadedFamily,
    load_effects,
)
from mtu_cli.close_loop_sealed.model.effect_binding import (
    Binding,
    filled,
    of_candidates,
    of_members,
)
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column, Member
from mtu_cli.close_loop_sealed.model.effect_data import TableData, copy_notes, labels
from mtu_cli.close_loop_sealed.model.effect_distinct import distinct
from mtu_cli.close_loop_sealed.model.effect_lacks import NoMember, check_column
from mtu_cli.close_loop_sealed.model.effect_members import Batch, BoundTemplate
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError, finding, nearest
from mtu_cli.language import names
from mtu_cli.stats.threads import one_blas_thread

__all__ = [
    "Candidate",
    "Column",
    "EffectLibrary",
    "Member",
    "built_in_effects",
    "candidates",
    "effect_library",
]

BUILT_IN = Path(__file__).with_name("effects.yaml")


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectLibrary:
    """Families of candidates, the built-in ones first; `sources` are the users' files."""

    families: tuple[LoadedFamily, ...]
    sources: tuple[Source, ...] = ()

    def names(self) -> tuple[str, ...]:
        """Families, and candidates whose names hold no axis."""
        plain = [family.name for family in self.families if "{" not in family.name]
        return tuple(dict.fromkeys([family.family.family for family in self.families] + plain))


@cache
def built_in_effects() -> LoadedEffects:
    """The families that come with the package."""
    return load_effects(BUILT_IN)


def effect_library(paths: Sequence[Path] = ()) -> EffectLibrary:
    """The built-in families and those of the users' own files.

    Raises InputError with all problems of a file; the name of a family may be used once.
    """
    families = list(built_in_effects().families)
    taken = {family.family.family: "a built-in family" for family in families}
    sources = []
    for path in paths:
        loaded = load_effects(path, taken)
        families += loaded.families
        sources.append(loaded.source)
        taken |= {f.family.family: f"a family of {loaded.source.shown}" for f in loaded.families}
    return EffectLibrary(families=tuple(families), sources=tuple(sources))


def candidates(
    table: ResidualTable, library: EffectLibrary, exclude: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """All candidates of a library on a table, in the order of the library.

    Those that the table cannot test are among them, with the reason. `exclude` names
    candidates (``backlash-x``) or whole families (``backlash``).

    Raises InputError for a name in `exclude` that the library does not have.
    """
    data = TableData.of(table)
    found = []
    _check_excluded(exclude, library)
    with one_blas_thread():
        for family in library.families:
            if family.family.family not in exclude and len(table.axes) >= family.family.least_axes:
                found += [c for c in _of_family(family, data) if c.name not in exclude]
    return tuple(found)


def _check_excluded(exclude: Collection[str], library: EffectLibrary) -> None:
    known = library.names()
    unknown = [
        name
        for name in exclude
        # backlash-z is no mistake where the data has no z.
        if name not in known and not any(name in _possible(family) for family in library.families)
    ]
    if unknown:
        raise InputError(
            [
                finding(
                    "unknown-name",
                    what="effect to exclude",
                    value=name,
                    meant=_meant(name, library),
                    expected=_offered(library),
                )
                for name in unknown
            ]
        )


def _meant(name: str, library: EffectLibrary) -> tuple[str, ...]:
    """What was probably meant by a name that no effect has."""
    families = [known for known in library.names() if "{" not in known]
    text = name.strip().casefold()
    inside = tuple(known for known in families if text and text in known.casefold())
    return inside or nearest(name, [*families, *_all_possible(library)])


def _offered(library: EffectLibrary) -> str:
    families = [known for known in library.names() if "{" not in known]
    return (
        f"a family ({', '.join(families)}) or one of its effects, such as backlash-x; --csv FILE "
        "lists all that your data allows"
    )


def _possible(family: LoadedFamily) -> set[str]:
    axes = ("x", "y", "z")
    return {filled(family.name, {"a": a, "b": b, "n": n}) for a in axes for b in axes for n in axes}


def _all_possible(library: EffectLibrary) -> list[str]:
    return [name for family in library.families for name in sorted(_possible(family))]


def _of_family(family: LoadedFamily, data: TableData) -> Iterator[Candidate]:
    for binding in of_candidates(family, data):
        if family.family.kind == "scatter":
            yield _candidate(family, binding, (), _missing(family, data), (), data)
            continue
        batches, reasons, possible = _batches(family, binding, data)
        if not possible:
            continue
        members, notes = distinct(family.family, batches, data)
        if not members and batches:
            reasons = {**reasons, **dict.fromkeys([_nothing_left(family, data)])}
        used = {name for batch in batches for name in batch.used}
        told = tuple(reasons) if members else ()
        reason = None if members else "; ".join(reasons)
        coarse = [note for batch in batches for note in batch.bound.not_searched(batch.members)]
        notes = (*notes, *coarse, *told, *copy_notes(data, used), *_unusable(family, data))
        yield _candidate(family, binding, members, reason, notes, data)


def _batches(
    family: LoadedFamily, binding: Binding, data: TableData
) -> tuple[list[Batch], dict[str, None], bool]:
    """Members, reasons for those that the data lacks, and whether any could be had at all."""
    batches: list[Batch] = []
    reasons: dict[str, None] = {}
    possible = False
    if family.family.over is not None and len(labels(data.table, family.family.over)) < 2:
        return [], {f"there is one {family.family.over} only": None}, True
    for template in family.templates:
        for bound in of_members(family, template, binding, data):
            if isinstance(bound, str):
                reasons[bound] = None
                possible = True
                continue
            own = BoundTemplate(family=family.family, template=template, binding=bound, data=data)
            try:
                batches.append(own.batch())
                possible = True
            except NoMember as lack:
                if str(lack):
                    reasons[str(lack)] = None
                    possible = True
    return batches, reasons, possible


def _missing(family: LoadedFamily, data: TableData) -> str | None:
    over = family.family.over
    if over is not None and len(labels(data.table, over)) < 2:
        return f"there is one {over} only"
    for name in family.family.needs:
        try:
            check_column(name, data)
        except NoMember as lack:
            return str(lack) or f"no column {name}"
    return None


def _nothing_left(family: LoadedFamily, data: TableData) -> str:
    forms = [form for template in family.templates for form in template.forms.values()]
    levers = [lever for form in forms for lever in form.coefficients.values()]
    if family.family.kind != "offset" and not all(any(names(lever)) for lever in levers):
        return "a parameter of it is a constant, which every effect has beside it: leave it out"
    if data.table.fitted_degree >= 0:
        return "the polynomial that was fitted to these readings holds it"
    return "too few distinct values to tell it from an offset"


def _unusable(family: LoadedFamily, data: TableData) -> tuple[str, ...]:
    if "v" not in family.marks():
        return ()
    return tuple(f"equations cannot use the column {name!r}" for name in data.unusable)


def _candidate(
    family: LoadedFamily,
    binding: Binding,
    members: tuple[Member, ...],
    unavailable: str | None,
    notes: tuple[str, ...],
    data: TableData,
) -> Candidate:
    separates = family.family.separates
    if data.table.component is not None and family.family.separates_readings is not None:
        separates = family.family.separates_readings
    axis = binding.get("n") or binding.get("a", "") + binding.get("b", "")
    return Candidate(
        name=filled(family.name, binding),
        family=family.family.family,
        axis=axis or None,
        says=filled(family.family.says, binding),
        separates=None if separates is None else filled(separates, binding),
        members=members,
        kind=family.family.kind,
        unavailable=unavailable,
        notes=notes,
    )
