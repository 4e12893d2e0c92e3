"""How large a scatter is: of what was drawn, and of one table by the plain formula."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import grid_places
from effect_tables import table as points_table
from separation_examples import LIBRARY, index
from warm_day import described, found, step

from mtu_cli.close_loop_sealed.analyses.loop.describe import found_effects
from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scatter_size import scatter_size
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.loose_columns import log_variance_u

PARTS, FEATURES, TABLES = 21, 24, 150
NOISE = 1.5e-3
GROWS = "thermal-squareness-xy"
SIZES = {"rotation-scatter": 2.5e-5, "scale-scatter": 2e-5, "operation-scatter": 4e-3}
"""rad, mm/mm, mm."""


@cache
def ready() -> Prepared:
    table = points_table(PARTS, FEATURES, places=grid_places(FEATURES, jitter=2.0))
    table = replace(table, errors=drawn(0, "", table.places))
    known = [c for c in candidates(table, LIBRARY) if c.name in (*SIZES, "scale-x", GROWS)]
    return prepare(table, known)


def drawn(seed: int, name: str, places: Floats) -> Floats:
    rng = np.random.default_rng(seed)
    errors = NOISE * rng.normal(size=(PARTS, FEATURES, 2))
    x, y = (places[..., i] - places[..., i].mean() for i in (0, 1))
    size = SIZES.get(name, 0.0) * rng.normal(size=(PARTS, 1))
    if name == "rotation-scatter":
        errors += np.stack([-size * y, size * x], axis=-1)
    elif name == "scale-scatter":
        errors += np.stack([size * x, size * y], axis=-1)
    elif name == "operation-scatter":
        errors[:, ::3] *= SIZES[name] / NOISE
    return errors


def size_in(seed: int, name: str) -> ScatterSize:
    own = ready()
    moved = own.with_table(replace(own.table, errors=drawn(seed, name, own.table.places)))
    told = scatter_size(moved, (), step(moved, name))
    assert told is not None
    return told


@pytest.mark.parametrize("name", SIZES)
def test_sizes_are_those_that_were_drawn(name: str) -> None:
    """In the mean, to the standard error of it; and u is how far they scatter about it."""
    told = [size_in(seed, name).parameter for seed in range(TABLES)]
    s, u = (np.array([own[i] for own in told]) for i in (2, 3))
    # Of variances the estimate is without bias.
    error = np.std(s**2) / np.sqrt(TABLES)
    assert abs(np.mean(s**2) - SIZES[name] ** 2) < 4 * error + 0.01 * SIZES[name] ** 2
    # The spread of 150 values is known to 6 %; of normal ones four of it are 24 %.
    assert np.mean(u) == pytest.approx(np.std(s), rel=0.24)


def test_an_operation_is_told_with_all_others() -> None:
    told = size_in(1, "operation-scatter")
    assert told.of == "drilled"
    assert told.others == pytest.approx(NOISE, rel=0.1)
    assert told.parameter[:2] == ("s", "um")
    assert size_in(1, "rotation-scatter").parameter[:2] == ("s", "arcsec")
    assert size_in(1, "scale-scatter").parameter[:2] == ("s", "um/m")
    assert size_in(1, "scale-scatter").of is None


@pytest.mark.parametrize("ratio", [3.0, 20.0])
def test_others_are_told_by_themselves(ratio: float) -> None:
    """However much more one of them scatters, which all have in common with it."""
    own, told = ready(), []
    for seed in range(20):
        errors = drawn(seed, "", own.table.places)
        errors[:, ::3] *= ratio
        moved = own.with_table(replace(own.table, errors=errors))
        size = scatter_size(moved, (), step(moved, "operation-scatter"))
        assert size is not None
        assert size.others is not None
        told.append((size.parameter[2] ** 2, size.others**2))
    mean, error = np.mean(told, axis=0), np.std(told, axis=0) / np.sqrt(len(told))
    truth = NOISE**2 * np.array([ratio**2, 1.0])
    assert (np.abs(mean - truth) < 4 * error + 0.01 * truth).all()


def test_an_operation_scatters_by_the_mean_of_its_axes() -> None:
    own = ready()
    errors = drawn(1, "operation-scatter", own.table.places)
    errors[..., 1] *= 3
    moved = own.with_table(replace(own.table, errors=errors))
    told = scatter_size(moved, (), step(moved, "operation-scatter"))
    assert told is not None
    mean = np.sqrt((1 + 9) / 2)
    assert told.parameter[2] == pytest.approx(mean * SIZES["operation-scatter"], rel=0.15)
    assert told.others == pytest.approx(mean * NOISE, rel=0.15)


def test_growths_are_told_of_each_axis() -> None:
    """One number of both is right for neither where X grows alone."""
    own, told = ready(), []
    x = own.table.places[..., 0] - own.table.places[..., 0].mean()
    axes = set()
    for seed in range(60):
        errors = drawn(seed, "", own.table.places)
        grown = np.random.default_rng([9, seed]).normal(size=(PARTS, 1))
        errors[..., 0] += 4e-5 * grown * x
        moved = own.with_table(replace(own.table, errors=errors))
        size = scatter_size(moved, (), step(moved, "scale-scatter"))
        assert size is not None
        told.append([s for _, s in size.by_axis])
        axes.add(tuple(axis for axis, _ in size.by_axis))
    assert axes == {("x", "y")}
    squares = np.mean(np.square(told), axis=0)
    error = np.std(np.square(told), axis=0) / np.sqrt(len(told))
    assert abs(squares[0] - 4e-5**2) < 4 * error[0]
    assert squares[1] < 1e-5**2


def test_holes_in_a_row_have_fewer_directions() -> None:
    """What four holes in a row scatter by is told of themselves, as that of others is."""
    x = np.array([10.0, 60.0, 110.0, 160.0, *np.tile([10.0, 60.0, 110.0, 160.0], 2)])
    y = np.repeat([5.0, 80.0, 140.0], 4)
    places = np.stack([x, y, np.full(12, 10.0)], axis=1)
    table = points_table(12, 12, places=places, operations=("reamed", "drilled"))
    table = replace(table, operation=(np.arange(12) >= 4).astype(int))
    rng, told = np.random.default_rng(5), []
    for _ in range(40):
        errors = NOISE * rng.normal(size=(12, 12, 2))
        errors[:, :4] *= 3
        own = replace(table, errors=errors)
        known = [c for c in candidates(own, LIBRARY) if c.name == "operation-scatter"]
        prepared = prepare(own, known)
        size = scatter_size(prepared, (), step(prepared, "operation-scatter"))
        assert size is not None
        assert size.others is not None
        told.append([size.parameter[2] ** 2, *(s**2 for _, s in size.by_axis), size.others**2])
    mean = np.sqrt(np.mean(told, axis=0)) / NOISE
    np.testing.assert_allclose(mean, [3.0, 3.0, 3.0, 1.0], rtol=0.1)


def test_an_operation_of_few_holes_may_be_the_one() -> None:
    """Three holes tell nothing by themselves, and the others scatter no more for that."""
    table = points_table(PARTS, FEATURES, places=grid_places(FEATURES, jitter=2.0))
    operation = np.where(np.arange(FEATURES) < 3, 1, np.arange(FEATURES) % 2 * 2)
    for seed in range(10):
        errors = drawn(seed, "", table.places)
        errors[:, :3] *= 6
        own = replace(table, operation=operation, errors=errors)
        known = [c for c in candidates(own, LIBRARY) if c.name == "operation-scatter"]
        prepared = prepare(own, known)
        size = scatter_size(prepared, (), step(prepared, "operation-scatter"))
        assert size is not None
        assert size.of == own.operations[1]
        assert size.parameter[2] > 3 * NOISE
        assert size.others == pytest.approx(NOISE, rel=0.15)


def test_where_the_places_hardly_differ_an_axis_is_left_out() -> None:
    own = ready()
    places = own.table.places.copy()
    places[..., 1] = 50.0 + 1e-3 * np.arange(FEATURES)
    table = replace(own.table, places=places)
    x = places[..., 0] - places[..., 0].mean()
    grown = 5e-5 * np.random.default_rng(4).normal(size=(PARTS, 1))
    errors = drawn(4, "", own.table.places)
    errors[..., 0] += grown * x
    known = [c for c in candidates(table, LIBRARY) if c.name == "scale-scatter"]
    moved = prepare(replace(table, errors=errors), known)
    told = scatter_size(moved, (), step(moved, "scale-scatter"))
    assert told is not None
    assert [axis for axis, _ in told.by_axis] == ["x"]


def of_holes(seed: int, own: list[int], missing: float = 0.0) -> ScatterSize:
    """Holes of the operation "drilled" that scatter more, of a table with some cells missing."""
    table, rng = ready().table, np.random.default_rng([seed, 4])
    errors = drawn(seed, "", table.places)
    errors[:, own] *= SIZES["operation-scatter"] / NOISE
    gone = rng.random((PARTS, FEATURES)) < missing
    errors[gone] = np.nan
    code = np.ones(FEATURES, int)
    code[own] = 0
    less = replace(table, errors=errors, repeats=np.where(gone, 0, table.repeats), operation=code)
    known = [c for c in candidates(less, LIBRARY) if c.name == "operation-scatter"]
    prepared = prepare(less, known)
    size = scatter_size(prepared, (), step(prepared, "operation-scatter"))
    assert size is not None
    return size


@pytest.mark.parametrize(
    ("own", "missing"),
    [
        ([0, 3, 6, 9, 12, 15, 18, 21], 0.1),
        ([0, 3, 6, 9, 12, 15, 18, 21], 0.2),
        ([0, 9, 14, 19], 0.0),
        ([0, 4, 9, 14, 19], 0.1),
    ],
)
def test_few_holes_and_missing_cells_leave_the_scatter_of_an_operation_as_it_is(
    own: list[int], missing: float
) -> None:
    """In the mean, and in u: of 80 values sd is known to 8 %, and it is no more than u by four of
    that; u of so few holes is somewhat large, as their tails are not known well.
    """
    told = [of_holes(seed, own, missing) for seed in range(80)]
    assert {size.of for size in told} == {"drilled"}
    truth = SIZES["operation-scatter"]
    s, u = (np.array([size.parameter[i] for size in told]) for i in (2, 3))
    assert abs(np.mean(s**2) - truth**2) < 4 * np.std(s**2) / np.sqrt(80)
    assert np.std(s) < 1.32 * np.mean(u)
    assert np.mean(u) < 1.6 * np.std(s)
    others = np.array([size.others for size in told], float)
    assert abs(np.mean(others**2) - NOISE**2) < 4 * np.std(others**2) / np.sqrt(80)


def three_operations(seed: int) -> tuple[ResidualTable, Floats]:
    table = replace(
        ready().table,
        operations=("reamed", "drilled", "bored"),
        operation=np.arange(FEATURES) % 3,
    )
    return table, drawn(seed, "", table.places)


def size_of(table: ResidualTable, errors: Floats) -> ScatterSize:
    own = replace(table, errors=errors)
    known = [c for c in candidates(own, LIBRARY) if c.name == "operation-scatter"]
    prepared = prepare(own, known)
    size = scatter_size(prepared, (), step(prepared, "operation-scatter"))
    assert size is not None
    return size


def test_the_operation_that_stands_out_along_any_axis_is_named() -> None:
    """Five holes scatter 1.5 times as much along both; five 3 times along y and less along x: in
    the mean of the axes these stand out less.
    """
    operation = np.full(FEATURES, 2)
    operation[[0, 9, 14, 19, 23]], operation[[4, 7, 12, 17, 21]] = 0, 1
    for seed in range(10):
        table, errors = three_operations(seed)
        errors[:, operation == 0] *= 1.5
        errors[:, operation == 1] *= (0.4, 3.0)
        told = size_of(replace(table, operation=operation), errors)
        assert told.of == "drilled"
        by_axis, others = dict(told.by_axis), dict(told.others_by_axis)
        assert by_axis["y"] > 1.5 * others["y"]
        assert by_axis["x"] < 0.6 * others["x"]


def test_an_axis_along_which_hardly_anything_differs_names_none() -> None:
    """y is 0 but in two cells of "drilled", and "reamed" scatters along x."""
    for seed in range(10):
        table, errors = three_operations(seed)
        errors[:, ::3, 0] *= 4
        errors[..., 1] = 0.0
        errors[3, 1, 1], errors[5, 7, 1] = 1e-3, -1e-3
        told = size_of(table, errors)
        assert told.of == "reamed"
        assert dict(told.by_axis)["y"] == 0.0
        assert dict(told.by_axis)["x"] > 2 * dict(told.others_by_axis)["x"]


def test_turns_are_told_of_each_axis() -> None:
    """Where y alone leans over, part by part, parts do not turn: a turn moves both alike."""
    own = ready()
    x = own.table.places[..., 0] - own.table.places[..., 0].mean()
    errors = drawn(2, "", own.table.places)
    angle = np.random.default_rng(8).normal(size=(PARTS, 1))
    errors[..., 1] += 4e-5 * angle * x
    moved = own.with_table(replace(own.table, errors=errors))
    told = scatter_size(moved, (), step(moved, "rotation-scatter"))
    assert told is not None
    by_axis = dict(told.by_axis)
    assert by_axis["y"] == pytest.approx(4e-5 * np.std(angle, ddof=1), rel=0.1)
    assert by_axis["x"] < 1e-5
    both = dict(size_in(1, "rotation-scatter").by_axis)
    assert both["x"] == pytest.approx(both["y"], rel=0.35)


def test_an_operation_is_told_of_each_axis() -> None:
    own = ready()
    errors = drawn(4, "", own.table.places)
    errors[:, ::3, 0] *= 4
    moved = own.with_table(replace(own.table, errors=errors))
    told = scatter_size(moved, (), step(moved, "operation-scatter"))
    assert told is not None
    by_axis = dict(told.by_axis)
    assert by_axis["x"] == pytest.approx(4 * NOISE, rel=0.2)
    assert by_axis["y"] == pytest.approx(NOISE, rel=0.2)


def test_where_parts_do_not_turn_there_is_no_size() -> None:
    """In about half of the tables the turns are fewer than noise makes by itself."""
    own = ready()
    sizes = []
    for seed in range(60):
        moved = own.with_table(replace(own.table, errors=drawn(seed, "", own.table.places)))
        sizes.append(scatter_size(moved, (), step(moved, "rotation-scatter")))
    none = sum(size is None for size in sizes)
    assert 15 <= none <= 50
    assert scatter_size(own, (), step(own, "scale-x")) is None


def test_it_is_what_is_left_beside_the_effects_found() -> None:
    own = ready()
    errors = drawn(3, "rotation-scatter", own.table.places)
    alone = size_in(3, "rotation-scatter")
    # A change of the angle is of parts along the lines that a turn is of, too.
    grows, turn = step(own, GROWS), step(own, "rotation-scatter")
    errors[..., 0] += 3e-5 * own.members[grows.member].columns[0][0]
    moved = own.with_table(replace(own.table, errors=errors))
    effects = found_effects(described(moved, found(moved, grows, turn)), [None] * 2)
    assert effects[0].scatter is None
    told = effects[1].scatter
    assert told is not None
    with_it = scatter_size(moved, (), turn)
    assert with_it is not None
    assert with_it.parameter[2] > 1.05 * alone.parameter[2]
    assert told.parameter[2] == pytest.approx(alone.parameter[2], rel=0.15)
    assert effects[1].name == own.candidates[index(own, "rotation-scatter")].name


@pytest.mark.parametrize("kind", ["normal", "laplace"])
def test_u_of_the_logarithm_of_a_variance(kind: str) -> None:
    """Against the spread over many samples; heavy tails make it larger."""
    rng = np.random.default_rng(4)
    draw = rng.normal if kind == "normal" else rng.laplace
    samples = [draw(size=400) for _ in range(2000)]
    spread = float(np.std([np.log(np.mean(a**2)) for a in samples]))
    told = float(np.mean([log_variance_u(a, 1.0) for a in samples]))
    assert told == pytest.approx(spread, rel=0.08)
    assert log_variance_u(samples[0], 0.25) == pytest.approx(2 * log_variance_u(samples[0], 1.0))
    assert np.isinf(log_variance_u(samples[0], 0.0))
    assert np.isinf(log_variance_u(np.zeros(5), 1.0))


@pytest.mark.parametrize("name", ["rotation-scatter", "scale-scatter"])
def test_missing_cells_make_no_turn_smaller(name: str) -> None:
    """What is filled in for a feature far from all others has none of its part's turn."""
    places = grid_places(FEATURES, jitter=2.0)
    places[FEATURES - 1, :2] += 400.0
    there = np.random.default_rng(5).random((PARTS, FEATURES)) >= 0.3
    table = points_table(PARTS, FEATURES, places=places)
    table = replace(table, repeats=np.where(there, table.repeats, 0))
    errors = np.where(there[..., None], drawn(0, name, table.places), np.nan)
    table = replace(table, errors=errors)
    known = [c for c in candidates(table, LIBRARY) if c.name in (*SIZES, "scale-x")]
    own, told = prepare(table, known), []
    for seed in range(60):
        errors = np.where(there[..., None], drawn(seed, name, table.places), np.nan)
        moved = own.with_table(replace(table, errors=errors))
        found = scatter_size(moved, (), step(moved, name))
        assert found is not None
        told.append([found.parameter[2], *(s for _, s in found.by_axis)])
    squares = np.array(told) ** 2
    wanted = (SIZES[name] / 1.0) ** 2
    error = squares.std(axis=0) / np.sqrt(len(told))
    assert (abs(squares.mean(axis=0) - wanted) < 4 * error + 0.01 * wanted).all()


