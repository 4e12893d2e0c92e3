"""Simulated controls, each written from its manual's sentence and apart from the writers.

``CONTROLS[name](text)`` gives where an axis is sent to at a commanded position and travel (+1, -1):
the commanded position plus what the table adds there. The axis then errs by its own error.
"""

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import f

from mtu_cli.analyses.axis_errors import AxisErrors, axis_errors
from mtu_cli.analyses.compensate import (
    CompensateResult,
    Frame,
    Verified,
    compensate,
    figures,
    grid,
    moves_program,
    verify,
)
from mtu_cli.findings import InputError
from mtu_cli.formats.control import CONTROLLERS
from mtu_cli.formats.control.errors import Controller, ErrorTable
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.reports.compensate import document

Command = Callable[[float, int], float]
NUMBER = r"[-+]?\d+(?:\.\d+)?"


def command(
    forward: Iterable[tuple[float, float]], reverse: Iterable[tuple[float, float]] | None = None
) -> Command:
    """Adds the corrections of points (position, correction), linear between, held beyond them."""
    ways = {1: np.array(sorted(forward)).T}
    ways[-1] = ways[1] if reverse is None else np.array(sorted(reverse)).T
    return lambda x, way: x + float(np.interp(x, ways[way][0], ways[way][1]))


def rows_of(text: str, separator: str | None = None) -> list[list[float]]:
    """The lines that are numbers alone."""
    cells = [line.split(separator) for line in text.splitlines()]
    number = re.compile(NUMBER)
    return [[float(x) for x in row] for row in cells if row and all(map(number.fullmatch, row))]


def assignments(text: str, name: str) -> dict[str, float]:
    """Values by index."""
    found = re.findall(rf"(?m)^\${name}\[(\S+)\]=({NUMBER})\s*$", text)
    return {index: float(value) for index, value in found}


def linuxcnc(text: str) -> Command:
    """Source: trim = nominal - value (type 0), added to the commanded motor position."""
    rows = rows_of(text)
    return command(((n, n - f) for n, f, _ in rows), ((n, n - r) for n, _, r in rows))


def linuxcnc_trims(text: str) -> Command:
    """Type 1: the trims themselves."""
    rows = rows_of(text)
    return command(((n, f) for n, f, _ in rows), ((n, r) for n, _, r in rows))


def siemens_enc(text: str) -> Command:
    """ "A positive value makes the axis move in the negative direction"."""
    low, step = (assignments(text, f"AA_ENC_COMP_{x}")["0,X1"] for x in ("MIN", "STEP"))
    values = assignments(text, "AA_ENC_COMP")
    return command((low + step * int(index.split(",")[1]), -x) for index, x in values.items())


def siemens_cec(text: str) -> Command:
    """Measured minus ideal; DIRECTION 1 and -1 name the travel in which a table acts."""
    ways = {}
    for t, way in assignments(text, "AN_CEC_DIRECTION").items():
        low, step = (assignments(text, f"AN_CEC_{x}")[t] for x in ("MIN", "STEP"))
        points = (index.split(",") for index in assignments(text, "AN_CEC"))
        own = {int(k): assignments(text, "AN_CEC")[f"{t},{k}"] for table, k in points if table == t}
        ways[way] = [(low + step * k, -x) for k, x in own.items()]
    return command(ways[1.0], ways[-1.0])


def heidenhain(text: str) -> Command:
    """The figure is labelled "Error [mm]"; BACKLASH: what was measured in negative direction."""
    rows = rows_of(text)
    return command(((row[1], -row[-1]) for row in rows), ((row[1], -row[2]) for row in rows))


def beckhoff(text: str) -> Command:
    """Commanded 19866.7, reached 19856.5 going positive: pos is -102 in units of 0.1 um."""
    found = re.findall(r"table\[\d+\]\.(\w+)\s+(\S+)", text)
    at, pos, neg = (
        [float(x) * 1e-4 for own, x in found if own == name] for name in ("setpoint", "pos", "neg")
    )
    ways = ([-x for x in own] for own in (pos, neg))
    return command(*(zip(at, own, strict=True) for own in ways))


def two_columns(text: str) -> Command:
    """Values of the error model, which the control takes out."""
    return command((x, -e) for x, e in rows_of(text))


