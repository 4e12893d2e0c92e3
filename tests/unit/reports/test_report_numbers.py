"""Rounding to the uncertainty: cases worked by hand (JCGM 100, 7.2.6)."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtu_cli.reports import numbers


@pytest.mark.parametrize(
    ("value", "u", "shown"),
    [
        (100.021471, 0.00035, ("100.02147", "0.00035")),
        (0.04, 8.06, ("0.0", "8.1")),
        (5.0, 0.0996, ("5.00", "0.10")),
        (-49.0, 1234.0, ("0", "1200")),
        (3.4e-9, 1.2e-10, ("3.40e-9", "0.12e-9")),
        (0.0, 1.2e-10, ("0", "1.2e-10")),
        (1.5, 0.0, ("1.5", "0")),
        (-0.0, 0.0, ("0", "0")),
        (1.23456789, None, ("1.23457", "-")),
        (1.5, nan, ("1.5", "-")),
        (1.5, inf, ("1.5", "-")),
        (nan, 0.123, ("-", "0.12")),
        (None, None, ("-", "-")),
    ],
)
def test_value_follows_its_uncertainty(
    value: float | None, u: float | None, shown: tuple[str, str]
) -> None:
    assert numbers.with_u(value, u) == shown


@given(
    st.floats(-1e9, 1e9, allow_subnormal=False),
    st.floats(1e-9, 1e9, allow_subnormal=False),
    st.integers(1, 3),
)
def test_rounding_is_within_half_a_digit_of_u(value: float, u: float, digits: int) -> None:
    first, second = numbers.with_u(value, u, digits)
    last = 10.0 ** (int(f"{u:.{digits - 1}e}".partition("e")[2]) - digits + 1)
    assert abs(float(first) - value) <= 0.5 * last * (1 + 1e-6) + 1e-12 * abs(value)
    assert abs(float(second) - u) <= 0.5 * last * (1 + 1e-6)
    assert not (float(first) == 0 and first.startswith("-"))


def test_p_values_and_percents_never_claim_certainty() -> None:
    shown = {0.0214: "0.021", 0.0: "<0.001", 0.09961: "0.10", 1.0: "1.00", None: "-"}
    assert {p: numbers.p_value(p) for p in shown} == shown
    shown = {0.9973: "99.73", 0.512: "51.2", 0.004: "0.40", 1.0: ">99.99", 1e-9: "<0.01"}
    assert {p: numbers.percent(p) for p in shown} == shown
    assert numbers.percent(nan) == numbers.p_value(nan) == "-"


@pytest.mark.parametrize(
    ("p", "se", "shown"),
    [
        (0.9723, 0.0026, "97.2 ± 0.3"), (0.0031, 0.0009, "0.31 ± 0.09"), (0.999995, 7e-6, ">99.99"),
        (1.0, 0.0099, ">97.0"), (0.0, 5e-6, "<0.01"), (0.0, 0.0099, "<3.0"), (0.512, 0.0, "51.2"),
    ],
)  # fmt: skip
def test_a_chance_with_its_error_stays_within_certainty(p: float, se: float, shown: str) -> None:
    assert numbers.chance(p, se) == shown


def test_intervals_and_degrees_of_freedom() -> None:
    assert numbers.interval(-16.46, 15.78, 8.06) == "[-16.5, 15.8]"
    assert numbers.interval(-0.01, inf, 8.06) == "-"
    assert numbers.plus_minus(-0.34, 8.06) == "-0.3 ± 8.1"
    assert numbers.plus_minus(-0.34, None) == "-0.34"
    shown = [numbers.degrees_of_freedom(dof) for dof in (4.05, 9.0, 123.4, 3e8, inf)]
    assert shown == ["4.0", "9", "123", ">999", "inf"]
    assert (numbers.span("0.58", "2.6"), numbers.span("2.0", "2.0")) == ("0.58 to 2.6", "2.0")


def test_significant_digits() -> None:
    shown = [numbers.significant(value) for value in (0.0, 0.0996, 14.46, 1234.0, 1.23e-7, nan)]
    assert shown == ["0", "0.10", "14", "1200", "1.2e-7", "-"]


def test_fixed_decimals_have_no_sign_on_zero() -> None:
    assert numbers.fixed(-1e-9, 4) == "0.0000"
    assert numbers.fixed(-0.4, 0) == "0"
    assert numbers.fixed(-0.00006, 4) == "-0.0001"
    assert numbers.fixed(float("nan"), 4) == numbers.fixed(None, 1) == "-"
