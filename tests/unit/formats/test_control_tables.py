"""Tables of controls: golden values, reading back, refusals, the sign by a simulated control."""

from __future__ import annotations

import re
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
import pytest
from control_simulations import CONTROLS
from fuzz.damage import nudged

from mtu_cli.analyses.compensate import (
    CompensateResult,
    Frame,
    Verified,
    Wanted,
    axis_errors,
    compensate,
    figures,
    moves_program,
    verify,
)
from mtu_cli.findings import InputError
from mtu_cli.formats.control import CONTROLLERS
from mtu_cli.formats.control.errors import Controller, ErrorTable
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.reports.compensate import RESULTS
from mtu_cli.reports.fields import record
from mtu_cli.units import ARCSEC

AT = np.array([0.0, 50.0, 100.0])
FORWARD, REVERSE = np.array([2.0, 5.0, -3.0]) * 1e-3, np.array([-1.0, 1.0, -8.0]) * 1e-3


def made(name: str) -> tuple[Controller, dict[str, str]]:
    """A control with its parameters; `heidenhain-old` is the old variant."""
    control = CONTROLLERS[name.removesuffix("-old")]
    own = {"type": "0", "counts_per_mm": "1000"}
    own |= {"variant": "old"} if name.endswith("-old") else {}
    return control, {
        **control.parameters,
        **{k: v for k, v in own.items() if k in control.parameters},
    }


def golden(name: str, **parameters: str) -> list[str]:
    """Lines of the file of the golden example (formats.md, constructed)."""
    control, own = made(name)
    own |= parameters
    two = ErrorTable.of(AT, FORWARD, REVERSE)
    table = two if control.two(own) else ErrorTable.of(AT, (FORWARD + REVERSE) / 2)
    return control.text(control.zero(table, 0.0), own).splitlines()


def test_golden_linuxcnc() -> None:
    assert golden("linuxcnc") == ["0 0.002 -0.001", "50 50.005 50.001", "100 99.997 99.992"]
    assert golden("linuxcnc", type="1") == ["0 -0.002 0.001", "50 -0.005 -0.001", "100 0.003 0.008"]


def test_golden_siemens() -> None:
    enc = golden("siemens-enc")
    assert [x.split("=")[1] for x in enc if "COMP[" in x] == ["0.0", "0.0025", "-0.006"]
    cec = golden("siemens-cec")
    assert [x.split("=")[1] for x in cec if "CEC[0," in x] == ["0.0", "0.003", "-0.005"]
    assert [x.split("=")[1] for x in cec if "CEC[1," in x] == ["-0.003", "-0.001", "-0.01"]


def test_golden_beckhoff() -> None:
    values = {x.split()[0]: x.split()[1] for x in golden("beckhoff")}
    rows = [
        [values[f"kw.ssfk.table[{k}].{x}"] for k in range(3)] for x in ("setpoint", "pos", "neg")
    ]
    assert rows == [["0", "500000", "1000000"], ["20", "50", "-30"], ["-10", "10", "-80"]]


def test_golden_corrections() -> None:
    expected = ["-0.0005", "-0.003", "0.0055"]
    assert golden("aerotech")[4:7] == expected
    assert [x.split(" = ")[1] for x in golden("acs") if " = " in x] == expected
    # Zeroed: -0.0025 and +0.006 mm are -40 and 96 sixteenths of a count of 1 um; it ends at home.
    assert golden("pmac")[-4:-1] == ["-40", "96", "0"]


def test_golden_mitsubishi() -> None:
    assert [x.split(",")[3] for x in golden("mitsubishi")[-2:]] == ["-6", "16"]
    # Seen from the - side: the move back from 100 to 50 measured 49.991.
    assert [x.split(",")[4] for x in golden("mitsubishi")[-2:]] == ["-4", "18"]


@pytest.mark.parametrize("name", CONTROLS)
def test_what_is_written_is_read_back_within_half_a_quantum(name: str) -> None:
    control, own = made(name)
    rng = np.random.default_rng(7)
    for _ in range(20):
        n = int(rng.integers(2, 40))
        step = 6.5536 if name == "heidenhain-old" else float(rng.integers(1, 800)) / 8
        at = step * (np.arange(n) - int(rng.integers(0, n)))
        at = np.round(at, 4)
        table = ErrorTable.of(at, *rng.normal(0, 0.01, (2, n))[: 1 + control.two(own)])
        table = control.zero(table, 0.0)
        held = control.read_back(control.text(table, own, "a note"), own)
        assert np.abs(held.at - at).max() <= 1e-4
        quantum = control.resolution(table, own)
        assert np.abs(held.errors - table.errors).max() <= quantum * (0.5 + 1e-6)


