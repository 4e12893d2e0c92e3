"""`mtu graph`: check, draw, simulate and sweep as a user calls them."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, listing, mtu, report
from support import CONFIGS

from mtu_cli.cli.measurement import variation
from mtu_cli.findings import InputError

GRAPHS = CONFIGS / "graphs"
BALL = GRAPHS / "ball-centre.yaml"
AXES = GRAPHS / "axes-a-and-c.yaml"
FIELDS = {"unit", "nominal", "mean", "u", "interval95", "first_order_u"}


def test_check_and_simulate() -> None:
    results = report("graph", "check", BALL)["results"]
    first, second = results["firing_order"]
    assert {step["do"] for step in first} == {"meas"}
    assert second == [{"do": "ball", "in": ["x1", "x2", "y1", "y2", "z1", "r1"], "out": ["P1"]}]
    assert results["places"] == {"coordinate": 5, "constant": 1, "point": 1}
    document = report("graph", "simulate", AXES)
    assert document["schema"] == "mtu/graph-simulate/1"
    results = document["results"]
    assert results["converged"] is True
    assert set(results["places"]["d_AC"]["value"]) >= FIELDS
    assert set(results["budget"]["d_AC"]["value"]) == {
        "u1_axis", "u2_probe", "u3_perpendicular"
    }  # fmt: skip
    assert document["warnings"] == []


def test_sweep() -> None:
    vary = ("--vary", "axis_um=0.5:2.5:3", "--vary", "probe_um=1,2")
    document = report("graph", "sweep", AXES, *vary, "--of", "d_AC", "--trials", "1000")
    long = report("graph", "sweep", BALL, "--vary", "axis_um=1,2", "--of", "P1.x")
    assert long["results"]["converged"] is True
    assert document["schema"] == "mtu/graph-sweep/1"
    results = document["results"]
    assert [(item["axis_um"], item["probe_um"]) for item in results["grid"]] == [
        (0.5, 1), (0.5, 2), (1.5, 1), (1.5, 2), (2.5, 1), (2.5, 2),
    ]  # fmt: skip
    formula = results["formula"]
    assert formula["form"] == "u_um = sqrt(a*probe_um^2 + b*axis_um^2)"
    assert set(formula["coefficients"]) == {"a", "b"}
    assert formula["max_error_percent"] < 15
    assert formula["monte_carlo"]["standard_error_percent"] == pytest.approx(2.2, abs=0.2)
    assert set(results["places"]["d_AC"]["value"]) >= FIELDS
    with pytest.raises(InputError, match="appears twice"):
        variation("axis_um", "1,1")


@pytest.mark.parametrize(
    ("kind", "start"), [("svg", b"<?xml"), ("dot", b"digraph"), ("mmd", b"---"), ("pl", b"%")]
)
def test_draw(kind: str, start: bytes, tmp_path: Path) -> None:
    plain, shares = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    done(mtu("graph", "draw", BALL, "--to", plain))
    done(mtu("graph", "draw", BALL, "--to", shares, "--of", "P1.z"))
    assert plain.read_bytes().startswith(start)
    assert (plain.read_bytes() == shares.read_bytes()) == (kind == "pl")


def test_the_same_bytes_with_other_threads(tmp_path: Path) -> None:
    found = []
    for threads in (1, 3):
        folder = tmp_path / str(threads)
        folder.mkdir()
        graph = GRAPHS / "work-coordinates.yaml"
        files = ("-o", "a.json", "--csv", "a.csv", "--plot", "a.svg")
        done(mtu("graph", "simulate", graph, "--threads", threads, *files, cwd=folder))
        found.append(listing(folder))
    assert found[0] == found[1]