def aerotech(text: str) -> Command:
    """Corrections, added; OFFSET is minus the start."""
    step, offset = (
        float(re.findall(rf"{x}=({NUMBER})", text)[0]) for x in ("SAMPLEDIST", "START OFFSET")
    )
    return command((step * k - offset, value) for k, (value,) in enumerate(rows_of(text)))


def acs(text: str) -> Command:
    """Target minus mean, added."""
    base, step = map(float, re.findall(rf"MAP1D \d+, \d+, ({NUMBER}), ({NUMBER})", text)[0])
    values = re.findall(rf"\(\d+\) = ({NUMBER})", text)
    return command((base + step * k, float(value)) for k, value in enumerate(values))


def pmac(text: str) -> Command:
    """Sixteenths of a count (of 1 um), added to the commanded position; home is 0 and it wraps."""
    count, length = map(int, re.findall(r"DEFINE COMP (\d+),(\d+)", text)[0])
    values, span = [0.0, *(value for (value,) in rows_of(text))], length / 1000.0
    added = command((span / count * k, value / 16_000.0) for k, value in enumerate(values))
    return lambda x, way: x - x % span + added(x % span, way)


def mitsubishi(text: str) -> Command:
    """(Interval - actual) times 2 in um: what a move is to be longer by, twice."""
    _, low, high, *steps = np.array(rows_of(text, ",")).T
    at = [low[0], *high]
    return command(*(zip(at, [0.0, *np.cumsum(own) / 2000.0], strict=True) for own in steps))


def table(text: str) -> Command:
    """Columns of corrections, um, entered by hand."""
    rows = rows_of(text, ",")
    return command(((r[1], r[4] / 1000) for r in rows), ((r[1], r[5] / 1000) for r in rows))


CONTROLS: dict[str, Callable[[str], Command]] = {
    "linuxcnc": linuxcnc,
    "linuxcnc-trims": linuxcnc_trims,
    "siemens-enc": siemens_enc,
    "siemens-cec": siemens_cec,
    "heidenhain": heidenhain,
    "heidenhain-old": heidenhain,
    "beckhoff": beckhoff,
    "isg-csv": two_columns,
    "etalon": two_columns,
    "aerotech": aerotech,
    "acs": acs,
    "pmac": pmac,
    "mitsubishi": mitsubishi,
    "table": table,
}


# Tables of controls: golden values, reading back, refusals, the sign by a simulated control.


AT = np.array([0.0, 50.0, 100.0])
FORWARD, REVERSE = np.array([2.0, 5.0, -3.0]) * 1e-3, np.array([-1.0, 1.0, -8.0]) * 1e-3


def made(name: str) -> tuple[Controller, dict[str, str]]:
    """A control with its parameters: the old variant of `heidenhain-old`, type 1 of the trims."""
    control = CONTROLLERS[name.removesuffix("-old").removesuffix("-trims")]
    own = {"type": "1" if name.endswith("-trims") else "0", "counts_per_mm": "1000"}
    own |= {"variant": "old"} if name.endswith("-old") else {}
    known = {key: value for key, value in own.items() if key in control.parameters}
    return control, {**control.parameters, **known}


def golden(name: str, **parameters: str) -> str:
    """The file of the golden example (formats.md, constructed)."""
    control, own = made(name)
    own |= parameters
    two = ErrorTable.of(AT, FORWARD, REVERSE)
    table = two if control.two(own) else ErrorTable.of(AT, (FORWARD + REVERSE) / 2)
    return control.text(control.zero(table, 0.0), own).replace("\r", "")