def reading(rng: Any, targets: Any, errors: Any, runs: int = 5, s: float = 5e-4) -> tuple[Any, ...]:
    """Readings of both directions with a level of each run."""
    rows = [
        (x, way, e + drift + rng.normal(0, s), run)
        for run, drift in enumerate(rng.normal(0, s, runs))
        for way, errs in zip((1, -1), errors, strict=True)
        for x, e in zip(targets, errs, strict=True)
    ]
    x, way, value, run = map(np.array, zip(*rows, strict=True))
    return x, way, value, run


TARGETS = np.round(6.5536 * np.arange(15), 4)
TRUE = 0.02 * np.sin(TARGETS / 20) + 1e-4 * TARGETS + np.array([[0.001], [-0.001]])


def with_table(
    name: str, change: Any = lambda text: text
) -> tuple[CompensateResult, tuple[Any, ...]]:
    """The result for a simulated axis, and readings with the table in its simulated control."""
    rng = np.random.default_rng(11)
    control, own = made(name)
    errors = axis_errors(*reading(rng, TARGETS, TRUE))
    result = compensate(errors, control, own, Wanted(), seed=1, trials=500)
    command = CONTROLS[name](change(result.text))
    sent = np.array([[command(float(x), way) for x in TARGETS] for way in (1, -1)])
    left = np.stack([np.interp(sent[i], TARGETS, TRUE[i]) + sent[i] - TARGETS for i in (0, 1)])
    return result, reading(rng, TARGETS, left)


def verified(result: CompensateResult, after: tuple[Any, ...]) -> Verified:
    found = verify(result, *after).verified
    assert found is not None
    return found


def verdict(result: CompensateResult, after: tuple[Any, ...]) -> str:
    return verified(result, after).verdict


@pytest.mark.parametrize("name", CONTROLS)
def test_a_simulated_control_moves_by_the_table_in_the_right_sense(name: str) -> None:
    result, after = with_table(name)
    assert verdict(result, after) == "worked"
    assert result.before is not None
    measured = axis_errors(*after)
    own = measured.means - measured.means.mean(1, keepdims=True)
    assert np.abs(own).max() < 0.1 * float(result.before["E"])


@pytest.mark.parametrize("name", CONTROLS)
def test_a_turned_sign_and_a_table_without_effect_are_seen(name: str) -> None:
    """The sign is turned in the writer: the control reads what a wrong writer would have made."""
    control, own = made(name)
    result, _ = with_table(name)
    turned = replace(result.held, errors=-result.held.errors)
    wrong = control.text(turned, own)
    assert verdict(*with_table(name, lambda _: wrong)) == "wrong-sign"
    without = control.text(replace(turned, errors=0 * turned.errors), own)
    assert verdict(*with_table(name, lambda _: without)) == "no-effect"


def refused(name: str, text: str, **parameters: str) -> str:
    control, own = made(name)
    with pytest.raises(InputError) as fault:
        control.read_back(text, own | parameters)
    return str(fault.value)


def test_a_linuxcnc_table_with_a_comment_is_refused_with_the_reason() -> None:
    text = "# nominal forward reverse\n0 0 0\n50 50 50\n"
    assert "LinuxCNC stops reading here" in refused("linuxcnc", text)
    assert "1 rows above" in refused("linuxcnc", "0 0 0\n\n50 50 50\n")
    assert "type" in refused("linuxcnc", "0 0 0\n50 50 50\n", type="")


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.filterwarnings("error")
def test_damaged_tables_are_refused_in_words_or_read(name: str) -> None:
    control, own = made(name)
    text = with_table(name)[0].text.replace("\r", "")
    rng, refusals = Random(5), 0
    for _ in range(150):
        damaged = nudged(text.encode(), rng).decode("latin-1")
        try:
            held = control.read_back(damaged, own)
        except InputError:
            refusals += 1
        else:
            assert (np.diff(held.at) > 0).all()
            assert np.isfinite(held.errors).all()
    assert refusals > 20


def test_faults_of_a_public_exporter() -> None:
    lines = golden("siemens-enc")
    text = "\n".join(lines)
    assert "IS_MODULO is -1" in refused(
        "siemens-enc", text.replace("MODULO[0,X1]=0", "MODULO[0,X1]=-1")
    )
    assert "CHANDATA" in refused("siemens-enc", text.replace("CHANDATA(1)\n", ""))
    assert "MAX is 200" in refused("siemens-enc", text.replace("=100.0", "=200.0"))


