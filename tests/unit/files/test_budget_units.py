"""Units of budgets: what they are, and where an equation disagrees with them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget
from mtu_cli.files.unit_text import GRAMS, SIZE, meant, unit_exponents

# Sizes from the SI brochure (9th edition), in m, kg, s, A, K; an angle is a number.
SIZES = [
    ("mm", 1e-3, {"m": 1}),
    ("\u00b5m", 1e-6, {"m": 1}),
    ("nm", 1e-9, {"m": 1}),
    ("in", 0.0254, {"m": 1}),
    ("inch", 0.0254, {"m": 1}),
    ("Inches", 0.0254, {"m": 1}),
    ("Zoll", 0.0254, {"m": 1}),
    ("inch^2", 0.0254**2, {"m": 2}),
    ("thou", 25.4e-6, {"m": 1}),
    ("microns", 1e-6, {"m": 1}),
    ("micron/Kelvin", 1e-6, {"m": 1, "K": -1}),
    ("Celsius", 1.0, {"K": 1}),
    ("deg C", 1.0, {"K": 1}),
    ("degrees Celsius", 1.0, {"K": 1}),
    ("1/\u2103", 1.0, {"K": -1}),
    ("degrees", math.pi / 180, {}),
    ("arcseconds", math.pi / 648000, {}),
    ("mm^2", 1e-6, {"m": 2}),
    ("mm\u00b2", 1e-6, {"m": 2}),
    ("m/s2", 1.0, {"m": 1, "s": -2}),
    ("min", 60.0, {"s": 1}),
    ("um/m/K", 1e-6, {"K": -1}),
    ("um/(m K)", 1e-6, {"K": -1}),
    ("um/(m*K)", 1e-6, {"K": -1}),
    ("N/(1.5 mm)", 1e3 / 1.5, {"kg": 1, "s": -2}),
    ("N/(m**2 K)", 1.0, {"kg": 1, "m": -1, "s": -2, "K": -1}),
    ("\u00b5m/(m\u00b7K)", 1e-6, {"K": -1}),
    ("um / ( m.degC )", 1e-6, {"K": -1}),
    ("W/(m^2 K)", 1.0, {"kg": 1, "s": -3, "K": -1}),
    ("1/degC", 1.0, {"K": -1}),
    ("1e-6/K", 1e-6, {"K": -1}),
    ("10^-6/\u00b0C", 1e-6, {"K": -1}),
    ("K^-1", 1.0, {"K": -1}),
    ("ppm", 1e-6, {}),
    ("rad", 1.0, {}),
    ("deg", math.pi / 180, {}),
    ("\u00b0", math.pi / 180, {}),
    ("arcsec", math.pi / 648000, {}),
    ("kN", 1e3, {"kg": 1, "m": 1, "s": -2}),
    ("N*m", 1.0, {"kg": 1, "m": 2, "s": -2}),
    ("kg m^2/s2", 1.0, {"kg": 1, "m": 2, "s": -2}),
    ("hPa", 100.0, {"kg": 1, "m": -1, "s": -2}),
    ("mbar", 100.0, {"kg": 1, "m": -1, "s": -2}),
    ("mV", 1e-3, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    ("\u03a9", 1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
]


@pytest.mark.parametrize(("text", "size", "bases"), SIZES, ids=[item[0] for item in SIZES])
def test_units_as_people_write_them(text: str, size: float, bases: dict[str, int]) -> None:
    found = unit_exponents(text)
    assert found is not None
    assert 10.0 ** found[SIZE] == pytest.approx(size, rel=1e-12)
    assert {base: value for base, value in found.items() if value and base != SIZE} == bases


@pytest.mark.parametrize(
    "text",
    [
        None,
        "",
        "furlong",
        "Grad",
        "krad",
        "mm (cal.)",
        "um/m*K",
        "1/(m K)^2",
        "1/(m K)\u00b2",
        "C",
        "g",
        "T",
        "0/K",
        "mm^",
        "m" * 100,
    ],
)
def test_units_that_nobody_knows_for_sure(text: str | None) -> None:
    assert unit_exponents(text) is None


def test_a_gram_is_what_it_is_taken_for() -> None:
    assert unit_exponents("g/cm^3", GRAMS[0]) == pytest.approx({"kg": 1, "m": -3, SIZE: 3})
    assert unit_exponents("g", GRAMS[1]) == {"m": 1, "s": -2, SIZE: math.log10(9.80665)}


@pytest.mark.parametrize(
    ("text", "clear"),
    [
        ("um/m*K", "um/(m K)"),
        ("um/m K", "um/(m K)"),
        ("\u00b5m/m\u00b7K", "\u00b5m/(m K)"),
        ("um/(m K)", None),
        ("um/1.5 m", "um/(1.5 m)"),
        ("um/m**2 K", "um/(m**2 K)"),
        ("um/m*K^-1", None),
        ("um/m K\u2212\u00b9", None),
        ("um/m K\u22121", None),
        ("um/m*", None),
        ("um/m/K", None),
        ("um/mK", None),
        ("furlong", None),
        (None, None),
    ],
)
def test_what_stands_under_a_line_is_asked_for(text: str | None, clear: str | None) -> None:
    assert meant(text) == clear


def faults(tmp_path: Path, equation: str, unit: str, inputs: dict[str, str]) -> list[str]:
    lines = [f"  {name}: {{value: 2, u: 0.1, unit: '{text}'}}" for name, text in inputs.items()]
    lines = [line.replace(", unit: ''", "") for line in lines]
    head = f"schema: mtu/budget/1\nname: t\nquantity: {{name: q, unit: '{unit}'}}\n"
    path = tmp_path / "b.yaml"
    path.write_text(f"{head}equation: {equation}\ninputs:\n" + "\n".join(lines) + "\n")
    try:
        load_budget(path)
    except InputError as error:
        return [str(problem).removeprefix("b.yaml:") for problem in error.findings]
    return []


MM = {"h": "mm", "L": "mm"}


@pytest.mark.parametrize(
    ("equation", "unit", "inputs", "told"),
    [
        (
            "asin(h/L)",
            "deg",
            MM,
            "3: quantity.unit: the equation gives rad: 'deg'; expected the equation times "
            "180/pi, or rad here",
        ),
        ("2*atan(h)", "arcsec", {"h": ""}, "3: quantity.unit: the equation gives rad: 'arcsec'"),
        (
            "h + L",
            "mm",
            {"h": "mm", "L": "um"},
            "4: equation: mm and um are added at column 3; expected one unit: what is in um "
            "divided by 1000",
        ),
        (
            "h + L",
            "mm",
            {"h": "inch", "L": "mm"},
            "4: equation: inch and mm are added at column 3; expected one unit: what is in inch "
            "times 25.4",
        ),
        ("h + L", "rad", {"h": "degrees", "L": "rad"}, "degrees and plain numbers are added at"),
        (
            "asin(h/L)",
            "Degrees",
            MM,
            "gives rad: 'Degrees'; expected the equation times",
        ),
        ("h - t", "mm", {"h": "mm", "t": "degC"}, "4: equation: mm and degC are added at column 3"),
        (
            "L*sin(2*phi)",
            "mm",
            {"L": "mm", "phi": "deg"},
            "4: equation: sin of numbers in deg at column 7: '2*phi'; expected a plain number, or "
            "an angle in rad: what is inside times pi/180",
        ),
        ("log(h)", "1", {"h": "mm"}, "4: equation: log of numbers in mm at column 5: 'h'"),
        ("2**h", "1", {"h": "mm"}, "4: equation: an exponent in mm at column 4: 'h'"),
        ("atan2(h, L)", "rad", {"h": "mm", "L": "um"}, "4: equation: mm and um are compared"),
        (
            "a*L*t",
            "um",
            {"a": "um/m/K", "L": "mm", "t": "degC"},
            "'um'; expected the equation divided",
        ),
        ("V/I", "ohm", {"V": "V", "I": "mA"}, "gives kohm: 'ohm'; expected the equation times"),
        (
            "phi*L",
            "um",
            {"phi": "arcsec", "L": "mm"},
            "the equation gives arcsec*mm: 'um'; expected the equation times "
            "0.00484814, or arcsec*mm here",
        ),
        (
            "phi*L + h",
            "um",
            {"phi": "deg", "L": "mm", "h": "um"},
            "deg*mm and um are added at column 7; expected one unit: what is in deg*mm times "
            "17.4533",
        ),
        ("phi*L*t", "um", {"phi": "arcsec/K", "L": "mm", "t": "K"}, "gives mm*arcsec: 'um'"),
        ("h*L**2/t", "mm", {"h": "deg", "L": "in", "t": "min"}, "gives units of 1.87669e-07 m^2 s"),
        ("h*L/t", "mm", {"h": "deg", "L": "in", "t": "min"}, "gives deg*in/min: 'mm'; expected"),
        ("atan(h)/2 + L", "rad", {"h": "1", "L": "arcsec"}, "rad and arcsec are added"),
        ("h*L", "mm", MM, "the equation gives mm^2: 'mm'; expected an equation that gives t"),
        # What a literal is taken off keeps its unit.
        (
            "(h - L)*a*(t - 20)",
            "mm",
            MM | {"a": "1/K", "t": "mm"},
            "3: quantity.unit: the equation gives units of 1e-06 m^2 K^-1: 'mm'",
        ),
        (
            "(h - L)*a*(t - 20)",
            "mm",
            MM | {"a": "um", "t": "K"},
            "the equation gives mm*um*K: 'mm'",
        ),
        ("L*(1 + a*(t - 20))", "mm", {"L": "mm", "a": "1", "t": "K"}, "gives mm*K: 'mm'; expected"),
        ("h + L*a*(t - 20)", "mm", MM | {"a": "1", "t": "K"}, "mm and mm*K are added at column 3"),
        (
            "m*g*L*(1 - a/b)",
            "N*m",
            {"m": "kg", "g": "m/s^2", "L": "mm", "a": "kg/m^3", "b": "kg/m^3"},
            "3: quantity.unit: the equation gives N*mm: 'N*m'; expected the equation divided by "
            "1000, or inputs in m instead of mm, or N*mm here",
        ),
        (
            "F/(b*h)",
            "kN/m\u00b2",
            {"F": "N", "b": "mm", "h": "mm"},
            "gives MPa: 'kN/m\u00b2'; expected the equation times 1000, or MPa here",
        ),
        # 1 + 12 ppm is no 1.000012, and no other unit of the result mends that.
        *(
            (
                equation,
                unit,
                {"L": "mm", "h": "mm", "a": ratio, "t": "K"},
                f"the plain number 1 and {told} are added at column {column}: '{term}'; expected "
                f"plain numbers: what is in {told} divided by {by}",
            )
            for equation, unit, ratio, told, column, term, by in (
                ("L*(1 + a*t)", "mm", "ppm/K", "ppm", 8, "a*t", 1000000),
                ("L*(1 + a*t)", "nm", "um/m/K", "ppm", 8, "a*t", 1000000),
                ("L*(a*t - 1)", "mm", "um/m/K", "ppm", 4, "a*t", 1000000),
                ("L*sqrt(1 - 2*a) + h", "mm", "%", "%", 12, "2*a", 100),
                ("L*(1 + a)", "m", "mm/m", "mm/m", 8, "a", 1000),
                ("-1 + 2*a", "1", "%", "%", 6, "2*a", 100),
                ("L*(a - 1) + h", "mm", "ppm", "ppm", 4, "a", 1000000),
                ("L*(1 - a**2/2)", "mm", "mrad", "ppm", 8, "a**2/2", 1000000),
            )
        ),
    ],
)
def test_what_disagrees_is_refused(
    tmp_path: Path, equation: str, unit: str, inputs: dict[str, str], told: str
) -> None:
    (found,) = faults(tmp_path, equation, unit, inputs)
    assert told in found


@pytest.mark.parametrize(
    ("equation", "unit", "inputs"),
    [
        ("asin(h/L)*180/pi", "deg", MM),
        ("180/pi*2*asin(h/L)", "deg", MM),
        ("asin(h/L)", "rad", MM),
        ("L*sin(phi*pi/180)", "mm", {"L": "mm", "phi": "deg"}),
        ("h + L/1000", "mm", {"h": "mm", "L": "um"}),
        ("1000*V/I", "ohm", {"V": "V", "I": "mA"}),
        ("L*(1 + a*(t - 20))", "mm", {"L": "mm", "a": "1/K", "t": "degC"}),
        ("L*(1 + a*t/1000000)", "mm", {"L": "mm", "a": "um/m/K", "t": "K"}),
        ("L*(1 + a/100)", "mm", {"L": "mm", "a": "%"}),
        ("100*(1 + a)", "%", {"a": "1"}),
        # 1 deg, 1 mrad, 1 % and 99 %: whatever they are, they are no 100 %.
        ("a - 1", "deg", {"a": "deg"}),
        ("2*(a - 1)", "deg", {"a": "deg"}),
        ("2*(1 + a)", "arcsec", {"a": "arcsec"}),
        ("a - 1", "%", {"a": "%"}),
        ("abs(h - a - 1)", "%", {"a": "%", "h": "%"}),
        ("-(1 + a)", "ppm", {"a": "ppm"}),
        ("(a - 1)*L", "um", {"a": "um/m", "L": "m"}),
        ("(a - 1)*L", None, {"a": "um/m", "L": "m"}),
        ("1 + a", "mrad", {"a": "mrad"}),
        ("L*(1 - a)", "um", {"L": "mm", "a": "mrad"}),
        ("100 - a", "%", {"a": "%"}),
        ("(h - L)*a*(t - 20)", "nm", MM | {"a": "um/(m K)", "t": "degC"}),
        ("(h - L)*(a - 11.5/1000000)*(t - 20)", "mm", MM | {"a": "1/degC", "t": "degC"}),
        ("L/(1 + a*(t - 20)) + 0.003", "mm", {"L": "mm", "a": "1/K", "t": "degC"}),
        ("(h/L - 1)/a", "degC", {"h": "ohm", "L": "ohm", "a": "1/degC"}),
        ("log(t + 273.15)", "1", {"t": "degC"}),
        ("t + 273.15", "K", {"t": "degC"}),
        ("(1 - h**2)/L", "1/GPa", {"h": "1", "L": "GPa"}),
        ("sqrt(h**2 + L**2)", "mm", MM),
        ("pi*h**2/4", "mm^2", MM | {"h": "mm"}),
        # Empirical equations, whose literals have units: CIPM air density, vapour pressure.
        ("(0.34848*p - 0.009*h)/(273.15 + t)", "kg/m3", {"p": "hPa", "h": "%", "t": "degC"}),
        ("exp(34.04 - 6292/T)", "Pa", {"T": "K"}),
        ("12*t", "um", {"t": "degC"}),
        # Nobody knows what is not stated.
        ("h + L", "mm", {"h": "mm", "L": ""}),
        ("h + L", "mm", {"h": "mm", "L": "digits"}),
        ("h + L", "inch", {"h": "inch", "L": "in"}),
        ("h + 12*L", "in", {"h": "in", "L": "ft"}),
        ("h + 0.9*L", "deg", {"h": "deg", "L": "gon"}),
        ("h + L", "length", MM),
        # Half of a result in %, or twice.
        ("(1 + h)/2", "%", {"h": "%"}),
        ("2*(1 - h)", "%", {"h": "%"}),
        ("1 + h", "", {"h": "%"}),
        ("-(1 + h)", "%", {"h": "%"}),
        ("abs(h - 1)", "%", {"h": "%"}),
        # The share is from 1 um/m on.
        ("(h - 1)*L", "um", {"h": "um/m", "L": "m"}),
    ],
)
def test_what_may_be_right_passes(
    tmp_path: Path, equation: str, unit: str, inputs: dict[str, str]
) -> None:
    used = {name: text for name, text in inputs.items() if name in equation}
    assert faults(tmp_path, equation, unit, used) == []


G_MM = {"m": "g", "v": "mm^3"}


@pytest.mark.parametrize(
    ("equation", "unit", "inputs", "told"),
    [
        ("m/v", "g/cm^3", G_MM, "'g/cm^3'; expected the equation times 1000, or g/mm^3"),
        ("4*m/(pi*v)", "g/cm^3", G_MM, "expected the equation times 1000, or g/mm^3"),
        ("m/v", "kg", G_MM, "the equation gives g/mm^3: 'kg'"),
        ("m + b", "g", {"m": "g", "b": "mg"}, "g and mg are added"),
        ("m/v", "g/mm^3", G_MM, None),
        ("1000*m/v", "g/cm^3", G_MM, None),
        ("m/v", "g/mL", {"m": "g", "v": "L"}, "equation divided by 1000, or kg/m^3 here"),
        # A g may be the acceleration of free fall as well: what is right for either is right.
        ("a*b", "m/s^2", {"a": "g", "b": "m/s^2/g"}, None),
        ("m*a", "N", {"m": "kg", "a": "g"}, "the equation"),
        ("m*a", "N", {"m": "kg", "a": "m/s^2"}, None),
        # Beside a density it is the gram, of air that lifts a weight.
        (
            "m*a*(1 - b/v)",
            "N",
            {"m": "kg", "a": "m/s^2", "b": "kg/m^3", "v": "g/cm^3"},
            "1 and units of 0.001 are added at column 10: 'b/v'; expected plain numbers: what is "
            "in units of 0.001 divided by 1000",
        ),
        ("m*a*(1 - b/v)", "N", {"m": "kg", "a": "m/s^2", "b": "g/cm3", "v": "g / cm^3"}, None),
        ("m/v", "kg", {"m": "g", "v": "g/cm\u00b3"}, "gives units of 1e-06 m^3"),
        (
            "m*a",
            "N",
            {"m": "mg", "a": "m/s^2"},
            "units of 1e-06 N: 'N'; expected the equation divided by 1000000",
        ),
    ],
)
def test_grams(
    equation: str, unit: str, inputs: dict[str, str], told: str | None, tmp_path: Path
) -> None:
    found = faults(tmp_path, equation, unit, inputs)
    if told is None:
        assert found == []
    else:
        assert len(found) == 1
        assert told in found[0]


@pytest.mark.parametrize(
    ("equation", "unit", "inputs", "told"),
    [
        # A 1 behind a minus is none of the faults of others.
        ("(s - 1)*L + h", "um", {"s": "um/m", "L": "m", "h": "mm"}, "um and mm are added"),
        ("L*(1 + a) + (s - 1)*L", "um", {"s": "um/m", "L": "m", "a": "%"}, "1 and % are added"),
        # A sum is the same the other way round.
        ("L*(a + 1)", "", {"L": "m", "a": "mm/m"}, "1 and mm/m are added"),
        ("a/(a + 1)", "1", {"a": "mm/m"}, "1 and mm/m are added"),
        ("-(1 + h)", "1", {"h": "%"}, "1 and % are added"),
        ("abs(1 + h)", "1", {"h": "%"}, "1 and % are added"),
        ("sqrt(1 + h)", "1", {"h": "%"}, "1 and % are added"),
        # Behind a minus it is told where nothing else is wrong.
        ("L*(s - 1)", "m", {"L": "m", "s": "%"}, "1 and % are added"),
        ("L*(1 - a**2/2)", "mm", {"L": "mm", "a": "arcsec"}, "1 and arcsec*arcsec are added"),
        # Beside an angle a 1 may be 1 mrad, but for a factor without which nothing is wrong.
        ("L*(1 - a)", "mm", {"L": "mm", "a": "mrad"}, "'a'; expected plain numbers: what is in"),
        ("h + L*(1 + a)", "mm", {"h": "mm", "L": "mm", "a": "mrad"}, "1 and mrad are added"),
    ],
)
def test_the_one_that_is_wrong_is_told_alone(
    tmp_path: Path, equation: str, unit: str, inputs: dict[str, str], told: str
) -> None:
    (found,) = faults(tmp_path, equation, unit, inputs)
    assert told in found


@pytest.mark.parametrize("equation", ["L*(s - 1) + M*(r - 1)", "L*(s - 1)*(r - 1)"])
def test_ones_behind_a_minus_are_told_where_all_of_them_are_wrong(
    tmp_path: Path, equation: str
) -> None:
    used = {"L": "mm", "M": "mm", "s": "%", "r": "%"}
    found = faults(tmp_path, equation, "mm", {k: v for k, v in used.items() if k in equation})
    assert len(found) == 2
    assert all("1 and % are added" in text for text in found)


def test_a_one_that_is_right_hides_no_other(tmp_path: Path) -> None:
    """t is from 1 % on, and cancels with c; the 1 behind a is a plain number."""
    used = {"L": "mm", "a": "ppm", "c": "1/%", "t": "%", "h": "mm"}
    (found,) = faults(tmp_path, "L*(a - 1) + L*c*(t - 1) + h", "mm", used)
    assert "1 and ppm are added" in found


def test_the_fewest_ones_that_mend_an_equation_are_told(tmp_path: Path) -> None:
    """Two of three are wrong."""
    used = {"L": "mm", "a": "ppm", "b": "%", "c": "1/%", "t": "%", "h": "mm"}
    found = faults(tmp_path, "L*(a - 1) + L*(b - 1) + L*c*(t - 1) + h", "mm", used)
    assert len(found) == 2
    assert "1 and ppm are added at column 4: 'a'" in found[0]
    assert "1 and % are added at column 16: 'b'" in found[1]


@pytest.mark.parametrize(
    ("equation", "unit", "told"),
    [
        ("L*c*(b - 1)*(t - 1) + h", "mm", "'b - 1' or 't - 1' at column 6"),
        ("(b - 1)*(t - 1)", "%", "'b - 1' or 't - 1' at column 2"),
    ],
)
def test_one_of_two_ones_is_told_as_one(
    tmp_path: Path, equation: str, unit: str, told: str
) -> None:
    """Either is wrong, and who mended both would have it wrong again."""
    used = {"L": "mm", "b": "%", "c": "1/%", "t": "%", "h": "mm"}
    own = {name: text for name, text in used.items() if name in equation}
    (found,) = faults(tmp_path, equation, unit, own)
    assert f"the plain number 1 and % are added in {told}; expected plain numbers in one" in found


def test_many_ones_do_not_take_long(tmp_path: Path) -> None:
    """Thirty of them have a thousand million ways, of which all at once is one."""
    used = {f"s{i}": "%" for i in range(30)} | {"L": "mm"}
    equation = "L*(" + " + ".join(f"(s{i} - 1)" for i in range(30)) + ")"
    found = faults(tmp_path, equation, "mm", used)
    assert len(found) == 30


def test_ones_of_a_product_are_told_each(tmp_path: Path) -> None:
    """The 1 that is taken from it has nothing wrong but them."""
    found = faults(tmp_path, "(1 + a)*(1 + b) - 1", "1", {"a": "%", "b": "%"})
    assert len(found) == 2
    assert all("1 and % are added" in text for text in found)


def test_units_of_several_outputs(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(
        "schema: mtu/budget/1\nname: t\nunits: {s: mm, a: deg}\n"
        "equations: {s: h + L, a: atan(h/L)}\n"
        "inputs:\n  h: {value: 1, u: 0.1, unit: mm}\n  L: {value: 9, u: 0.1, unit: mm}\n"
    )
    with pytest.raises(InputError) as caught:
        load_budget(path)
    assert str(caught.value) == (
        "b.yaml:3: units.a: the equation gives rad: 'deg'; expected the equation times "
        "180/pi, or rad here"
    )


@pytest.mark.parametrize(
    ("t", "al", "refused"),
    [("degF", "1/K", True), ("\u00b0F", "1/degC", True), ("Fahrenheit", "ppm/K", True),
     ("degF", "1/degF", False), ("F", "1/K", False), ("degC", "1/K", False)],
)  # fmt: skip
def test_fahrenheit_beside_kelvin_is_refused(
    t: str, al: str, refused: bool, tmp_path: Path
) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(
        "schema: mtu/budget/1\nname: b\nequation: al*(t - 20)\ninputs:\n"
        f"  al: {{value: 1e-5, u: 1e-6, unit: {al}}}\n  t: {{value: 72.5, u: 0.1, unit: {t}}}\n",
        "utf-8",
    )
    if not refused:
        load_budget(path)
        return
    words = r":6: inputs.t.unit: degF beside degC or K.*divided by 1\.8"
    with pytest.raises(InputError, match=words):
        load_budget(path)
    # An equation that converts it is what the message asks for.
    text = path.read_text("utf-8")
    for good in ("((t - 32)*5/9 - 20)", "((t - 32)/1.8 - 20)", "(0.5556*(t - 32) - 20)",
                 "(((t + t)/2 - 32)*0.556 - 20)", "(0.5556*t - 37.78)", "(t - 68)/1.8",
                 "5/9*(t - 68)", "(t/9*5 - 37.78)"):  # fmt: skip
        path.write_text(text.replace("(t - 20)", good), "utf-8")
        load_budget(path)
    # A length of 32 mm converts nothing.
    for bad in ("32*al*(t - 20)", "32 + al*(t - 20)", "1.8*al*(t - 20)", "9*al*(t - 20)/5",
                "5*9*al*(t - 20)", "1.8 + al*(t - 20)", "al*(t - 20) - 32*al"):  # fmt: skip
        path.write_text(text.replace("al*(t - 20)", bad), "utf-8")
        with pytest.raises(InputError, match=r"inputs.t.unit: degF beside degC or K"):
            load_budget(path)


@pytest.mark.parametrize(
    ("unit", "meant_unit"),
    [
        ("mmm", "mm"),
        ("milimeter", "millimeter"),
        ("arcsecnd", "arcsecond"),
        ("Ohm", None),
        ("mph", None),
        ("mmHg", None),
        ("newtonmeter", None),
        ("digits", None),
        ("rpm", None),
        ("degF", None),
        ("millimeter", None),
        ("lux", None),
    ],
)
def test_a_unit_that_is_another_but_for_a_slip_is_told(
    tmp_path: Path, unit: str, meant_unit: str | None
) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(
        "schema: mtu/budget/1\nname: t\nequation: a - b\ninputs:\n"
        f"  a: {{value: 3, u: 1, unit: {unit}}}\n  b: {{value: 2, u: 1, unit: {unit}}}\n"
    )
    found = [own.message for own in load_budget(path).warnings if own.code == "unit-unclear"]
    assert len(found) == (2 if meant_unit else 0)
    assert all(f"{unit!r} is not read" in text and f"is {meant_unit} meant?" in text
               for text in found)  # fmt: skip


def test_units_may_be_words() -> None:
    for word, symbol in (("Millimeter", "mm"), ("micrometres", "um"), ("Pascal", "Pa")):
        assert unit_exponents(word, GRAMS[0]) == unit_exponents(symbol, GRAMS[0])
