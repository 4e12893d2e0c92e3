"""Effects: declared, of a report together, and beyond what they were found on."""

import json
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from effect_tables import grid_places, readings_table, shop_covariates, table
from model_examples import loaded, part_of, stated
from support import read_components, written_effect

from mtu_cli.analyses.predictions import predict_lengths, predict_orthogonality, predict_points
from mtu_cli.files.effects import Search
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.reports_read import Matrix
from mtu_cli.model.effect_library import (
    CONSTANT,
    BoundTemplate,
    Candidate,
    TableData,
    candidates_of,
    effect_library,
)
from mtu_cli.model.effect_parameters import grid_of, joint_effects
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.features import guess_warnings
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, machine_warnings
from mtu_cli.model.machine_model import build_model, design
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

MACHINE = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
equations: {Ex: a, Ey: 0.5*a}
"""
EFFECTS = """
effects:
  - name: backlash-x
    parameters: {lost_motion: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: lost_motion*dir_x}
  - name: turn
    parameters: {angle: {value: 5.0, u: 0.5, unit: arcsec}, shift: {value: 1.0, u: 0.2, unit: um}}
    covariance: [[0.25, 0.03], [0.03, 0.04]]
    equations: {Ex: -angle*(y - 3), Ey: angle*x + shift}
"""
NAMES = ["backlash-x.lost_motion", "turn.angle", "turn.shift"]
C = [[0.1, 0.05, -0.01], [0.05, 0.3, 0.02], [-0.01, 0.02, 0.05]]
UNITS = ["um", "arcsec", "um"]
F = np.array([1e-3, np.pi / 648000, 1e-3])
POINTS = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
DIRECTION = np.array([1.0, -1, 1])


def reported(folder: Path, machine: LoadedMachine, effects: dict[str, Any]) -> Estimates:
    path = folder / "c.json"
    document = {"schema": "mtu/fit-components/1", "results": {"components": {}, "effects": effects}}
    path.write_text(json.dumps(document))
    return estimates_from_report(machine, read_components(path))


def together(
    names: list[str] = NAMES, covariance: Matrix = C, values: tuple[float, ...] = (2, 5, 1)
) -> dict[str, Any]:
    rows = [NAMES.index(name) for name in names if name in NAMES]
    return {
        "parameters": names,
        "units": [UNITS[row] for row in rows],
        "values": [values[row] for row in rows],
        "covariance": [[covariance[i][j] for j in rows] for i in rows],
    }


def predicted(machine: LoadedMachine, estimates: Estimates) -> Prediction:
    ids = ["1", "2", "3"]
    return predict(build_model(machine, estimates), ids, POINTS, {"dir_x": DIRECTION})


def test_the_joint_covariance_of_a_report_counts(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    bare = predicted(loaded(tmp_path, MACHINE), estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together())
    found = predicted(machine, estimates)
    J = np.zeros((6, 3))
    J[0::2, 0], J[0::2, 1] = DIRECTION, -(POINTS[:, 1] - 3)
    J[1::2, 1], J[1::2, 2] = POINTS[:, 0], 1
    assert found.mean - bare.mean == pytest.approx(J @ (np.array([2.0, 5, 1]) * F), rel=1e-9)
    more = J @ (np.array(C) * np.outer(F, F)) @ J.T
    assert found.covariance - bare.covariance == pytest.approx(more, rel=1e-9)
    A = np.random.default_rng(0).normal(size=(4, 6))
    variance = found.variance(A)
    assert variance.total == pytest.approx(
        bare.variance(A).total + np.diag(A @ more @ A.T), rel=1e-9
    )
    assert variance.passes == pytest.approx(bare.variance(A).passes)
    assert machine_warnings(machine, estimates) == []
    (warning,) = machine_warnings(loaded(tmp_path, MACHINE), estimates)
    assert f"not used ({', '.join(NAMES)}): machine.yaml has no such effects" in warning.message


def test_values_of_a_report_win(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    own = predicted(machine, estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together(values=(0, 5, 1)))
    found = predicted(machine, estimates)
    assert (own.mean - found.mean)[0::2] == pytest.approx(2e-3 * DIRECTION, rel=1e-9)


def test_old_and_new_effects_in_one_covariance(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    assert joint_effects(loaded(tmp_path, MACHINE), None, (), np.zeros((0, 0))) is None
    found = joint_effects(machine, None, ("backlash-x.lost_motion",), np.array([[7e-6]]))
    assert found is not None
    assert list(found.names) == NAMES
    own = np.array([[7, 0, 0], [0, 0.25, 0.03], [0, 0.03, 0.04]])
    assert found.covariance == pytest.approx(own * np.outer(F, F), rel=1e-12)
    assert found.values == pytest.approx(np.array([2, 5, 1]) * F, rel=1e-12)


# Declared effects beyond what they were found on.


ONE_EFFECT = (
    MACHINE
    + """
