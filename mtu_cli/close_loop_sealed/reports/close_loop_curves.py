"""Residuals over what an effect depends on, with the effect as it was fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import pitch_is_open, things
from mtu_cli.close_loop_sealed.reports.close_loop_shown import titled, unit_of
from mtu_cli.language import evaluate, names, parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import significant
from mtu_cli.stats.least_squares import FloatArray

MOST = 3
"""Effects drawn."""
FINE = 400
"""Points of a curve."""
NAMED = 16
"""More categories are drawn by their numbers."""
DIRECTION = "dir_"
WAVE = ("sine", "cosine")
PERIODS = 3.0
"""Of a wave from which on they are laid over one another."""
WITH_MEAN = "the effect, and the mean error, which is not written"
TOGETHER = "all effects together"

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Residuals `y` (n,) over `x` (n,) with the effect at the same cells, `fitted` (n,), and
    between them, `fine` (m,) over (m,), where it depends on nothing else.
    """

    name: str
    x: FloatArray
    y: FloatArray
    fitted: FloatArray | None = None
    fine: tuple[FloatArray, FloatArray] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A panel; `names` are those of categories 0, 1, ... on its horizontal axis, `ticks` the
    only values there; an `example` is one of many curves that fit as well; `line` says what the
    lines are where that is not the effect of the title alone.
    """

    title: str
    xlabel: str
    ylabel: str
    series: tuple[Series, ...]
    names: tuple[str, ...] = ()
    ticks: tuple[float, ...] = ()
    example: bool = False
    line: str = ""


def curves(item: TableResult) -> list[Curve]:
    """A panel an effect, of many the first few, offsets last; without effects the residuals from
    part to part.
    """
    if not item.effects:
        row = things(item)[0]
        return [_by_category(item, f"residuals, {row} by {row}", row, None)]
    return [
        _of_equation(effect, item)
        if effect.equations and effect.kind != "offset"
        else _of_choice(effect, item)
        for effect in _drawn(item)
    ]


def _drawn(item: TableResult) -> list[FoundEffect]:
    """Those that are drawn, in the order found: an offset shows the least."""
    effects = item.effects
    chosen = sorted(range(len(effects)), key=lambda e: effects[e].kind == "offset")[:MOST]
    return [effects[e] for e in sorted(chosen)]


def by_column(item: TableResult) -> Curve:
    """Residuals from feature to feature (position to position)."""
    column = things(item)[1]
    return _by_category(item, f"residuals, {column} by {column}", column, None)


def _of_equation(effect: FoundEffect, item: TableResult) -> Curve:
    """Residuals less the other effects, over the variable of the effect's first equation.

    It is drawn about their mean, as it is judged beside a free offset. Of a pitch that is one of
    many the wave is an example.
    """
    key, text = next(iter(effect.equations.items()))
    axis = key.removeprefix("E")
    a, there = item.table.axes.index(axis), item.table.there
    scale = unit_of(item).to_internal
    env = _environment(effect, item)
    whole = _effect(effect, item, env)
    own = whole[:, :, a][there] / scale
    left = (item.table.errors - item.explained + whole)[:, :, a][there] / scale
    offset = float(left.mean() - own.mean())
    over, apart = _variables(effect, text)
    x = own if over is None else env[over][there]
    if apart is None and over is not None and _repeats(effect, x):
        return _folded(effect, item, over, x, left - own, _ylabel(axis, item))
    fine = None
    if over is not None and apart is None and item.table.datum == "none":
        grid = np.linspace(float(x.min()), float(x.max()), FINE)
        values = np.broadcast_to(evaluate(parse(text), {**env, over: grid}), grid.shape)
        fine = (grid, values / scale + offset)
    return Curve(
        title=titled(effect),
        xlabel=f"the effect as fitted, {item.table.unit}" if over is None else _label(over),
        ylabel=_ylabel(axis, item),
        series=tuple(
            Series(name=name, x=x[mask], y=left[mask], fitted=own[mask] + offset, fine=fine)
            for name, mask in _split(apart, env, there)
        ),
        example=pitch_is_open(effect),
        ticks=(-1.0, 1.0) if over is not None and over.startswith(DIRECTION) else (),
        line=WITH_MEAN if axis in {mean.axis for mean in item.left_means} else "",
    )


def _repeats(effect: FoundEffect, x: FloatArray) -> bool:
    """Whether it is a wave of one pitch that the places `x` (n,) hold several times."""
    if effect.family != "cyclic" or pitch_is_open(effect):
        return False
    known = {name for name, _, _, _ in effect.parameters}
    ((pitch, _, _),) = effect.searched.values()
    return {*WAVE} <= known and float(np.ptp(x)) > PERIODS * pitch


def _folded(
    effect: FoundEffect,
    item: TableResult,
    over: str,
    x: FloatArray,
    rest: FloatArray,
    ylabel: str,
) -> Curve:
    """All periods of a wave laid over one another: means over places farther apart than its pitch
    would be of nothing. `rest` (n,) are the residuals without it at the places `x` (n,).
    """
    ((pitch, _, _),) = effect.searched.values()
    size = {name: value for name, _, value, _ in effect.parameters}
    scale = unit_of(item).to_internal

    def wave(at: FloatArray) -> FloatArray:
        angle = 2 * np.pi * at / pitch
        found: FloatArray = (size["sine"] * np.sin(angle) + size["cosine"] * np.cos(angle)) / scale
        return found

    grid, level = np.linspace(0.0, pitch, FINE), float(rest.mean())
    fitted = wave(x)
    series = Series(
        name="",
        x=np.mod(x, pitch),
        y=rest + fitted,
        fitted=fitted + level,
        fine=(grid, wave(grid) + level),
    )
    return Curve(
        title=titled(effect),
        xlabel=f"{over} within a pitch ({significant(pitch, 6)} mm), mm",
        ylabel=ylabel,
        series=(series,),
    )


def _environment(effect: FoundEffect, item: TableResult) -> dict[str, FloatArray]:
    """Parameters, places and covariates (P, H) by their names in equations."""
    shape = item.table.there.shape
    known: dict[str, FloatArray] = {
        name: np.broadcast_to(values, shape) for name, values in item.table.covariates.items()
    }
    known |= {axis: item.table.places[:, :, i] for i, axis in enumerate(AXES)}
    return known | {name: np.asarray(value) for name, _, value, _ in effect.parameters}


def _effect(effect: FoundEffect, item: TableResult, env: dict[str, FloatArray]) -> FloatArray:
    """What an effect says of every cell, (P, H, A), less the freedoms of the datum."""
    total = np.zeros(item.table.errors.shape)
    for key, text in effect.equations.items():
        axis = key.removeprefix("E")
        if axis in item.table.axes:
            total[:, :, item.table.axes.index(axis)] += evaluate(parse(text), env)
    if item.table.datum == "none":
        return total
    freed: FloatArray = item.table.freed(total[..., None])[..., 0]
    return freed


def _variables(effect: FoundEffect, text: str) -> tuple[str | None, str | None]:
    """What to draw over, and what to draw apart: a direction, else a covariate, beside one
    position or count. None to draw over where there are more, or none at all.
    """
    parameters = {name for name, _, _, _ in effect.parameters}
    known = [name for name in names(parse(text)) if name not in parameters]
    if len(known) == 1:
        return known[0], None
    if len(known) != 2 or set(known) <= set(AXES):
        return None, None
    known.sort(key=lambda name: (name.startswith(DIRECTION), name not in AXES))
    return known[0], known[1]


def _split(
    apart: str | None, env: dict[str, FloatArray], there: Mask
) -> Iterator[tuple[str, Mask]]:
    """Names and masks (n,) of the series."""
    if apart is None:
        yield "", np.ones(int(there.sum()), dtype=bool)
        return
    values = env[apart][there]
    limit = 0.0 if apart.startswith(DIRECTION) else float(np.median(values))
    low, high = (
        (f"{apart} -1", f"{apart} +1")
        if apart.startswith(DIRECTION)
        else (f"{apart} low", f"{apart} high")
    )
    yield low, values <= limit
    yield high, values > limit


def _label(name: str) -> str:
    if name in AXES:
        return f"{name}, mm"
    return {"time_min": "time, min", "sequence": "sequence"}.get(name, name)


def _ylabel(axis: str, item: TableResult) -> str:
    less = " (other effects taken out)" if len(item.effects) > 1 else ""
    return f"residual{_of_axis([axis], item)}{less}, {item.table.unit}"


def _of_axis(axes: Sequence[str], item: TableResult) -> str:
    """The name of what is drawn, where it is one: beside several the legend has their names."""
    return f" {item.table.component or f'E{axes[0]}'}" if len(axes) == 1 else ""


def _of_choice(effect: FoundEffect, item: TableResult) -> Curve:
    """Residuals over the features, parts or operations of which one was chosen, or that scatter."""
    row, column = things(item)
    table = item.table
    if effect.chosen in table.operations or effect.family == "operation-scatter":
        over = "operation"
    elif effect.chosen in table.parts or effect.chosen is None:
        over = row
    else:
        over = column
    title = effect.name if effect.chosen is None else f"{effect.name}: {effect.chosen}"
    return _by_category(item, title, over, effect)


def _by_category(item: TableResult, title: str, over: str, effect: FoundEffect | None) -> Curve:
    """Residuals of all axes, or of the effect's own, category by category."""
    table, there = item.table, item.table.there
    row, column = things(item)
    number, labels = {
        row: (np.arange(len(table.parts))[:, None], table.parts),
        column: (np.arange(len(table.features))[None], table.features),
        "operation": (table.operation[None], table.operations),
    }[over]
    named = len(labels) <= NAMED
    x = np.broadcast_to(number, there.shape)[there] + (0.0 if named else 1.0)
    axes: Sequence[str] = table.axes
    if effect is not None and effect.axis in table.axes:
        axes = [effect.axis]
    scale = unit_of(item).to_internal
    drawn = effect is not None and effect.kind != "scatter"
    series = []
    for axis in axes:
        a = table.axes.index(axis)
        fitted = item.explained[:, :, a][there] / scale if drawn else None
        y = table.errors[:, :, a][there] / scale
        series.append(Series(name=axis, x=x, y=y, fitted=fitted))
    return Curve(
        title=title,
        xlabel=over if named else f"{over}, in order",
        ylabel=f"residual{_of_axis(axes, item)}, {table.unit}",
        series=tuple(series),
        names=tuple(labels) if named else (),
        line=TOGETHER if drawn and len(item.effects) > 1 else "",
    )
