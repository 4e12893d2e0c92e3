"""What a message advises about units is right: whoever follows it gets the right number."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget
from mtu_cli.language import evaluate

VALUES = {"h": 10.0, "L": 100.0, "a": 0.25, "s": 101.0}


def text(equation: str, unit: str, inputs: dict[str, str]) -> str:
    lines = (
        f"  {name}: {{value: {VALUES[name]}, u: 0.1, unit: '{own}'}}\n"
        for name, own in inputs.items()
    )
    head = f"schema: mtu/budget/1\nname: t\nquantity: {{name: y, unit: '{unit}'}}\n"
    return f"{head}equation: {equation}\ninputs:\n{''.join(lines)}"


ANGLE = math.atan(0.1)
MM = {"h": "mm", "L": "mm"}


@pytest.mark.parametrize(
    ("equation", "unit", "inputs", "advice", "followed", "result"),
    [
        (
            "atan(h/L) + a", "deg", MM | {"a": "deg"},
            "rad and deg are added at column 11; expected one unit: what is in rad times 180/pi",
            "atan(h/L)*180/pi + a", math.degrees(ANGLE) + 0.25,
        ),
        (
            "atan(h/L) + a", "rad", MM | {"a": "deg"},
            "rad and deg are added at column 11; expected one unit: what is in deg times pi/180",
            "atan(h/L) + a*pi/180", ANGLE + math.radians(0.25),
        ),
        (
            "atan2(h, L) - a", "arcmin", MM | {"a": "arcmin"},
            "one unit: what is in rad times 10800/pi",
            "atan2(h, L)*10800/pi - a", math.degrees(ANGLE) * 60 - 0.25,
        ),
        # Nobody knows what a*60 is: it is in arcsec here.
        (
            "atan(h/L) - a*60", "arcsec", MM | {"a": "arcmin"},
            "the equation gives rad: 'arcsec'; expected atan(h/L) times 648000/pi, or rad here",
            "atan(h/L)*648000/pi - a*60", math.degrees(ANGLE) * 3600 - 0.25 * 60,
        ),
        (
            "h + L", "um", {"h": "mm", "L": "um"},
            "mm and um are added at column 3; expected one unit: what is in mm times 1000",
            "h*1000 + L", 10100.0,
        ),
        (
            "h + L", "mm", {"h": "mm", "L": "um"},
            "mm and um are added at column 3; expected one unit: what is in um divided by 1000",
            "h + L/1000", 10.1,
        ),
    ],
)  # fmt: skip
def test_advice_leads_to_the_number_that_is_meant(
    tmp_path: Path,
    equation: str,
    unit: str,
    inputs: dict[str, str],
    advice: str,
    followed: str,
    result: float,
) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(text(equation, unit, inputs))
    with pytest.raises(InputError) as caught:
        load_budget(path)
    (problem,) = caught.value.findings
    assert advice in str(problem)
    path.write_text(text(followed, unit, inputs))
    loaded = load_budget(path)
    assert loaded.warnings == ()
    assert float(evaluate(loaded.trees["y"], VALUES)) == pytest.approx(result, rel=1e-12)


@pytest.mark.parametrize(
    ("equation", "unit", "own", "what"),
    [
        ("s - 1", "%", "%", "in 's - 1' the 1 is taken for 1 %; if a plain number is meant, what "
         "is in % divided by 100"),
        ("L*(s - 1)", "mm*%", "%", "in 's - 1' the 1 is taken for 1 %; if a plain number is meant"),
        ("1 + s", "ppm", "ppm", "in '1 + s' the 1 is taken for 1 ppm; if a plain number is meant, "
         "what is in ppm divided by 1000000"),
        ("s - 1", "deg", "deg", None),
        ("s/100 - 1", "1", "%", None),
        ("s - 1", "1", "1", None),
        ("100 - s", "%", "%", None),
    ],
)  # fmt: skip
def test_a_one_that_may_be_meant_as_a_plain_number_is_told(
    tmp_path: Path, equation: str, unit: str, own: str, what: str | None
) -> None:
    path = tmp_path / "b.yaml"
    inputs = {"s": own} | ({"L": "mm"} if "L" in equation else {})
    path.write_text(text(equation, unit, inputs))
    found = load_budget(path).warnings
    assert [item.code for item in found] == (["one-in-unit"] if what else [])
    assert all(f"b.yaml:4: equation: {what}" in item.message for item in found)


def test_ones_of_several_outputs_are_told_at_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    path.write_text(
        "schema: mtu/budget/1\nname: t\nunits: {p: '%', q: '%'}\nequations:\n  p: 2*s\n"
        "  q: s - 1\ninputs:\n  s: {value: 1, u: 1, unit: '%'}\n"
    )
    (notice,) = load_budget(path).warnings
    assert notice.message.startswith("b.yaml:6: equations.q: in 's - 1' the 1 is taken for 1 %")