effects:
  - name: one
    parameters: {p: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: p*exp(-time_min/30)}
    seen: {time_min: [0, 100]}
"""
)


@pytest.mark.parametrize(
    ("time", "at"),
    [
        (110.0, None),
        (-10.0, None),
        (110.1, "110.1"),
        (-50.0, "-50"),
        (np.array([50.0, 150.0, -70.0]), "-70"),
    ],
)
def test_a_tenth_of_the_range_is_no_matter(
    tmp_path: Path, time: FloatArray | float, at: str | None
) -> None:
    found = guess_warnings(stated(tmp_path, ONE_EFFECT), POINTS, {"time_min": time})
    said = "the data of one have time_min from 0 to 100: extrapolated to "
    assert [said in item.message and item.message.endswith(str(at)) for item in found] == (
        [] if at is None else [True]
    )


def test_every_prediction_warns(tmp_path: Path) -> None:
    model = stated(tmp_path, ONE_EFFECT)
    part = part_of(
        tmp_path,
        """
        features: {A: {x_mm: 0, y_mm: 0}, B: {x_mm: 90, y_mm: 0}, C: {x_mm: 90, y_mm: 90}}
        lengths: [{from: A, to: B}]
        orthogonality: [{id: xy, row: [A, B], column: [B, C]}]
        """,
    )
    settings, far = Settings(trials=1000), {"time_min": 500.0}
    for command in (predict_points, predict_lengths, predict_orthogonality):
        found = command(model, part, settings, far).warnings
        assert [w.code for w in found].count("outside-effect-range") == 1


# The effects block: what close-loop found, added to the equations.


DECLARED = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
  t: {unit: urad, coefficients: [4.0], covariance: [[0.2]]}
equations: {Ex: a - y*t, Ey: x*t}
"""
PLACES = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
NAMED = ["1", "2", "3"]


def test_an_effect_in_a_component_adds_to_its_lever_arm(tmp_path: Path) -> None:
    """A thermal stretch of a component: Ex gains 0.5 a, whose uncertainty is a's own."""
    text = """
effects:
  - name: stretch
    parameters: {k: {value: 1.0, u: 0.1, unit: um}}
    equations: {Ex: 0.5*a + k, Ey: -2*a}
"""
    plain = predict(stated(tmp_path, DECLARED), NAMED, PLACES)
    found = predict(stated(tmp_path, DECLARED + text), NAMED, PLACES)
    a = (1 + 0.1 * PLACES[:, 0]) * 1e-3
    assert found.mean[0::2] - plain.mean[0::2] == pytest.approx(0.5 * a + 1e-3, rel=1e-9)
    assert found.mean[1::2] - plain.mean[1::2] == pytest.approx(-2 * a, rel=1e-9)
    x, y = PLACES[:, 0], PLACES[:, 1]
    of_a = (0.4 + 1e-4 * x**2 + 0.49) * 1e-6
    t = 0.2e-12
    diagonal = np.diag(found.covariance)
    assert diagonal[0::2] == pytest.approx(1.5**2 * of_a + y**2 * t + 0.01e-6, rel=1e-12)
    assert diagonal[1::2] == pytest.approx(4 * of_a + x**2 * t, rel=1e-12)
    cross = np.array([found.covariance[2 * i, 2 * i + 1] for i in range(3)])
    assert cross == pytest.approx(-3 * of_a - x * y * t, rel=1e-12)