@pytest.mark.parametrize(
    ("name", "parameters", "pattern", "expected"),
    [
        ("linuxcnc", {}, r".+", "0 0.002 -0.001|50 50.005 50.001|100 99.997 99.992"),
        ("linuxcnc", {"type": "1"}, r".+", "0 -0.002 0.001|50 -0.005 -0.001|100 0.003 0.008"),
        ("siemens-enc", {}, r"COMP\[.*=(.*)", "0.0|0.0025|-0.006"),
        ("siemens-cec", {}, r"CEC\[0,.*=(.*)", "0.0|0.003|-0.005"),
        ("siemens-cec", {}, r"CEC\[1,.*=(.*)", "-0.003|-0.001|-0.01"),
        ("beckhoff", {}, r"\.setpoint\s+(.*)", "0|500000|1000000"),
        ("beckhoff", {}, r"\.pos\s+(.*)", "20|50|-30"),
        ("beckhoff", {}, r"\.neg\s+(.*)", "-10|10|-80"),
        ("aerotech", {}, r"(?m)^[-.\d]+$", "-0.0005|-0.003|0.0055"),
        ("acs", {}, r"\) = (.*)", "-0.0005|-0.003|0.0055"),
        # Zeroed: -0.0025 and +0.006 mm are -40 and 96 sixteenths of a count of 1 um; it ends at
        # home.
        ("pmac", {}, r"(?m)^[-\d]+$", "-40|96|0"),
        # From the - side: the move back from 100 to 50 measured 49.991.
        ("mitsubishi", {}, r"(?m)^\d.*,(.*,.*)$", "-6,-4|16,18"),
    ],
)  # fmt: skip
def test_golden_values(name: str, parameters: dict[str, str], pattern: str, expected: str) -> None:
    assert "|".join(re.findall(pattern, golden(name, **parameters))) == expected


@pytest.mark.parametrize("name", CONTROLS)
def test_what_is_written_is_read_back_within_half_a_quantum(name: str) -> None:
    control, own = made(name)
    rng = np.random.default_rng(7)
    for _ in range(20):
        n = int(rng.integers(2, 40))
        step = 6.5536 if name == "heidenhain-old" else float(rng.integers(1, 800)) / 8
        at = np.round(step * (np.arange(n) - int(rng.integers(0, n))), 4)
        table = ErrorTable.of(at, *rng.normal(0, 0.01, (2, n))[: 1 + control.two(own)])
        table = control.zero(table, 0.0)
        held = control.read_back(control.text(table, own, "a note"), own)
        assert np.abs(held.at - at).max() <= 1e-4
        quantum = control.resolution(table, own)
        assert np.abs(held.errors - table.errors).max() <= quantum * (0.5 + 1e-6)


ENC = golden("siemens-enc")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("linuxcnc", "# nominal\n0 0 0\n50 50 50\n", "LinuxCNC stops reading here"),
        ("linuxcnc", "0 0 0\n\n50 50 50\n", "1 rows above"),
        # Mistakes of a public exporter.
        ("siemens-enc", ENC.replace("MODULO[0,X1]=0", "MODULO[0,X1]=-1"), "IS_MODULO is -1"),
        ("siemens-enc", ENC.replace("CHANDATA(1)\n", ""), "CHANDATA"),
        ("siemens-enc", ENC.replace("=100.0", "=200.0"), "MAX is 200"),
        ("aerotech", ":START 1 SAMPLEDIST=10\n1\n:END\n", "two points or more"),
        ("table", golden("table").replace("\n2,100", "\n2,40"), "rising positions"),
        ("heidenhain", "\n", "begin no table"),
        # Of the other type, each.
        ("linuxcnc", golden("linuxcnc", type="1"), "errors would follow the positions"),
    ],
)
def test_what_a_control_would_not_read_is_refused(name: str, text: str, said: str) -> None:
    control, own = made(name)
    with pytest.raises(InputError, match=said):
        control.read_back(text, own)


TARGETS = np.round(6.5536 * np.arange(-8, 7), 4)
TRUE = 0.02 * np.sin(TARGETS / 20) + 1e-4 * TARGETS + np.array([[0.001], [-0.001]])


def readings(
    rng: Any,
    targets: Any,
    errors: Any,
    s: float = 5e-4,
    drift: tuple[float, ...] = (5e-4, 0.0, 0.0),
) -> tuple[Any, ...]:
    """Five runs of both directions: scatter `s`, and `drift`: a level and a slope of each run, and
    a level of each direction in it.
    """
    n, values = len(targets), []
    for _ in range(5):
        level, slope = rng.normal(0, drift[:2])
        for own in errors:
            line = level + slope * (targets / 250 - 1) + rng.normal(0, drift[2])
            values.append(own + line + rng.normal(0, s, n))
    way = np.tile(np.repeat([1, -1], n), 5)
    return np.tile(targets, 10), way, np.concatenate(values), np.repeat(np.arange(5), 2 * n)