def test_skew_of_klipper() -> None:
    angle = read_skew("SET_SKEW XY=140.4,142.8,99.8")
    assert np.tan(-angle) == pytest.approx(-0.0169507, abs=1e-7)
    assert read_skew("SET_SKEW XY=141.4213562373,141.4213562373,100") == pytest.approx(0, abs=1e-9)
    for true in (-0.02, -1e-5, 0.0, 3e-4):
        text = write_skew(true, DEFAULTS)
        assert abs(read_skew(text) - true) <= skew_quantum(DEFAULTS) / 2
        # Klipper: x' = x - y factor; the axis y leans by the angle toward -x, and the two cancel.
        factor = np.tan(-read_skew(text))
        assert 0 - 100 * factor - 100 * np.tan(true) == pytest.approx(0, abs=1e-5)


def drifting(rng: Any, targets: Any, errors: Any) -> tuple[Any, ...]:
    """Five runs with drift of level and slope between passes, unequal for the directions."""
    rows: list[tuple[float, int, float, int]] = []
    for run in range(5):
        level, slope = rng.normal(0, 5e-4), rng.normal(0, 5e-4)
        for w, way in enumerate((1, -1)):
            line = level + slope * (targets / 250 - 1) + rng.normal(0, 2e-4)
            e = errors[w] + line + rng.normal(0, 4e-4, len(targets))
            rows += [(x, way, y, run) for x, y in zip(targets, e, strict=True)]
    return tuple(map(np.array, zip(*rows, strict=True)))


@pytest.mark.parametrize("name", ["beckhoff", "aerotech"])
def test_E_and_B_after_compensation_lie_in_their_intervals(name: str) -> None:
    """400 axes with drift between passes; a table of one column leaves the backlash as it is."""
    rng = np.random.default_rng(49)
    control, own = made(name)
    targets = np.linspace(0, 500, 11)
    inside, below, axes = [], [], 400
    for _ in range(axes):
        true = np.cumsum(rng.normal(0, 2e-3, 11)) + np.array([[1e-3], [-1e-3]])
        first = axis_errors(*drifting(rng, targets, true))
        result = compensate(first, control, own, Wanted(), seed=3, trials=600)
        left = true - Frame().applied(result.held, targets)
        found = figures(axis_errors(*drifting(rng, targets, left)).means, 2)
        assert result.after is not None
        pairs = [(result.after["E"], found["E"]), (result.after["B"], found["B"])]
        bounds = [np.quantile(drawn, (0.025, 0.5, 0.975)) for drawn, _ in pairs]
        inside.append([b[0] <= x <= b[2] for b, (_, x) in zip(bounds, pairs, strict=True)])
        below.append([x <= b[1] for b, (_, x) in zip(bounds, pairs, strict=True)])
    assert (np.mean(inside, axis=0) >= 0.925).all()
    # The median is one: neither too large nor too small.
    assert np.abs(np.mean(below, axis=0) - 0.5).max() < 0.08


def test_figures_are_those_of_the_standard() -> None:
    found = figures(np.stack([FORWARD, REVERSE]), 2)
    assert np.allclose([found["E"], found["B"], found["M"]], [13e-3, 5e-3, 8.5e-3])


def test_frame_machine_zero_and_reversed_axis() -> None:
    rng = np.random.default_rng(2)
    errors = axis_errors(*reading(rng, TARGETS, TRUE))
    control, own = made("table")
    for frame in (Frame(zero=-300), Frame(zero=20, reverse=True)):
        result = compensate(errors, control, own, Wanted(frame=frame), trials=100)
        assert np.abs(frame.applied(result.held, TARGETS) - errors.means).max() < 1e-6
        sign = -1 if frame.reverse else 1
        assert set(np.round(result.held.at - frame.zero, 4)) == set(np.round(sign * TARGETS, 4))


def test_the_active_table_is_added_to() -> None:
    rng = np.random.default_rng(3)
    control, own = made("beckhoff")
    errors = axis_errors(*reading(rng, TARGETS, TRUE))
    first = compensate(errors, control, own, Wanted(), trials=100).held
    zero = axis_errors(*reading(rng, TARGETS, 0 * TRUE, s=0.0))
    again = compensate(zero, control, own, Wanted(current=first), trials=100).held
    assert np.allclose(again.errors, first.errors, atol=1e-9)


def test_unequal_targets_need_a_step() -> None:
    rng = np.random.default_rng(4)
    targets = np.array([0.0, 10.0, 25.0, 60.0])
    errors = axis_errors(*reading(rng, targets, np.zeros((2, 4))))
    control, own = made("siemens-enc")
    with pytest.raises(InputError, match="--step"):
        compensate(errors, control, own, Wanted())
    found = compensate(errors, control, own, Wanted(positions=(0.0, 60.0, 10.0)))
    assert found.held.at.tolist() == [0, 10, 20, 30, 40, 50, 60]
    with pytest.raises(InputError, match="within the targets"):
        compensate(errors, control, own, Wanted(positions=(0.0, 70.0, 10.0)))


