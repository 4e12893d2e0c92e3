"""Reports of predictions: complete against the contract, true to the results, legible."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_examples import Example, example

from mtu_cli.files.part import Tolerance
from mtu_cli.files.source import report_bytes
from mtu_cli.model.measurands import Conformance, PositionConformance
from mtu_cli.model.settings import Settings
from mtu_cli.reports import lengths, orthogonality, predict_points
from mtu_cli.reports.document import Document
from mtu_cli.reports.tables import plain_text

POINT = [
    "id", "x_mm", "y_mm", "z_mm", "Ex_um", "Ey_um", "u_x_um", "u_y_um", "var_x_um2",
    "var_y_um2", "U_x_um", "U_y_um", "dof_effective_x", "dof_effective_y", "interval95_x_um",
    "interval95_y_um", "independent",
]  # fmt: skip


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """With an equation for z and a component from the machine file."""
    return example(
        tmp_path_factory.mktemp("spatial"),
        passes=3,
        stated="  ez0: {of: y, unit: um, coefficients: [3.0, -0.05], u_future: 1.9}",
        equation="  Ez: ez0 + x*ex_y\n",
    )


def results(document: Document) -> dict[str, Any]:
    """`results` as JSON reads them back: nothing is lost on the way."""
    found = document.record()
    assert json.loads(report_bytes(found)) == found
    return found


def documents(given: Example, settings: Settings | None = None, digits: int = 2) -> list[Document]:
    more = {} if settings is None else {"settings": settings}
    return [
        predict_points.document(given.points(**more), digits),
        lengths.document(given.lengths(**more), digits),
        orthogonality.document(given.angles(**more), digits),
    ]


def test_points_hold_the_contract_fields(paper: Example) -> None:
    result = paper.points()
    found = results(predict_points.document(result))
    assert "covariance_um2" not in found
    assert len(found["points"]) == 24
    for i, point in enumerate(found["points"]):
        assert set(POINT) <= set(point)
        assert point["Ex_um"] == pytest.approx(result.prediction.mean[2 * i] * 1e3, rel=1e-12)
        assert point["var_y_um2"] == pytest.approx(result.variance[2 * i + 1] * 1e6, rel=1e-12)
        assert point["U_x_um"] == pytest.approx(2 * point["u_x_um"], rel=1e-12)
        assert point["u_x_um"] ** 2 == pytest.approx(point["var_x_um2"], rel=1e-12)
        low, high = point["interval95_x_um"]
        assert (low + high) / 2 == pytest.approx(point["Ex_um"], abs=1e-9)
        assert sum(point["shares"]["x"].values()) == pytest.approx(1, rel=1e-9)
        apart = point["independent"]
        assert apart["u_y_um"] == pytest.approx(np.sqrt(apart["var_y_um2"]), rel=1e-12)
        assert point["z_mm"] is None


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("detail", [True, False])
def test_tables_fit_and_round_to_the_uncertainty(
    paper: Example, spatial: Example, planar: bool, detail: bool
) -> None:
    given = paper if planar else spatial
    points = given.points()
    ids = tuple("hole_number_" * 4 + str(i) for i in range(24))
    long = replace(points, prediction=replace(points.prediction, ids=ids))
    made = [*documents(given), predict_points.document(long)]
    texts = [plain_text(each.blocks(detail=detail)) for each in made]
    for text in texts:
        assert max(map(len, text.splitlines())) <= 100
    row = next(x for x in texts[1].splitlines() if x.startswith("3-15"))
    error, u = row.split()[2:4]
    known = given.lengths()
    assert float(u) == pytest.approx(np.sqrt(known.variance[2]) * 1e3, rel=0.05)
    assert float(error) == pytest.approx(known.error[2] * 1e3, abs=0.05)
    assert len(error.partition(".")[2]) == len(u.partition(".")[2])


def test_the_verdict_states_the_least_conformance(paper: Example) -> None:
    points, angles = paper.points(), paper.angles()
    sure, less = (PositionConformance(position_um=50, probability=p, se=0.002) for p in (0.99, 0.9))
    none: list[PositionConformance | None] = [None] * 24
    stated = replace(points, conformance=(*none[3:], sure, less, less))
    last = ", ".join(points.prediction.ids[-2:])
    text = f"The least probability of conformance is 90.0 ± 0.2 %, of {last}."
    assert predict_points.document(stated).verdict.endswith(text)
    assert "conformance" not in predict_points.document(points).verdict
    allowed = Conformance(tolerance=Tolerance(low=-9, high=9), probability=0.9)
    angle = replace(angles.angles[0], conformance=allowed)
    verdict = orthogonality.document(replace(angles, angles=(angle,))).verdict
    assert verdict.endswith(f"is 90.0 %, of {angle.id}.")