def axis(seed: int, errors: Any = TRUE, targets: Any = TARGETS, **more: Any) -> AxisErrors:
    return axis_errors(*readings(np.random.default_rng(seed), targets, errors, **more))


DRIFTING: dict[str, Any] = {"s": 4e-4, "drift": (5e-4, 5e-4, 2e-4)}


def with_table(
    name: str, change: Any = lambda text: text
) -> tuple[CompensateResult, tuple[Any, ...]]:
    """The result for a simulated axis, and readings with the table in its simulated control."""
    rng = np.random.default_rng(11)
    control, own = made(name)
    errors = axis_errors(*readings(rng, TARGETS, TRUE))
    result = compensate(errors, control, own, Frame(), seed=1, trials=500)
    command = CONTROLS[name](change(result.text))
    sent = np.array([[command(float(x), way) for x in TARGETS] for way in (1, -1)])
    left = np.stack([np.interp(sent[i], TARGETS, TRUE[i]) + sent[i] - TARGETS for i in (0, 1)])
    return result, readings(rng, TARGETS, left)


def verified(result: CompensateResult, after: tuple[Any, ...]) -> Verified:
    found = verify(result, *after).verified
    assert found is not None
    return found


@pytest.mark.parametrize("name", CONTROLS)
def test_a_simulated_control_moves_by_the_table_in_the_right_sense(name: str) -> None:
    """Also with the sign turned in the writer, and with a table of zeros: what a wrong writer would
    have made is seen.
    """
    result, after = with_table(name)
    assert verified(result, after).verdict == "worked"
    assert result.before is not None
    measured = axis_errors(*after).means
    assert np.ptp(measured, axis=1).max() < 0.2 * float(result.before["E"])
    moves = verify(result, *after).moves
    assert [move.measured for move in moves[:15]] == pytest.approx(measured[0].tolist())
    control, own = made(name)
    for factor, verdict in ((-1, "wrong-sign"), (0, "no-effect")):
        text = control.text(replace(result.held, errors=factor * result.held.errors), own)
        changed = with_table(name, lambda _, text=text: text)
        assert verified(*changed).verdict == verdict


def klipper(text: str) -> float:
    """Source: side = sqrt(2 AC^2 + 2 BD^2 - 4 AD^2) / 2, factor = tan(pi/2 - acos((AC^2 - side^2 -
    AD^2) / (2 side AD))), of which y times is taken from x.
    """
    ac, bd, ad = map(float, re.findall(rf"SET_SKEW XY=({NUMBER}),({NUMBER}),({NUMBER})", text)[0])
    side = math.sqrt(2 * ac * ac + 2 * bd * bd - 4 * ad * ad) / 2
    return math.tan(math.pi / 2 - math.acos((ac * ac - side * side - ad * ad) / (2 * side * ad)))


def test_skew_of_klipper() -> None:
    angle = read_skew("SET_SKEW XY=140.4,142.8,99.8")
    assert np.tan(-angle) == pytest.approx(-0.0169507, abs=1e-7)
    assert read_skew("SET_SKEW XY=141.4213562373,141.4213562373,100") == pytest.approx(0, abs=1e-9)
    for true in (-0.02, -1e-5, 0.0, 3e-4):
        text = write_skew(true, DEFAULTS)
        assert abs(read_skew(text) - true) <= skew_quantum(DEFAULTS) / 2
        # Klipper: x' = x - y factor; the axis y leans by the angle toward -x, and the two cancel.
        factor = klipper(text)
        assert 0 - 100 * factor - 100 * np.tan(true) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("name", ["beckhoff", "aerotech"])