@pytest.mark.parametrize("name", ["rotation-scatter", "scale-scatter"])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_turns_of_both_axes_differ_by_scatter_alone(name: str, missing: float) -> None:
    """p is uniform: below 0.1 in a tenth of all tables, to four standard errors."""
    own, p = ready(), []
    there = np.random.default_rng(7).random((PARTS, FEATURES)) >= missing
    for seed in range(TABLES):
        errors = np.where(there[..., None], drawn(seed, name, own.table.places), np.nan)
        table = replace(own.table, errors=errors, repeats=own.table.repeats * there)
        moved = own.with_table(table) if missing == 0 else prepare(table, own.candidates)
        told = scatter_size(moved, (), step(moved, name))
        assert told is not None
        assert told.p_alike is not None
        p.append(told.p_alike)
    for limit in (0.1, 0.5):
        error = np.sqrt(limit * (1 - limit) / TABLES)
        assert abs(np.mean(np.array(p) < limit) - limit) < 4 * error


def test_a_growth_of_one_axis_is_not_that_of_parts() -> None:
    own = ready()
    errors = drawn(1, "", own.table.places)
    x = own.table.places[..., 0] - own.table.places[..., 0].mean()
    errors[..., 0] += 4e-5 * np.random.default_rng(9).normal(size=(PARTS, 1)) * x
    moved = own.with_table(replace(own.table, errors=errors))
    told = scatter_size(moved, (), step(moved, "scale-scatter"))
    assert told is not None
    assert told.p_alike is not None
    assert told.p_alike < 1e-3