def test_a_component_of_an_effect_counts_as_one_of_the_machine(tmp_path: Path) -> None:
    table = """{of: x, unit: um, shape: table, at_mm: [0, 40, 80], coefficients: [0, 3, -1],
      covariance: [[0.1, 0, 0], [0, 0.2, 0.1], [0, 0.1, 0.3]], roughness_um2_per_mm3: 1.0e-4}"""
    effect = f"\neffects:\n  - name: e\n    equations: {{Ex: p}}\n    components: {{p: {table}}}\n"
    declared = predict(stated(tmp_path, DECLARED + effect), NAMED, PLACES)
    plain = DECLARED.replace("equations: {Ex: a", f"  p: {table}\nequations: {{Ex: p + a")
    own = predict(stated(tmp_path, plain), NAMED, PLACES)
    assert declared.mean == pytest.approx(own.mean, rel=1e-12)
    assert declared.covariance == pytest.approx(own.covariance, rel=1e-9)


# The library of effects: levers, equations, names and grids, against formulas written out.


PLANE = table()
SPACE = table(axes=("x", "y", "z"), places=grid_places(12, jitter=2.0, z=None))


def found_on(own: ResidualTable, *files: Path) -> dict[str, Candidate]:
    return {item.name: item for item in candidates_of(own, effect_library(files))}


def forms_of(own: ResidualTable, name: str, *files: Path) -> list[BoundTemplate]:
    return list(found_on(own, *files)[name].forms)


def values_of(own: ResidualTable) -> dict[str, FloatArray]:
    """Every name of the equations over the cells, (P, H)."""
    shape = own.repeats.shape
    values = {axis: own.places[..., i] for i, axis in enumerate("xyz")}
    return values | {n: np.broadcast_to(v, shape) for n, v in own.covariates.items()}


def members_of(form: BoundTemplate) -> Iterator[tuple[float, list[FloatArray]]]:
    """Each value of the grid, with the columns (P, H, A) of its parameters."""
    levers = form.columns(form.grid)
    for g, value in enumerate(form.grid.tolist()):
        columns = [np.zeros(form.data.table.errors.shape) for _ in levers]
        for full, lever in zip(columns, levers, strict=True):
            for axis, values in lever.items():
                full[..., axis] = values[g if len(values) > 1 else 0]
        yield value, columns


# What there is.


def test_candidates_of_a_plane_of_a_space_and_of_readings() -> None:
    plane, space, axis = (found_on(own) for own in (PLANE, SPACE, readings_table()))
    for name in ("offset-x", "scale", "scale-y", "squareness-xy", "rotation-z"):
        assert plane[name].unavailable is None, name
    assert not {"scale-z", "rotation-x", "squareness-xz", "abbe-z", "scale-trend-z"} & set(plane)
    for name, axes in (("rotation-x", "yz"), ("rotation-y", "zx"), ("thermal-growth", "xyz")):
        assert list(space[name].forms[0].texts()) == [f"E{axis}" for axis in axes]
    assert space["backlash-z"].unavailable == "no column dir_z"
    found = {name for name, item in axis.items() if item.forms}
    wanted = {"scale-trend-x", "trend-x", "cyclic-x", "step-x", "part-outlier", "warm-up-x"}
    assert wanted <= found
    assert not any(name.startswith(("squareness", "rotation", "radial")) for name in axis)