def test_E_and_B_after_compensation_lie_in_their_intervals(name: str) -> None:
    """1000 axes with drift between passes; a table of one column leaves the backlash as it is."""
    rng = np.random.default_rng(49)
    control, own = made(name)
    targets = np.linspace(0, 500, 11)
    inside, below = [], []
    for _ in range(1000):
        true = np.cumsum(rng.normal(0, 2e-3, 11)) + np.array([[1e-3], [-1e-3]])
        first = axis_errors(*readings(rng, targets, true, **DRIFTING))
        result = compensate(first, control, own, Frame(), seed=3, trials=600)
        left = true - Frame().applied(result.held, targets)
        found = figures(axis_errors(*readings(rng, targets, left, **DRIFTING)).means, 2)
        assert result.after is not None
        bounds = {x: np.quantile(result.after[x], (0.025, 0.5, 0.975)) for x in "EB"}
        inside.append([low <= found[x] <= high for x, (low, _, high) in bounds.items()])
        below.append([found[x] <= middle for x, (_, middle, _) in bounds.items()])
    assert (np.mean(inside, axis=0) >= 0.925).all()
    # The median is one: neither too large nor too small.
    assert np.abs(np.mean(below, axis=0) - 0.5).max() < 0.08


def test_frame_machine_zero_and_reversed_axis() -> None:
    errors = axis(2)
    for frame in (Frame(zero=-300), Frame(zero=20, reverse=True)):
        result = compensate(errors, *made("table"), frame, trials=100)
        assert np.abs(frame.applied(result.held, TARGETS) - errors.means).max() < 1e-6
        sign = -1 if frame.reverse else 1
        assert set(np.round(result.held.at - frame.zero, 4)) == set(np.round(sign * TARGETS, 4))
        assert np.allclose(frame.of_machine(frame.places(TARGETS)), TARGETS)
    plain, turned = (
        [float(x) for x in re.findall(r"C(-?[0-9.]+)", moves_program(result, 500, 3, "C", frame))]
        for frame in (Frame(), Frame(zero=50.0, reverse=True))
    )
    assert turned == pytest.approx([50.0 - x for x in plain])


def test_the_active_table_is_added_to() -> None:
    first = compensate(axis(3), *made("beckhoff"), Frame(), trials=100).held
    zero = axis(3, 0 * TRUE, s=0.0, drift=(0, 0, 0))
    again = compensate(zero, *made("beckhoff"), Frame(), current=first, trials=100).held
    assert np.allclose(again.errors, first.errors, atol=1e-9)


def test_unequal_targets_need_a_step() -> None:
    errors = axis(4, np.zeros((2, 4)), np.array([0.0, 10.0, 25.0, 60.0]))
    with pytest.raises(InputError, match="--step"):
        compensate(errors, *made("siemens-enc"), Frame())
    found = compensate(errors, *made("siemens-enc"), Frame(), places=grid(0, 60, 10))
    assert found.held.at.tolist() == [0, 10, 20, 30, 40, 50, 60]
    with pytest.raises(InputError, match="within the targets"):
        compensate(errors, *made("siemens-enc"), Frame(), places=grid(0, 70, 10))


def test_backlash_that_varies_is_warned_of() -> None:
    varied = TRUE + np.array([[1.0], [-1.0]]) * 2e-5 * TARGETS
    for errors, codes in ((TRUE, []), (varied, ["backlash-varies"])):
        result = compensate(axis(6, errors), *made("acs"), Frame())
        assert [each.code for each in result.warnings] == codes


def test_half_a_table_and_a_table_that_scatter_hides() -> None:
    for height, left, verdict in ((1, TRUE / 2, "partly"), (200, 0 * TRUE, "too-small-to-tell")):
        result = compensate(axis(8, TRUE / height), *made("beckhoff"), Frame())
        after = readings(np.random.default_rng(9), TARGETS, left)
        assert verified(result, after).verdict == verdict


def test_mean_and_forward_tables_leave_what_they_promise() -> None:
    """Forward leaves forward alone at zero; the mean leaves half the backlash on each side."""
    errors = axis(9, s=0.0)
    for direction, left in (("forward", [0.0, -0.002]), ("mean", [0.001, -0.001])):
        result = compensate(errors, *made("acs"), Frame(), direction=direction, trials=100)
        applied = Frame().applied(result.held, TARGETS)
        assert np.allclose(errors.means - applied, np.array(left)[:, None], atol=1e-6)


