"""The report of thermal-fit: a thermal model a component, and the evidence for it.

`coefficients` and what belongs to them are in the component's `unit`, mm and degC; all other
figures are in um for lengths and arcsec for angles, as their names say. `positions_mm` is empty
and `position_mm` null where the drift does not depend on position. Null degrees of freedom are
infinite, a null variance inflation factor too. Shares of sensors that move alike may cancel, so
they need not add up to the drift.
"""

from __future__ import annotations

import math

from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.findings import listed
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group
from mtu_cli.reports.numbers import fixed, significant

LEADING = 3
"""Sensors named in the table of models."""
ESTIMATE = (
    ("reference_temperature_degC", "reference", "at which the drift is zero", None),
    ("time_constants_min", "time_constants", "lag of each sensor; 0: none", None),
    ("coefficients", "coefficients", "by powers of mm and by sensor, per degC", "size"),
    ("covariance", "covariance", "of the coefficients, powers first", "size2"),
    ("coefficient_dof", "coefficient_dof", "its degrees of freedom", None),
    ("leftover_covariance", "leftover", "of the drift that the model leaves", "size2"),
    ("leftover_dof", "leftover_dof", "its degrees of freedom", None),
    ("sensor_u_degC", "sensor_u", "standard uncertainty of each sensor", None),
    ("temperature_range_degC", "temperature_range", "of each sensor in the readings", None),
    ("position_range_mm", "position_range", "of the readings", None),
)
"""What a prediction needs: name, attribute, meaning and size."""


def _three(value: float, u: None, digits: int) -> str:
    return significant(value, 3)


def _leading(item: ComponentDrift) -> str:
    """A sensor T_spindle_degC is spindle."""
    shares = item.by_share
    names = [x.sensor.removeprefix("T_").removesuffix("_degC") for x in shares[:LEADING]]
    return ", ".join([*names, *(["..."] if len(shares) > LEADING else [])])


FITTED: Fields = (
    Field("of", "estimate.of", "its axis; null: a constant"),
    Field("unit", "unit.name", "of its coefficients"),
    Field("model", meaning="stepwise, ridge or lagged"),
    Field("degree", "estimate.degree", "of the polynomial in position"),
    Field("positions_mm", "positions", "of the readings"),
    Field("sensors", "estimate.sensors", "of the model"),
    Field("groups", meaning="sensors that move alike, |r| >= 0.999"),
    *(
        Field(name, f"estimate.{value}", meaning, size=size)
        for name, value, meaning, size in ESTIMATE
    ),
    Field("n", meaning="number of readings"),
    Field("cycles", meaning="names of the cycles"),
    Field("r2_fit", meaning="share of the variance that the model explains"),
)
TESTS: Fields = (
    Group(
        "position_test",
        (
            Field("F", meaning="variance ratio of the dependence on position"),
            Field("p", meaning="p that there is none"),
        ),
    ),
    Field("collinearity.condition_number", "condition", "of the standardised sensors"),
    Field("collinearity.vif", "vif", "variance inflation factor by sensor; null: infinite"),
    Field("residuals.normality_p", meaning="p that they are normal (D'Agostino & Pearson)"),
    Field("residuals.lag1_autocorrelation", "residuals.lag1", "from reading to reading"),
    Field("residuals.n_effective", "residuals.effective", "independent readings"),
)
ZEROED: Fields = (
    Field("zeroed.offsets", meaning="whether every cycle has an offset of its own"),
    Field("zeroed.by", meaning="setting, first readings (all 0) or test of the offsets"),
    Field("zeroed.F", meaning="variance ratio of the offsets"),
    Field("zeroed.p", meaning="p that there are none"),
)
CYCLE = Field("cycle", meaning="of a zeroed probe; null: of all cycles")
POSITION = Field("position_mm", "position", "observed position; null: the same at all")


def held_out(unit: str) -> Fields:
    """Validation by cycles outside the fit."""
    before = Field(f"rms_before_{unit}", "before", "rms of the drift")
    after = Field(f"rms_after_{unit}", "after", "rms of the residuals")
    return (
        Field("by", lambda held: "cycle", "what was held out"),
        Field("blocks", meaning="in how many blocks"),
        before,
        after,
        Field(f"ordinary_{unit}", "ordinary", "the same of ordinary least squares on all sensors"),
        Field("r2", meaning="share of the variance that the model predicts"),
        Group("cycles", (Field("cycle", meaning="its name"), before, after), many=True),
    )