def test_backlash_that_varies_is_warned_of() -> None:
    rng = np.random.default_rng(6)
    control, own = made("acs")
    equal, varied = TRUE.copy(), TRUE + np.array([[1.0], [-1.0]]) * 2e-5 * TARGETS
    for errors, codes in ((equal, []), (varied, ["backlash-varies"])):
        result = compensate(axis_errors(*reading(rng, TARGETS, errors)), control, own, Wanted())
        assert [each.code for each in result.warnings] == codes


def test_half_a_table_and_a_table_that_scatter_hides() -> None:
    rng = np.random.default_rng(8)
    control, own = made("beckhoff")
    result = compensate(axis_errors(*reading(rng, TARGETS, TRUE)), control, own, Wanted())
    assert verdict(result, reading(rng, TARGETS, TRUE / 2)) == "partly"
    small = compensate(axis_errors(*reading(rng, TARGETS, TRUE / 200)), control, own, Wanted())
    assert verdict(small, reading(rng, TARGETS, 0 * TRUE)) == "too-small-to-tell"


def test_mean_and_forward_tables_leave_what_they_promise() -> None:
    """Forward leaves forward alone at zero; the mean leaves half the backlash on each side."""
    rng = np.random.default_rng(9)
    control, own = made("acs")
    errors = axis_errors(*reading(rng, TARGETS, TRUE, s=0.0))
    for direction, left in (("forward", [0.0, -0.002]), ("mean", [0.001, -0.001])):
        result = compensate(errors, control, own, Wanted(direction=direction), trials=100)
        applied = Frame().applied(result.held, TARGETS)
        assert np.allclose(errors.means - applied, np.array(left)[:, None], atol=1e-6)


def test_the_interval_of_k_covers_also_where_the_table_is_noise() -> None:
    """1000 verifications of tables from half to twenty times their scatter high: the table applied
    as it is, not at all, and with the other sign.
    """
    rng = np.random.default_rng(107)
    control, own = made("table")
    targets = np.linspace(0, 500, 11)
    held, named = [], []
    for i in range(1000):
        height, k = 1e-3 * 10 ** rng.uniform(-0.6, 1), i % 3
        wave = np.sin(2 * np.pi * targets / rng.uniform(250, 800) + rng.uniform(0, 6))
        true = height * (wave + np.array([[0.5], [-0.5]]))
        first = axis_errors(*drifting(rng, targets, true))
        result = compensate(first, control, own, Wanted(), trials=10)
        assert result.applied is not None
        found = verified(result, drifting(rng, targets, true + (k - 1) * result.applied))
        held.append(found.interval95[0] <= k <= found.interval95[1])
        names = ("worked", "no-effect", "wrong-sign")
        named.append(found.verdict in names and found.verdict != names[k])
    assert np.mean(held) >= 0.95
    assert np.mean(named) <= 0.02


def test_moves_of_an_angle_and_of_a_rotary_axis() -> None:
    rng = np.random.default_rng(12)
    control, own = made("table")
    targets = np.arange(0.0, 360.0, 30.0)
    true = 1e-4 * np.sin(np.radians(targets)) + np.array([[1e-5], [-1e-5]])
    errors = axis_errors(*reading(rng, targets, true, s=1e-6), angle=True, rotary=True)
    result = compensate(errors, control, own, Wanted(), trials=100)
    assert {move.direction for move in result.moves} == {"forward", "reverse"}
    text = control.text(result.held, own)
    assert "position_deg" in text
    back = control.read_back(text, own)
    assert back.rotary
    assert back.angle
    (first, *_), moves = record(RESULTS, result)["points"], record(RESULTS, result)["verification"]
    assert (first["position_mm"], first["position_deg"], first["unit"]) == (None, 0.0, "arcsec")
    move = moves["moves"][1]
    assert move["command_mm"] is None
    assert move["expect_without_um"] is None
    assert move["expect_without_arcsec"] == pytest.approx(result.moves[1].without / ARCSEC)
    assert "deg/min" in moves_program(result, 500.0, 3.0, "C", Frame())
    turned = moves_program(result, 500.0, 3.0, "C", Frame(zero=50.0, reverse=True))
    plain = moves_program(result, 500.0, 3.0, "C", Frame())
    places = [[float(x) for x in re.findall(r"C(-?[0-9.]+)", each)] for each in (plain, turned)]
    assert places[1] == pytest.approx([50.0 - x for x in places[0]])
    assert "machine coordinates" in turned