def test_one_run_in_one_direction_leaves_reversal_and_u_unknown() -> None:
    """They are no zeros: the table takes the other direction to be alike, and says so."""
    none = np.zeros(len(TARGETS), int)
    first = axis_errors(TARGETS, none + 1, TRUE[0], none)
    result = compensate(first, *made("table"), Frame(), trials=10)
    unknown = [x.facts["quantity"] for x in result.warnings if x.code == "not-estimable"]
    assert unknown == ["reversal", "figures after compensation"]
    assert result.after is None
    assert result.moves
    assert all(np.isnan(move.u) for move in result.moves)


def test_the_interval_of_k_covers_also_where_the_table_is_noise() -> None:
    """1000 verifications of tables from half to twenty times their scatter high: the table applied
    as it is, not at all, and with the other sign.
    """
    rng = np.random.default_rng(107)
    targets = np.linspace(0, 500, 11)
    held, named = [], []
    for i in range(1000):
        height, k = 1e-3 * 10 ** rng.uniform(-0.6, 1), i % 3
        wave = np.sin(2 * np.pi * targets / rng.uniform(250, 800) + rng.uniform(0, 6))
        true = height * (wave + np.array([[0.5], [-0.5]]))
        first = axis_errors(*readings(rng, targets, true, **DRIFTING))
        result = compensate(first, *made("table"), Frame(), trials=10)
        assert result.applied is not None
        after = readings(rng, targets, true + (k - 1) * result.applied, **DRIFTING)
        found = verified(result, after)
        held.append(found.interval95[0] <= k <= found.interval95[1])
        names = ("worked", "no-effect", "wrong-sign")
        named.append(found.verdict in names and found.verdict != names[k])
    assert np.mean(held) >= 0.95
    assert np.mean(named) <= 0.02


def test_a_new_reversal_or_wave_is_reported_beside_the_verdict() -> None:
    """Of a table that works: hardly ever by chance, with runs of their own or single moves."""
    rng, targets = np.random.default_rng(16), np.linspace(0, 500, 11)

    def warned(change: Any, stops: Any, runs: int) -> bool:
        true = np.cumsum(rng.normal(0, 2e-3, 11)) + np.array([[1e-3], [-1e-3]])
        first = axis_errors(*readings(rng, targets, true, **DRIFTING))
        result = compensate(first, *made("table"), Frame(), trials=10)
        assert result.applied is not None
        after = readings(rng, targets, true - result.applied + change, **DRIFTING)
        rows = np.isin(after[0], stops) & (after[3] < runs)
        codes = {x.code for x in verify(result, *(x[rows] for x in after)).warnings}
        return "unlike-first-test" in codes

    moves: list[tuple[Any, int]] = [(targets, 5), (targets[[0, 2, 5, 8, 10]], 1)]
    wave = 10e-3 * np.sin(targets / 50)
    for stops, runs in moves:
        for change in (np.array([[6e-3], [-6e-3]]), wave):
            assert all(warned(change, stops, runs) for _ in range(10))
        assert sum(warned(0.0, stops, runs) for _ in range(200)) <= 4


def test_the_misfit_is_that_of_a_straight_line() -> None:
    """Of repeats without runs every reading has s^2 (1 + 1/n) and the last place: chi^2/(n - 2)
    about a line of least squares, plainly.
    """
    rng, s, n = np.random.default_rng(8), 1e-3, 6
    at, way = np.tile(TARGETS, 2 * n), np.repeat([1, -1], n * len(TARGETS))
    value = TRUE[(way < 0).astype(int), np.tile(np.arange(15), 2 * n)] + rng.normal(0, s, at.size)
    first = axis_errors(at, way, value, np.zeros(at.size, int))
    result = compensate(first, *made("table"), Frame(), trials=10)
    assert result.applied is not None
    after = rng.normal(0, 2 * s, 30)
    place, turn = np.tile(TARGETS, 2), np.repeat([1, -1], 15)
    found = verified(result, (place, turn, after, np.zeros(30, int)))
    t = result.applied.ravel()
    y = after - first.means.ravel() + t
    rest = y - np.polyval(np.polyfit(t, y, 1), t)
    scatter = value.reshape(2, n, 15) - value.reshape(2, n, 15).mean(1, keepdims=True)
    variance = (scatter**2).sum() / (30 * (n - 1)) * (1 + 1 / n) + result.quantum**2 / 12
    assert found.misfit is not None
    assert pytest.approx((rest @ rest) / 28 / variance, rel=1e-6) == found.misfit.F
    assert found.misfit.p == pytest.approx(f.sf(found.misfit.F, 28, 30 * (n - 1)), rel=1e-6)