def component(item: ComponentDrift | None) -> Fields:
    """The figures of a component; the unit in their names is um or arcsec."""
    unit = "um" if item is None else item.rms_unit
    candidate = (
        Field("model", meaning="kind of model"),
        Field("degree", meaning="of its polynomial in position"),
        Field(f"rms_held_out_{unit}", "held_out", "rms of its held-out residuals"),
    )
    share = (
        Field("sensor", meaning="name of the sensor"),
        Field(f"rms_{unit}", "rms", "rms of its part of the modelled drift"),
    )
    gradients = f"gradients_{unit}_per_degC"
    intercept = Field(f"intercept_{unit}", "value", "drift at the reference temperature")
    group = (
        Field("sensors", meaning="that have a gradient together only"),
        Field(
            f"gradient_{unit}_per_degC",
            "value",
            "drift per degC of the first, the others moving with it as they did",
            unit=unit,
        ),
        Field(f"u_{unit}_per_degC", "u", "its standard uncertainty", unit=unit),
        Field(f"interval95_{unit}_per_degC", "interval", "that holds it at 95 %", unit=unit),
    )
    return (
        *FITTED,
        *ZEROED,
        Field(f"rms_before_{unit}", "rms_before", "rms of the drift"),
        Field(f"rms_after_{unit}", "rms_after", "rms of the residuals"),
        Group("held_out", held_out(unit)),
        Group("candidates", candidate, many=True),
        *TESTS,
        Group("shares", share, "by_share", many=True),
        Group(
            "at_positions",
            (
                POSITION,
                Field(gradients, "gradients", "of the model, by sensor", unit=unit),
                Field(f"u_{gradients}", "u", "standard uncertainties", unit=unit),
                Field(f"interval95_{gradients}", "intervals", "95 % intervals", unit=unit),
                Group("inseparable", group, many=True),
            ),
            many=True,
        ),
        Group("intercepts", (POSITION, CYCLE, intercept), many=True),
    )


RESULTS: Fields = (
    Field("method", meaning="model that was asked for"),
    Field("sensors", meaning="sensors of the readings"),
    Field("columns_not_used", "not_used", "columns that are no sensors"),
    Field("reference_temperature_degC", "reference", "of the machine"),
    Group("components", component, many=True),
)
ROW: Fields = (
    Field("", "drift.name", "name of the component", csv="component", head="component",
          show="text"),
    Field("", "drift.estimate.of", "its axis", csv="of"),
    Field("", "drift.unit.name", "of the figures", csv="unit", head="unit", show="text"),
    Field("", "drift.model", "stepwise, ridge or lagged", csv="model"),
    Field("", "drift.estimate.degree", "of the polynomial in position", csv="degree"),
    Field("", "position", "observed position", csv="position_mm", head="position", show="exact",
          unit="mm"),
    Field("", "sensor", "of the model; empty: it has none", csv="sensor", head="sensor",
          show="text"),
    Field("", "stands_for", "sensors that move as it does", csv="stands_for"),
    Field("", "value", "drift per degC", csv="gradient_per_degC", size="drift.size"),
    Field("", lambda x: x.value if x.value or x.u else None, head="gradient\nper degC",
          show="plus-minus", u="u", size="drift.size"),
    Field("", "u", "its standard uncertainty", csv="u_gradient_per_degC", size="drift.size"),
    Field("", "interval", "its 95 % interval", csv="interval95_gradient",
          head="95 % interval\nper degC", show="interval", u="u", size="drift.size"),
    Field("", lambda x: None if x.separable is None else x.separable,
          "false: its gradient is known together with other sensors' only", csv="separable"),
    Field("", lambda x: None if x.separable is None or x.separable else "no", head="sepa-\nrable",
          show="text"),
    Field("", "by", "u from the scatter of cycles, or the model of the errors", csv="u_by",
          head="u by", show="text"),
    Field("", "share", "rms of its part of the modelled drift", csv="share_rms", head="rms\npart",
          show=_three, size="drift.size"),
    Field("", "lag", "time constant; 0: none", csv="time_constant_min", head="lag", unit="min"),
    Field("", "vif", "variance inflation factor; empty: infinite", csv="vif", head="VIF",
          show=_three),
    Field("", "temperatures.0", "lowest temperature read", csv="temperature_low_degC"),
    Field("", "temperatures.1", "highest temperature read", csv="temperature_high_degC"),
)  # fmt: skip
SIZE = "rms_size"
MODEL: Fields = (
    Field("", "name", head="component", show="text"),
    Field("", "rms_unit", head="unit", show="text"),
    Field("", "model", head="model", show="text"),
    Field("", "estimate.degree", head="degree", show="count"),
    Field("", lambda x: len(x.estimate.sensors), head="sensors", show="count"),
    Field("", _leading, head="largest parts", show="text"),
    Field("", "rms_before", head="fitted rms\nwithout", show=_three, size=SIZE),
    Field("", "rms_after", head="\nwith", show=_three, size=SIZE),
    Field("", "held_out.before", head="held-out\nwithout", show=_three, size=SIZE),
    Field("", "held_out.after", head="\nwith", show=_three, size=SIZE),
    Field("", "held_out.reduction", head="reduction\n%", show=lambda x, u, d: fixed(100 * x, 1)),
    Field("", "held_out.ordinary", head="all sensors\nheld out", show=_three, size=SIZE,
          detail=True),
    Field("", "held_out.blocks", head="blocks\nheld out", show="count", detail=True),
    Field("", "position_test.F", head="position\nF", show=_three, detail=True),
    Field("", "position_test.p", head="position\np", show="p", detail=True),
    Field("", "condition", head="condition\nnumber", show=_three, detail=True),
    Field("", "residuals.lag1", head="autocorr.", detail=True),
    Field("", "residuals.normality_p", head="normal\np", show="p", detail=True),
)  # fmt: skip
TRIED: Fields = (
    Field("", "0.name", head="component", show="text"),
    Field("", "0.rms_unit", head="unit", show="text"),
    Field("", "1.model", head="model", show="text"),
    Field("", "1.degree", head="degree", show="count"),
    Field("", "1.held_out", head="held-out rms", show=_three, size="0.rms_size",
          mark=lambda pair: "*" if pair[0].chosen(pair[1]) else ""),
)  # fmt: skip