def formulas(own: ResidualTable) -> dict[str, list[dict[str, Any]]]:
    """Candidate -> some of its members: errors in mm by axis for a parameter of 1."""
    v = values_of(own)
    x, y, T = v["x"] - v["x"].mean(), v["y"] - v["y"].mean(), v["T_spindle_degC"]
    r = np.hypot(x, y)
    return {
        "offset-y": [{"y": 1.0}],
        "scale": [{"x": x, "y": y}],
        "scale-x": [{"x": x}],
        "straightness-x": [{"x": y**2}],
        "squareness-xy": [{"x": -y}, {"y": -x}, {"x": -y / 2, "y": -x / 2}],
        "rotation-z": [{"x": -y, "y": x}],
        "backlash-y": [{"y": v["dir_y"]}],
        "thermal-drift-x": [{"x": T - 20.0}],
        "thermal-growth-y": [{"y": y * (T - 20.0)}],
        "trend-x": [{"x": v[n] - v[n].mean()} for n in ("sequence", "tool_parts")],
        "wear-approach-y": [{"y": (v["tool_parts"] - 1.0) * v["dir_y"]}],
        "step-x": [{"x": v["sequence"] > at} for at in range(2, 8)],
        "radial": [{"x": x / r, "y": y / r}],
    }


@pytest.mark.parametrize("name", sorted(formulas(PLANE)))
def test_columns_are_the_formulas(name: str) -> None:
    members = [c for form in forms_of(PLANE, name) for _, c in members_of(form)]
    own = [columns[0] for columns in members if len(columns) == 1]
    for errors in formulas(PLANE)[name]:
        plain = np.zeros((9, 12, 2))
        for axis, values in errors.items():
            plain[..., "xy".index(axis)] = values
        near = 1e-9 * np.abs(plain).max()
        assert sum(np.abs(columns - plain).max() <= near for columns in own) == 1


# Equations give the columns back.


@pytest.mark.parametrize("own", [PLANE, SPACE, readings_table()], ids=["xy", "xyz", "readings"])
def test_a_machine_file_takes_the_forms_and_predicts_their_columns(
    tmp_path: Path, own: ResidualTable
) -> None:
    """By their units, too; margins as well."""
    whole = [form for item in found_on(own).values() for form in item.forms]
    forms = chain.from_iterable((form, *form.margins) for form in whole)
    named = {f"e{i}": form for i, form in enumerate(forms) if form.family.over is None}
    first = {name: next(members_of(form)) for name, form in named.items()}
    machine = {
        "schema": "mtu/machine/1",
        "name": "m",
        "covariates": ["tool_parts", "load"],
        "components": {"a0": {"unit": "um", "coefficients": [0.0]}},
        "equations": {f"E{axis}": "a0" for axis in own.axes},
        "effects": [
            written_effect(
                {n: (1, 0.1, u) for n, u in form.parameters.items()},
                name=name,
                covariate=form.covariate,
                equations=form.texts(first[name][0]),
            )
            for name, form in named.items()
        ],
    }
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(machine), encoding="utf-8")
    loaded = load_machine(tmp_path / "m.yaml")
    model = build_model(loaded, estimates_from_fit(loaded, None))
    values = {n: v.ravel() for n, v in values_of(own).items() if n not in "xyz"}
    J = design(model, own.places.reshape(-1, 3), values).J.reshape(*own.errors.shape, -1)
    place = {term.estimate.name: i for i, term in enumerate(model.terms)}
    for name, form in named.items():
        for parameter, plain in zip(form.parameters, first[name][1], strict=True):
            near = 4e-16 * max(1.0, np.abs(plain).max())
            assert np.abs(J[..., place[f"{name}.{parameter}"]] - plain).max() <= near, name


# Numbers of the data, kinds of columns, what is lacking.