def test_a_first_test_without_scatter_has_no_misfit() -> None:
    """One run, or stated errors: whatever the verification shows, there is nothing to compare."""
    rng = np.random.default_rng(18)
    one_run = tuple(x[:30] for x in readings(rng, TARGETS, TRUE))
    stated = AxisErrors(targets=TARGETS, means=TRUE, expected=TRUE, ways=2, read=False,
                        known=1e-8 * np.eye(30))  # fmt: skip
    for first in (axis_errors(*one_run), stated):
        result = compensate(first, *made("table"), Frame(), trials=10)
        assert result.applied is not None
        after = readings(rng, TARGETS, TRUE - result.applied + np.array([[6e-3], [-6e-3]]))
        found = verify(result, *after)
        assert found.verified is not None
        assert found.verified.misfit is None
        assert "unlike-first-test" not in [each.code for each in found.warnings]
        assert document(found).record()["verification"]["misfit"] is None


def test_p_of_the_misfit_is_an_upper_bound() -> None:
    """Of verifications without a change it is below 0.05 in fewer than 5 %, with few runs, too."""
    rng, targets = np.random.default_rng(20), np.linspace(0, 500, 11)
    for runs in (2, 3, 5):
        p = []
        for _ in range(150):
            true = np.cumsum(rng.normal(0, 2e-3, 11)) + np.array([[1e-3], [-1e-3]])
            before, after = (readings(rng, targets, true, **DRIFTING) for _ in range(2))
            first = axis_errors(*(x[: 22 * runs] for x in before))
            result = compensate(first, *made("table"), Frame(), trials=10)
            assert result.applied is not None
            after[2][:] -= result.applied[(after[1] < 0).astype(int), np.tile(np.arange(11), 10)]
            found = verified(result, tuple(x[: 22 * runs] for x in after))
            assert found.misfit is not None
            p.append(found.misfit.p)
        assert np.mean(np.array(p) < 0.05) <= 0.05


def test_repeats_without_runs_scatter_each_by_itself() -> None:
    """Not as one line of the run that they count as: F is about 1, and u that of k."""
    rng, k, u, F = np.random.default_rng(3), list[float](), list[float](), list[float]()
    at, way = np.tile(TARGETS, 10), np.repeat([1, -1], 75)
    cell = (way < 0).astype(int), np.tile(np.arange(15), 10)
    none = np.zeros(150, int)
    for _ in range(60):
        first = axis_errors(at, way, TRUE[cell] + rng.normal(0, 1e-3, 150), none)
        result = compensate(first, *made("table"), Frame(), trials=10)
        assert result.applied is not None
        left = (TRUE - result.applied)[cell] + rng.normal(0, 1e-3, 150)
        found = verified(result, (at, way, left, none))
        assert found.misfit is not None
        k, u, F = [*k, found.k], [*u, found.u], [*F, found.misfit.F]
    assert np.mean(F) == pytest.approx(1.0, abs=0.1)
    assert 0.9 * np.std(k) <= np.mean(u) <= 1.5 * np.std(k)


def test_the_interval_of_k_covers_also_readings_that_scatter_more() -> None:
    """And u is no wider than half as much again as k scatters (the table's own u is in it)."""
    result, _ = with_table(next(iter(CONTROLS)))
    assert result.applied is not None
    rng, draws = np.random.default_rng(5), 200
    for s in (5e-4, 9e-3):
        left = [readings(rng, TARGETS, TRUE - result.applied, s) for _ in range(draws)]
        found = [verified(result, after) for after in left]
        low, high = np.array([each.interval95 for each in found]).T
        assert ((low <= 0) & (high >= 0)).mean() >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / draws)
    # Of the scatter that the first test did not have.
    k, u = np.array([(each.k, each.u) for each in found]).T
    assert 0.9 * k.std() <= u.mean() <= 1.5 * k.std()
