"""Budget files: what they accept, and every fault with its line, all at once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from budget_examples import loaded
from support import CONFIGS

from mtu_cli.analyses.budget.quantities import InputQuantity, input_quantities
from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget
from mtu_cli.stats.distributions import Distribution

SHIPPED = sorted((CONFIGS / "budgets").glob("*.yaml"))
SUM = "equation: a + b\ninputs:\n  b: {value: 1, u: 0.1}\n"


def faults(text: str) -> list[str]:
    with pytest.raises(InputError) as raised:
        loaded(text)
    return [str(problem) for problem in raised.value.findings]


@pytest.mark.parametrize(
    ("name", "meant"),
    [("uniform", "rectangular"), ("Gaussian", "normal"), ("gauss", "normal"),
     ("u-shaped", "arcsine"), ("U shaped", "arcsine"), ("arcsin", "arcsine"), ("student", "t"),
     ("Student's t", "t"), ("triangle", "triangular"), ("uniform distribution", "rectangular"),
     ("trapezoid", "trapezoidal"), ("Normal", "normal"), ("rectanglar", "rectangular")],
)  # fmt: skip
def test_a_distribution_by_another_name(name: str, meant: str) -> None:
    (found,) = faults(SUM + f'  a: {{value: 1, half_width: 1, distribution: "{name}"}}\n')
    assert found.endswith(f"unknown value: {name!r}; did you mean {meant!r}?")


def test_the_rest_of_a_decimal_comma_is_told_as_no_name_too() -> None:
    (found,) = faults("equation: a + b\ninputs: {a: 1, b: 9,81}\n")
    assert "inputs.81: has no value; expected a decimal point before 81" in found


def quantity(entry: str) -> InputQuantity:
    """The input `a` of a sum."""
    found = input_quantities(loaded(SUM + f"  a: {entry}\n"))
    return next(item for item in found if item.name == "a")


def contribution(entry: str) -> Distribution:
    (part,) = quantity(entry).parts
    return part.distribution


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_budgets(path: Path) -> None:
    budget = load_budget(path)
    assert budget.budget.says
    assert not budget.warnings
    assert all(item.unit for item in budget.budget.inputs.values())


def test_there_are_four() -> None:
    assert len(SHIPPED) >= 4


@pytest.mark.parametrize(
    ("entry", "u", "dof"),
    [
        ("{value: 0, u: 0.3}", 0.3, math.inf),
        ("{value: 0, u: 0.3, dof: 7, distribution: t}", 0.3, 7.0),
        ("{value: 0, U: 0.6, k: 2}", 0.3, math.inf),
        ("{value: 0, half_width: 0.3, distribution: rectangular}", 0.3 / math.sqrt(3), math.inf),
        ("{low: -1, high: 1, distribution: triangular}", 1 / math.sqrt(6), math.inf),
        ("{value: 0, half_width: 2, distribution: arcsine}", math.sqrt(2), math.inf),
        (
            "{value: 0, half_width: 2, top: 1, distribution: trapezoidal}",
            math.sqrt(5 / 6),
            math.inf,
        ),
        # GUM H.1: the u of the stated limits, 50 degrees of freedom.
        ("{value: 0, half_width: 1, dof: 50, distribution: rectangular}", 1 / math.sqrt(3), 50.0),
        # JCGM 101, 6.4.3: u^2 = a^2/3 + d^2/9, and nu = (a/d)^2 / 2.
        (
            "{value: 0, half_width: 1, inexact: 0.5, distribution: curvilinear-trapezoidal}",
            math.sqrt(1 / 3 + 0.25 / 9),
            2.0,
        ),
        (
            "{value: 0, half_width: 1, dof: 2, distribution: curvilinear-trapezoidal}",
            math.sqrt(1 / 3 + 0.25 / 9),
            2.0,
        ),
        ("{readings: [1, 2, 3, 4]}", math.sqrt(5 / 3 / 4), 3.0),
    ],
)
def test_standard_uncertainties(entry: str, u: float, dof: float) -> None:
    found = contribution(entry)
    assert found.u == pytest.approx(u)
    assert found.dof == pytest.approx(dof)


@pytest.mark.parametrize(
    "kind",
    [
        "distribution: rectangular",
        "distribution: triangular",
        "distribution: arcsine",
        "distribution: trapezoidal, top: 0.2",
        "distribution: curvilinear-trapezoidal, inexact: 0.1",
        "distribution: curvilinear-trapezoidal, dof: 8",
    ],
)
def test_a_standard_uncertainty_gives_the_half_width(kind: str) -> None:
    """The variance of what is drawn is the stated u^2."""
    found = contribution(f"{{value: 0, u: 0.3, {kind}}}")
    assert found.drawn_variance == pytest.approx(0.09)
    again = contribution(f"{{value: 0, half_width: {found.half_width!r}, {kind}}}")
    assert again.u == pytest.approx(0.3)


def test_values() -> None:
    assert quantity("{low: 2, high: 5, distribution: rectangular}").value == 3.5
    assert quantity("{readings: [1, 2, 6]}").value == 3.0
    exact = quantity("9.81")
    assert (exact.value, exact.u, exact.type) == (9.81, 0.0, "")


def test_contributions_are_counted_once_each() -> None:
    found = quantity(
        "{readings: [1, 2, 3, 4], u: 0.5, "
        "contributions: [{half_width: 0.3, distribution: arcsine}]}"
    )
    assert found.u == pytest.approx(math.sqrt(5 / 12 + 0.25 + 0.045))
    assert found.type == "A+B"
    assert found.dof == pytest.approx(3 * (found.u**2 / (5 / 12)) ** 2)


def test_readings_stand_beside_further_contributions() -> None:
    found = quantity(
        "{readings: [1, 2, 6], contributions: [{half_width: 0.5, distribution: rectangular}]}"
    )
    assert (found.value, found.type) == (3.0, "A+B")
    assert found.u == pytest.approx(math.sqrt(7 / 3 + 0.25 / 3))


# The faults of one file each, told in the order of its lines; words that each must hold.
FAULTY = {
    "both u and half_width": ("{value: 1, u: 1, half_width: 2}", ["u and half_width are given"]),
    "u and U": ("{value: 1, u: 1, U: 2, k: 2}", ["u and U are given"]),
    "negative u": ("{value: 1, u: -1}", ["wrong value: '-1'; expected a number of at least 0"]),
    "low above high": ("{low: 2, high: 1, distribution: rectangular}", ["not below `high`"]),
    "low alone": ("{value: 1, low: 2, distribution: rectangular}", ["`low` without `high`"]),
    "U alone": ("{value: 1, U: 2}", ["`U` without `k`"]),
    "no value": ("{u: 1}", ["the key 'value' is missing; expected a value or readings"]),
    "value and readings": ("{value: 1, readings: [1, 2]}", ["beside `readings`"]),
    "value off the middle": (
        "{value: 1.2, low: 0, high: 2, distribution: rectangular}",
        ["not the middle of `low` and `high`", "expected 1, or none"],
    ),
    "one reading": ("{readings: [1]}", ["at least 2 of them"]),
    "limits without a distribution": (
        "{value: 1, half_width: 1}",
        ["has no limits, and it is normal unless", "expected `distribution: rectangular`, say, or"],
    ),
    "normal with limits": (
        "{value: 1, half_width: 1, distribution: normal}",
        ["a normal distribution has no limits; expected"],
    ),
    "resolution": ("{value: 1, resolution: 1}", ["'resolution'; expected `half_width:`, half of"]),
    "size of a sample": ("{value: 1, u: 1, n: 5}", ["'n'; expected `dof:`, n - 1"]),
    "U of 95 %": ("{value: 1, U95: 1}", ["'U95'; expected `U:` with its `k:`"]),
    "t without dof": ("{value: 1, u: 1, distribution: t}", ["without `dof`"]),
    "dof of nothing": ("{readings: [1, 2], dof: 9}", ["readings have n - 1"]),
    "dof of zero": ("{value: 1, u: 1, dof: 0}", ["a number above 0"]),
    "too few dof for limits": (
        "{value: 1, half_width: 1, distribution: rectangular, dof: 0.2}",
        ["no limits (GUM G.4.2)"],
    ),
    "unknown distribution": (
        "{value: 1, u: 1, distribution: rectangle}",
        ["did you mean 'rectangular'?"],
    ),
    "misspelt key": ("{value: 1, halfwidth: 1}", ["did you mean 'half_width'?"]),
    "top of a rectangle": (
        "{value: 1, u: 1, distribution: rectangular, top: 1}",
        ["`top` belongs to trapezoidal"],
    ),
    "no top": ("{value: 1, u: 1, distribution: trapezoidal}", ["the key 'top' is missing"]),
    "top too wide": (
        "{value: 1, half_width: 1, distribution: trapezoidal, top: 2}",
        ["larger than the half-width: '2.0'; expected at most 1"],
    ),
    "top too wide for u": (
        "{value: 1, u: 1, distribution: trapezoidal, top: 2}",
        ["so wide a top", "at most 1.73205"],
    ),
    "inexact and dof": (
        "{value: 1, half_width: 1, distribution: curvilinear-trapezoidal, inexact: 0.1, dof: 50}",
        ["say the same"],
    ),
    "contribution of nothing": ("{value: 1, contributions: [{says: x}]}", ["how large it is"]),
    "readings among contributions": (
        "{contributions: [{readings: [1, 2]}, {u: 1}], unit: mm}",
        ["contributions[0].readings: unknown key", "expected `readings:` beside `contributions:`"],
    ),
    "readings among contributions to a value": (
        "{value: 1, contributions: [{u: 1}, {readings: [1, 2]}]}",
        ["in place of `value:`: it is their mean"],
    ),
    "unit of a contribution": (
        "{value: 1, contributions: [{u: 1, unit: mm}]}",
        ["contributions[0].unit: unknown key", "expected `unit:` beside `contributions:`"],
    ),
    "value of a contribution": (
        "{value: 1, contributions: [{value: 0, u: 1}]}",
        ["expected `value:` beside `contributions:`"],
    ),
    "distribution of nothing": ("{value: 1, distribution: arcsine}", ["without a width"]),
}


@pytest.mark.parametrize("name", FAULTY)
def test_faults_of_an_input(name: str) -> None:
    entry, words = FAULTY[name]
    found = faults(SUM + f"  a: {entry}\n")
    assert len(found) == 1, found
    assert found[0].startswith("b.yaml:6: inputs.a")
    for word in words:
        assert word in found[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("coverage: {probability: 95}", "a probability above 1: '95'; expected 0.95 for 95 %"),
        ("coverage: {probability: 99.95}", "expected a number of at most 0.999"),
        (
            "correlations: {a: {b: 0.3}}",
            'not a list of correlations: \'{"a": {"b": 0.3}}\'; expected',
        ),
        ("correlations: [a, b, 0.3]", "expected brackets around each of them too"),
    ],
)
def test_what_is_beside_the_inputs(text: str, words: str) -> None:
    (found,) = faults(SUM + f"  a: {{value: 1, u: 1}}\n{text}\n")
    assert words in found


def test_readings_by_another_name() -> None:
    first, _ = faults(SUM + "  a: {values: [1, 2]}\n")
    assert first.endswith("unknown key: 'values'; expected `readings:`")


def test_all_faults_at_once() -> None:
    found = faults(
        """\
        equation: a + lenght*c
        inputs:
          a: {value: 1, u: -1}
          length: {value: 2, u: 1, half_width: 3}
          c: {value: 1, u: 1, distribution: normall}
          sin: 3
          2x: 4
        correlations: [[a, d, 0.5], [a, a, 0.1], [a, c, 1.5], [c, length]]
        coverage: {probability: 0.95, k: 2}
        """
    )
    lines = [
        ("b.yaml:3: equation:", "unknown name 'lenght' at column 5; did you mean 'length'?"),
        ("b.yaml:5: inputs.a.u", "at least 0"),
        ("b.yaml:6: inputs.length", "u and half_width"),
        ("b.yaml:7: inputs.c.distribution", "did you mean 'normal'?"),
        ("b.yaml:8: inputs.sin", "the name of a function"),
        ("b.yaml:9: inputs.2x", "no equation can use this name"),
        ("b.yaml:10: correlations[3]", "two inputs and a coefficient"),
        ("b.yaml:10: correlations[0]", "unknown input: 'd'"),
        ("b.yaml:10: correlations[1]", "correlated with itself"),
        ("b.yaml:10: correlations[2]", "beyond 1"),
        ("b.yaml:11: coverage", "both `probability` and `k`"),
    ]
    assert len(found) == len(lines), found
    for text, (place, words) in zip(found, lines, strict=True):
        assert text.startswith(place)
        assert words in text


def test_faults_of_equations() -> None:
    both = "equation: a\nequations: {y: a}\ninputs: {a: {value: 1, u: 1}}\n"
    assert any("both `equation` and `equations`" in text for text in faults(both))
    (none,) = faults("inputs: {a: {value: 1, u: 1}}\n")
    assert "the key 'equation' is missing" in none
    (clash,) = faults("equations: {a: 2*a}\ninputs: {a: {value: 1, u: 1}}\n")
    assert "an input has the same name" in clash
    (unit,) = faults("equations: {R: a}\nunits: {r: ohm}\ninputs: {a: {value: 1, u: 1}}\n")
    assert "did you mean 'R'?" in unit
    (text,) = faults("equation: 2*(a + 1\ninputs: {a: {value: 1, u: 1}}\n")
    assert "not closed" in text


def test_faults_of_simultaneous_readings() -> None:
    text = "equation: V/I + T\ninputs:\n  V: {readings: [1, 2, 3]}\n  I: {readings: [1, 2]}\n"
    text += "  T: {value: 1, u: 1}\n"
    (unequal,) = faults(text + "simultaneous: [[V, I]]\n")
    assert "equally many, these are not: V 3, I 2" in unequal
    (without,) = faults(text + "simultaneous: [[V, T]]\n")
    assert "'T' has no readings" in without
    (twice,) = faults(text.replace("1, 2]", "1, 2, 4]") + "simultaneous: [[V, I], [V, I]]\n")[:1]
    assert "stands in two places" in twice
    (stated,) = faults(
        text.replace("1, 2]", "1, 2, 4]") + "simultaneous: [[V, I]]\ncorrelations: [[V, I, 0.2]]\n"
    )
    assert "comes from their simultaneous readings" in stated


def test_a_unit_that_is_not_read_is_a_warning_where_another_is_meant() -> None:
    text = "equation: a*b\ninputs:\n  a: {value: 1, u: 1, unit: um/m K}\n"
    (notice,) = loaded(text + "  b: {value: 1, u: 1, unit: furlong}\n").warnings
    assert notice.code == "unit-unclear"
    assert notice.message.startswith("b.yaml:5: inputs.a.unit: 'um/m K' is not read, so that no ")


def test_inputs_without_a_unit_beside_others_are_a_warning() -> None:
    """Who states some units expects that all are checked; of none at all nothing is."""
    text = "equation: a*b + c\ninputs:\n  a: {value: 1, u: 1, unit: mm}\n  b: {value: 1, u: 1}\n"
    (notice,) = loaded(text + "  c: {value: 1, u: 1}\n").warnings
    assert notice.code == "unit-not-stated"
    assert notice.message == (
        "b.yaml:6: inputs b, c: no `unit:`, so that no term with one of them is checked; "
        "`unit: '1'` is that of a plain number"
    )
    (notice,) = loaded(text + "  c: {value: 1, u: 1, unit: mm}\n").warnings
    assert "input b: no `unit:`, so that no term with it is" in notice.message
    numbered = text.replace("b: {value: 1, u: 1", "b: {value: 1, u: 1, unit: '1'")
    assert loaded(numbered + "  c: {value: 1, u: 1, unit: mm}\n").warnings == ()
    assert loaded(text.replace(", unit: mm", "") + "  c: {value: 1, u: 1}\n").warnings == ()


def test_an_unused_input_is_a_warning() -> None:
    """As an unused component of a machine is one."""
    budget = loaded("equation: a\ninputs:\n  a: {value: 1, u: 1}\n  b: {value: 1, u: 1}\n")
    (notice,) = budget.warnings
    assert notice.code == "unused-input"
    assert notice.message == "b.yaml:6: inputs.b: in no equation"


def test_equal_readings_without_a_resolution_are_a_warning() -> None:
    text = "equation: a + b\ninputs:\n  b: {value: 1, u: 1}\n  a:\n    readings: [0.1, 0.1, 0.1]\n"
    (notice,) = loaded(text).warnings
    assert notice.code == "equal-readings"
    assert notice.message.startswith("b.yaml:7: inputs.a.readings: all 3 are 0.1, so that u is 0:")
    assert "half_width: r/2" in notice.message
    stated = text + "    half_width: 0.05\n    distribution: rectangular\n"
    apart = text + "    contributions: [{u: 0.02}]\n"
    assert not loaded(stated).warnings + loaded(apart).warnings
    assert loaded(text + "    contributions: [{u: 0}]\n").warnings
    (a,) = (item for item in input_quantities(loaded(text)) if item.name == "a")
    assert (a.value, a.u) == (0.1, 0.0)


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        ("[1.001, 1.002, 1.001, 1001]", "[3]: 1001 stands out from the others, 1.001 to 1.002"),
        ("[50.0021, 5.00024, 50.0019]", "[1]: 5.00024 stands out"),
        ("[2.1, 2.2, 2.15, 2.1, 9]", "[4]: 9 stands out from the others, 2.1 to 2.2, and makes"),
        ("[2.1, 2.2, 2.15, 2.1, 2.9]", ""),
        ("[1.001, 1.001, 1.001, 1.002]", ""),
        ("[-0.2, 0.1, 2.0]", ""),
        ("[1, 10]", ""),
    ],
)
def test_a_reading_that_stands_out_is_a_warning(readings: str, words: str) -> None:
    text = f"equation: a + b\ninputs:\n  b: {{value: 1, u: 1}}\n  a: {{readings: {readings}}}\n"
    found = loaded(text).warnings
    assert [item.code for item in found] == ["reading-stands-out"] * bool(words)
    if words:
        assert found[0].message.startswith(f"b.yaml:6: inputs.a.readings{words}")


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("1,5", "inputs.a: wrong value: '1,5'; expected a number with a decimal point"),
        ("{value: 1,5, u: 1}", "inputs.a.5: unknown key: '5'; expected a decimal point before 5"),
        ("{value: 1, u: '0,1e-3'}", "inputs.a.u: wrong value: '0,1e-3'; expected a number with a"),
        ("{readings: [1, '2,5']}", "inputs.a.readings[1]: wrong value: '2,5'; expected a number"),
        ("about 3", "inputs.a: wrong value: 'about 3'; expected a number, or keys with values"),
        ("3 mm", "inputs.a: wrong value: '3 mm'; expected a number alone, without its unit"),
    ],
)
def test_numbers_that_are_texts(entry: str, expected: str) -> None:
    (found,) = faults(SUM + f"  a: {entry}\n")
    assert expected in found


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("{value: 1.0e308, u: 1}", "inputs.a.value: the number is too large"),
        ("{value: 1, u: 1.0e308}", "inputs.a.u: the number is too large"),
        ("{readings: [1, 1.0e308]}", "inputs.a.readings[1]: the number is too large"),
        ("{value: 0, u: 1.0e-172}", "inputs.a.u: the number is too small"),
        ("{value: 0, U: 1.0e-149, k: 30}", "inputs.a.k: U/k is too small"),
    ],
)
def test_numbers_whose_squares_no_computer_holds(entry: str, expected: str) -> None:
    with pytest.raises(InputError) as raised:
        loaded(f"equation: a\ninputs:\n  a: {entry}\n")
    assert str(raised.value).startswith(f"b.yaml:5: {expected}")