@pytest.mark.parametrize(
    ("values", "counts"),
    [
        ([1, 1, 1, 2, 2, 2, 3, 3, 3], True),
        ([0, 10, 20, 30, 0, 10, 20, 30, 40], True),
        ([1, 2, 1, 2, 1, 2, 1, 2, 1], False),
        ([1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5], False),
        ([1, 2, 3, 4, 9, 8, 9, 10, 11], False),
    ],
)
def test_which_columns_count_parts(values: list[float], counts: bool) -> None:
    covariates = shop_covariates(9, 12) | {"n": np.array(values, float)[:, None]}
    data = TableData(table(covariates=covariates))
    assert ("n" in data.columns["c"], "n" in data.columns["v"]) == (counts, not counts)
    assert data.columns["c"][0] == "sequence"
    assert data.columns["T"] == ("T_spindle_degC", "T_part_degC")


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("backlash-x", {"dir_x": np.ones((1, 1))}, "dir_x does not change"),
        ("backlash-x", {"dir_x": np.full((9, 1), np.nan)}, "dir_x has gaps"),
        ("warm-up-y", {"time_min": None}, "no column time_min"),
        ("covariate-x", {"load": None, "a b": np.arange(9.0)[:, None] ** 2},
         "no other numeric column that an equation can name"),
        ("trend-y", {"sequence": None, "tool_parts": None}, "no column counts parts"),
        ("step-y", {"sequence": np.array([[1.0], [2], [3]] * 3)}, "too few values of sequence to"),
        ("thermal-drift-x",
         {"T_spindle_degC": None, "T_part_degC": 20 + np.linspace(0, 0.05, 9)[:, None]},
         "T_part_degC does not change by more than 0.05 K"),
    ],
)  # fmt: skip
def test_what_cannot_be_tested(name: str, changes: dict[str, Any], reason: str) -> None:
    covariates = {**shop_covariates(9, 12), **changes}
    own = table(covariates={key: v for key, v in covariates.items() if v is not None})
    found = found_on(own)[name]
    assert found.forms == ()
    assert str(found.unavailable).startswith(reason)


# Readings.


def test_units_of_readings() -> None:
    own = readings_table()
    for name, units in (("trend-x", ("um", "um/min")), ("scale-trend-x", ("um/m", "um/m/min"))):
        found = {form.covariate: (*form.parameters.values(),) for form in forms_of(own, name)}
        assert found == {"sequence": units[:1], "time_min": units[1:]}
    bare = readings_table(name="axy", component="axy", unit="arcsec")
    assert forms_of(bare, "offset-axy")[0].texts() == {"Eaxy": "shift"}
    assert forms_of(bare, "trend-axy")[1].parameters == {"slope": "arcsec/min"}
    assert "scale-axy" not in found_on(bare)


# Choice, users' own families, the package.


OWN = """schema: mtu/effects/1
effects:
- family: chatter
  says: chatter of {a}
  needs:
    - load
  parameters: {gain: um}
  equations:
    E{a}: gain*load*sin(2*pi*x/30)
- family: coolant
  says: bends with the coolant
  parameters: {bow: um/K}
  search: {decay_mm: {of: x, from: 10, to: [2*span, 400], grid: log, count: 5}}
  equations: {Ey: "bow*exp(-abs(x - {x_low})/decay_mm)*(T_coolant_degC - {T_coolant_degC0})"}
- family: pole
  says: has no value at one place
  parameters: {k: um}
  equations: {Ex: k*x/(x - x)}
- family: level
  says: holds a constant
  parameters: {k: um/m, shift: um}
  equations: {Ex: k*x + shift}
"""


def test_what_is_excluded_begins_with_a_family() -> None:
    left = candidates_of(PLANE, effect_library(), ["cyclic", "backlash-x", "backlash-z"])
    assert {"cyclic-x", "backlash-x", "backlash-y"} & {x.name for x in left} == {"backlash-y"}