def document(fit: ThermalFit, digits: int = 2) -> Document:
    """One row a component; in the CSV one a component, observed position and sensor."""
    from mtu_cli.reports import machine_figures

    items = list(fit.components.values())
    gradients = [each for item in items for each in item.gradients]
    models = Table(
        title="Thermal models",
        fields=ROW,
        items=gradients,
        shown=items,
        shown_fields=MODEL,
        footer=f"rms of the drift without and with temperatures above {fit.reference:g} degC; "
        "held out: cycles not in the fit"
        + (
            "; zeroed in every cycle: from its mean" if any(x.zeroed.offsets for x in items) else ""
        ),
        notes=[
            "all sensors: ordinary least squares; position: test of the drift being the same at "
            "all positions; residuals: autocorrelation from reading to reading",
        ],
    )
    tried = Table(
        title="Models tried",
        fields=TRIED,
        items=[(item, each) for item in items for each in item.candidates],
        footer="* chosen by the scores within the other cycles; -: not tried in every fold",
        detail=True,
    )
    sensors = Table(
        title="Gradients of the sensors",
        fields=ROW,
        items=[each for each in gradients if each.sensor is not None],
        footer="± standard uncertainty; rms part: of the modelled drift; VIF: variance inflation; "
        "not separable: known together only (warnings)",
        notes=[f"{listed(group)} move alike and share their drift" for group in _alike(items)],
        detail=True,
    )
    return Document(
        title="Thermal models",
        results=(RESULTS, fit),
        tables=[models, tried, sensors],
        figure=lambda: machine_figures.drift(fit),
        verdict=_verdict(items),
        digits=digits,
    )


def _alike(items: list[ComponentDrift]) -> dict[tuple[str, ...], None]:
    return dict.fromkeys(group for item in items for group in item.groups if len(group) > 1)


def _verdict(items: list[ComponentDrift]) -> str:
    held = {
        item.name: item.held_out.reduction
        for item in items
        if item.held_out is not None and math.isfinite(item.held_out.reduction)
    }
    if not held:
        return "No cycle is held out: the fit alone does not validate the models."
    least = min(held, key=held.__getitem__)
    others = [item.name for item in items if item.name not in held]
    more = f"; not validated: {listed(others)}" if others else ""
    reduction = fixed(100 * held[least], 1)
    return (
        f"On held-out cycles the thermal models reduce the rms drift by {reduction} %"
        f"{' or more' if len(held) > 1 else ''} (least: {least}){more}."
    )
