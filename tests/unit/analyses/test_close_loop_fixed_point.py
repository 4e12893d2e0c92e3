"""An axis that grows from a fixed point: where it is by hand and by trials, and when it is told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from close_loop_examples import effect, on_component, on_table, result
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint
from mtu_cli.close_loop_sealed.analyses.loop.fixed_point import fixed_points
from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect

GROWTH, DRIFT = 8.66, 1.84
"""um/m/K and um/K: 8.66e-3 um/mm/K are 1.84 um/K at 212.5 mm."""
DOF = 17.0
T = "T_spindle_degC"


def grows(at: float = 75.0, **changed: object) -> FoundEffect:
    own = {
        "parameters": (("growth", "um/m/K", GROWTH, 0.4), ("level", "um", 5.8, 0.5)),
        "equations": {"Ex": f"growth*(x - {at})*({T} - 20) + level"},
        "covariate": T,
    }
    return effect("thermal-growth-x", **(own | changed))  # type: ignore[arg-type]  # by name


def drifts(**changed: object) -> FoundEffect:
    own = {
        "parameters": (("drift", "um/K", DRIFT, 0.17),),
        "equations": {"Ex": f"drift*({T} - 24.54)"},
        "covariate": T,
    }
    return effect("thermal-drift-x", **(own | changed))  # type: ignore[arg-type]  # by name


def found(
    *effects: FoundEffect,
    correlation: float = 0.0,
    travel: tuple[float, float] = (0.0, 400.0),
) -> CloseLoopResult:
    """The first parameters of the first and of the last effect are correlated."""
    item = on_table("named", effects)
    item = replace(item, table=replace(item.table, travel={"x": travel}))
    u = np.array([p[3] for e in effects for p in e.parameters])
    last = len(u) - len(effects[-1].parameters)
    r = np.eye(len(u))
    if last:
        r[0, last] = r[last, 0] = correlation
    return replace(result(item), covariance=np.outer(u, u) * r)


def told(whole: CloseLoopResult) -> tuple[FixedPoint, ...]:
    (item,) = whole.tables
    return fixed_points(item.table, item.effects, whole.covariance)


@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.6])
def test_growth_and_drift_cancel_at_the_fixed_point(correlation: float) -> None:
    """By hand: x = 75 - d/g, with u by the derivatives 1/g and d/g^2."""
    (point,) = told(found(grows(), drifts(), correlation=correlation))
    g, d, ug, ud = GROWTH * 1e-3, DRIFT, 0.4e-3, 0.17
    assert (point.axis, point.covariate, point.growth, point.drift) == ("x", T, (0,), (1,))
    assert point.at == pytest.approx(75 - d / g)
    square = (ud / g) ** 2 + (d * ug / g**2) ** 2 - 2 * correlation * ud * ug * d / g**3
    assert point.u == pytest.approx(np.sqrt(square))
    assert point.told


def test_its_interval_is_that_of_trials() -> None:
    """Fieller: the x whose growth and drift differ from cancelling by no more than t u."""
    (point,) = told(found(grows(), drifts(), correlation=0.4))
    ug, ud = 0.4e-3, 0.17
    k = student.ppf(0.975, DOF)
    assert point.interval is not None
    for end in point.interval:
        lever = end - 75.0
        left = DRIFT + GROWTH * 1e-3 * lever
        u = np.sqrt(ud**2 + (lever * ug) ** 2 + 2 * 0.4 * lever * ug * ud)
        assert abs(left) == pytest.approx(k * u)
    rng, n = np.random.default_rng(3), 20_000
    chol = np.linalg.cholesky([[ug**2, 0.4 * ug * ud], [0.4 * ug * ud, ud**2]])
    trials = rng.normal(size=(n, 2)) @ chol.T + [GROWTH * 1e-3, DRIFT]
    middle = np.quantile(75.0 - trials[:, 1] / trials[:, 0], [0.1587, 0.8413])
    # A ratio whose divisor has a u of 5 % bends by 0.05^2; quantiles of n trials are known to
    # sqrt(p (1 - p) / n) / density, 1.1 % of u here, of which 3.
    assert 0.5 * (middle[1] - middle[0]) == pytest.approx(point.u, rel=0.036)


def test_it_does_not_depend_on_the_place_and_temperature_that_equations_begin_at() -> None:
    """About another place the drift is another one, with another covariance: the same cause."""
    first, by = found(grows(75.0), drifts(), correlation=0.3), 40.0
    other = found(
        grows(75.0 + by, equations={"Ex": f"growth*(x - {75.0 + by})*({T} - 24) + level"}),
        drifts(
            parameters=(("drift", "um/K", DRIFT + GROWTH * 1e-3 * by, 0.17),),
            equations={"Ex": f"drift*{T}"},
        ),
    )
    turn = np.eye(3)
    turn[2, 0] = by
    other = replace(other, covariance=turn @ first.covariance @ turn.T)
    (a,), (b,) = told(first), told(other)
    assert b.at == pytest.approx(a.at)
    assert b.u == pytest.approx(a.u)
    assert b.interval == pytest.approx(a.interval)


SCALE = effect(
    "scale-x", parameters=(("scale", "um/m", -40.0, 3.0),), equations={"Ex": "scale*(x - 75)"}
)
OFFSET = effect("offset-x", parameters=(("shift", "um", 2.0, 0.3),), equations={"Ex": "shift"})
CURVATURE = effect(
    "curvature-x",
    parameters=(("bend", "um/m^2", 300.0, 40.0), ("level", "um", -1.0, 0.3)),
    equations={"Ex": "bend*(x - 75)**2 + level"},
)


def test_a_scale_and_an_offset_cancel_too() -> None:
    (point,) = told(found(OFFSET, SCALE))
    assert (point.covariate, point.growth, point.drift) == (None, (1,), (0,))
    assert point.at == pytest.approx(75 + 2.0 / 0.04)
    assert point.u == pytest.approx(50 * np.hypot(0.3 / 2.0, 3.0 / 40.0))


def test_what_all_axes_share_counts_for_each() -> None:
    """The growth of an axis is the sum of its own and of what all axes have."""
    whole = effect(
        "thermal-growth", family="thermal-growth", axis=None,
        parameters=(("growth", "um/m/K", 11.0, 1.4),), covariate=T,
        equations={"Ex": f"growth*(x - 75)*({T} - 20)", "Ey": f"growth*(y - 60)*({T} - 20)"},
    )  # fmt: skip
    (point,) = told(found(grows(), whole, drifts()))
    assert (point.axis, point.growth, point.drift) == ("x", (0, 1), (2,))
    assert point.at == pytest.approx(75 - DRIFT / ((GROWTH + 11.0) * 1e-3))
    (alone,) = told(found(whole, drifts()))
    assert (alone.axis, alone.growth, alone.drift) == ("x", (0,), (1,))


OTHER: dict[str, Any] = {
    "equations": {"Ex": "drift*(T_part_degC - 20)"},
    "covariate": "T_part_degC",
}
BENT: dict[str, Any] = {
    "parameters": (("growth", "um/m/K", GROWTH, 0.4),),
    "equations": {"Ex": f"growth*(x - 75)**2*({T} - 20)"},
}
WARPED = effect("own-x", equations={"Ex": "lost_motion*(x - 75)*y"})
HEATED: dict[str, Any] = {
    "parameters": (("growth", "um/m/K", GROWTH, 0.4),),
    "equations": {"Ex": f"growth*(x - 75)*({T} - 20)**2"},
}


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (grows(),),
        (drifts(),),
        (grows(), drifts(**OTHER)),
        (grows(), effect("thermal-drift-y", equations={"Ey": f"lost_motion*{T}"})),
        (grows(class_names=("thermal-growth-x", "scale-x")), drifts(aliases=("covariate-x",))),
        (grows(**BENT), drifts()),
        (grows(**HEATED), drifts()),
        (SCALE, CURVATURE),
        (SCALE, OFFSET, CURVATURE),
        (SCALE, OFFSET, effect("own-x", equations={"Ex": "lost_motion*log(x - 200)"})),
        (grows(), drifts(), effect("own-x", equations={"Ex": f"lost_motion*x*log({T})"})),
        (OFFSET, effect("cyclic-x", equations={"Ex": "lost_motion*cos(pi*(x - 10)/130)"})),
        (grows(), drifts(equations={"Ex": f"drift*({T} + sin(2*pi*{T}))"})),
        (drifts(), effect("odd-x", equations={}, chosen="H7")),
        (effect("squareness-xy", equations={"Ex": "lost_motion*(y - 60)"}), WARPED),
    ],
    ids=[
        *("none", "growth", "drift", "other-sensor", "other-axis"),
        *("two-classes", "bent", "squared", "level", "curved"),
        *("no-value", "no-value-of-covariate", "wave", "wave-of-covariate"),
        *("no-equation", "along-another-axis"),
    ],
)
def test_what_is_no_growth_from_a_fixed_point(effects: tuple[FoundEffect, ...]) -> None:
    whole = found(*effects) if effects else result(on_table("none"))
    assert told(whole) == ()


@pytest.mark.parametrize(
    "changed", [{"class_names": ("thermal-drift-x", "warm-up-x")}, {"aliases": ("covariate-x",)}]
)
def test_one_of_several_effects_gives_a_point_if_it_is_that(changed: dict[str, Any]) -> None:
    (sure,) = told(found(grows(), drifts(), correlation=0.4))
    whole = found(grows(), drifts(**changed), correlation=0.4)
    (point,) = told(whole)
    assert point == replace(sure, given=(1, "thermal-drift-x"))
    # In the place of another effect: what it has no part in was told before.
    (item,) = whole.tables
    others = [fixed_points(item.table, item.effects, whole.covariance, instead=e) for e in range(2)]
    assert others == [(), (point,)]


def test_a_component_by_itself_has_none() -> None:
    item = on_component(effects=(grows(component="dx_x"), drifts(component="dx_x")))
    assert told(replace(result(item), covariance=np.eye(3))) == ()


def test_what_is_uncertain_beyond_the_machine_is_not_told() -> None:
    u = told(found(grows(), drifts()))[0].u
    assert not told(found(grows(), drifts(), travel=(0.0, 4.0 * u)))[0].told
    # A growth that is not told from none has no bounded interval.
    weak = grows(parameters=(("growth", "um/m/K", GROWTH, GROWTH), ("level", "um", 5.8, 0.5)))
    (point,) = told(found(weak, drifts(), travel=(-1e9, 1e9)))
    assert (point.interval, point.told) == (None, False)
    # Without a travel, what the parts reach over, along any axis, or another axis travels.
    near = told(found(grows(), drifts()))[0]
    far = found(grows(), drifts())
    item = replace(far.tables[0], table=replace(far.tables[0].table, travel={}))
    (point,) = told(replace(far, tables=(item,)))
    reach = float(np.ptp(item.table.places[..., 0]))
    assert near.interval is not None
    long = near.interval[1] - near.interval[0]
    assert point.told is (long <= reach)
    places = far.tables[0].table.places.copy()
    for y_mm, travel, seen in ((0.9, {}, False), (1.1, {}, True), (0.9, {"z": (0, 1.1)}, True)):
        places[..., 1] = np.linspace(0.0, y_mm * long, places.shape[1])
        places[..., 0] = 75.0 + 0.1 * (far.tables[0].table.places[..., 0] - 75.0)
        own = {axis: (low * long, high * long) for axis, (low, high) in travel.items()}
        item = replace(item, table=replace(item.table, places=places, travel=own))
        assert told(replace(far, tables=(item,)))[0].told is seen
    # Nor is any other axis known: it is what the parts reach over along this one.
    places[..., 1:] = np.nan
    item = replace(item, table=replace(item.table, places=places, travel={}))
    assert told(replace(far, tables=(item,)))[0].told is False


@pytest.mark.parametrize(("reference", "count"), [("24.54", 1), ("24", 0), ("20", 0)])
def test_what_is_constant_beside_a_drift_has_a_fixed_point_at_one_temperature(
    reference: str, count: int
) -> None:
    """A scale at 20 degC and an offset at 24.54 are no line of either."""
    growth = grows(
        parameters=(("growth", "um/m/K", GROWTH, 0.4),),
        equations={"Ex": f"growth*(x - 75)*({T} - {reference})"},
    )
    scale = effect(
        "scale-x", parameters=(("scale", "um/m", -18.0, 1.0),), equations={"Ex": "scale*(x - 75)"}
    )
    offset = effect("offset-x", parameters=(("shift", "um", 5.0, 0.3),), equations={"Ex": "shift"})
    points = told(found(growth, drifts(), scale, offset))
    assert sum(point.covariate is None for point in points) == count
    assert sum(point.covariate == T for point in points) == 1