def test_families_of_the_user(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(OWN, encoding="utf-8")
    assert [source.shown for source in effect_library([file]).sources] == ["own.yaml"]
    coolant = np.linspace(18.0, 22.0, 9)[:, None]
    own = table(covariates=shop_covariates(9, 12) | {"T_coolant_degC": coolant})
    (form,) = forms_of(own, "chatter-y", file)
    assert (form.covariate, form.texts()) == ("load", {"Ey": "gain*load*sin(2*pi*x/30)"})
    members = list(members_of(forms_of(own, "coolant", file)[0]))
    assert [value for value, _ in members] == pytest.approx(np.geomspace(10.0, 260.0, 5))
    x = own.places[..., 0]
    plain = np.exp(-(x - 10.0) / np.geomspace(10.0, 260.0, 5)[2]) * (coolant - 20.0)
    assert members[2][1][0][..., 1] == pytest.approx(plain)
    reason = found_on(own, file)["pole"].unavailable
    assert reason == "its equation has no finite value in some places"
    assert found_on(own, file)["level"].unavailable == CONSTANT


# Grids.

VALUES = np.array([4.0, 1.0, 2.0, 4.0, 10.0])


def grid(values: FloatArray | None, size: int = 1, **given: Any) -> FloatArray:
    given["from"] = given.pop("low", ["low"])
    return grid_of(Search.model_validate(given), values, size)


def test_even_steps_even_ratios_and_half_way_between_values() -> None:
    np.testing.assert_allclose(grid(VALUES, count=4), [1, 4, 7, 10], rtol=1e-15)
    wide = grid(VALUES, grid="log", low=["0.1", "low"], to=["1000"], count=4)
    np.testing.assert_allclose(wide, [1, 10, 100, 1000], rtol=1e-14)
    assert grid(VALUES, grid="between").tolist() == [3.0]
    assert grid(None, low=["2"], to=["4"], count=3).tolist() == [2.0, 3.0, 4.0]


PITCHES: dict[str, Any] = {"grid": "frequency", "low": ["2", "spacing/2"], "to": ["span/2"]}


UNEVEN = [13.0, 17.3, 8.9, 19.1, 11.7]


@pytest.mark.parametrize(
    ("values", "shortest"),
    [
        # Rounding of sums is no step.
        (np.repeat(10.0 * np.arange(1, 14), 2) - np.tile([3e-14, 0.0], 13), 5.0),
        # A few tenths of a millimetre off even: at 1/15 mm all phases are still within a tenth.
        (np.arange(41) * 15.0 + np.tile([0.0, 0.3, -0.2], 14)[:41], 7.5),
        # Every second place 5 mm further on: all are whole multiples of 10 mm.
        (np.arange(41) * 15.0 + np.tile([0.0, 5.0], 21)[:41], 5.0),
        (np.cumsum(UNEVEN * 8), 2.0),
        (np.cumsum(np.tile([*UNEVEN, 15.2, 9.7], 3)), 2.0),
        # Few places have many periods alike, even or not.
        (np.cumsum(UNEVEN * 3), 6.5),
    ],
    ids=["rounding", "nearly", "in-pairs", "uneven", "twenty-one", "few"],
)
def test_many_uneven_places_show_pitches_shorter_than_their_steps(
    values: FloatArray, shortest: float
) -> None:
    assert grid(values, **PITCHES).min() == pytest.approx(shortest, rel=0.02)


def test_frequencies_are_as_many_as_the_places_demand() -> None:
    """A quarter of a period apart over the span, up to 2000; a number asked for is the most."""
    values = np.array([0.0, 7.0, 100.0, 200.0, 300.0, 500.0])
    asked = PITCHES | {"low": ["2"]}
    fine = grid(values, **asked)
    assert (fine[0], fine[-1]) == pytest.approx((250.0, 2.0))
    assert len(fine) == np.ceil((1 / 2 - 1 / 250) * 4 * 500) + 1
    np.testing.assert_allclose(np.diff(1 / fine), (1 / fine[1] - 1 / fine[0]), rtol=1e-9)
    assert len(grid(values, **asked, count=500)) == 500
    assert len(grid(10 * values, **asked)) == 2000
