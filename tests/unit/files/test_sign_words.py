"""Directions as readings and points may write them."""

from __future__ import annotations

import pytest

from mtu_cli.files.sign_words import direction_hint, direction_sign

FORWARD = ("forward", " Forward ", "+", "1", "+1", "1.0", "1,0", "01", "1.00")
REVERSE = ("reverse", "-", "-1", "-1.0", "-01", "\u22121", "-1e0")
NEITHER = ("", "0", "2", "-10", "1_", "nan", "inf", "forwards", "1 1", "--")


@pytest.mark.parametrize(
    ("label", "sign"), [*((own, 1) for own in FORWARD), *((own, -1) for own in REVERSE)]
)
def test_a_direction_is_a_word_a_sign_or_a_number_by_its_value(label: str, sign: int) -> None:
    """As the quick reader of large files takes a column of numbers."""
    assert direction_sign(label) == sign
    assert direction_hint(label) is None


@pytest.mark.parametrize("label", NEITHER)
def test_what_is_no_direction(label: str) -> None:
    assert direction_sign(label) is None
    assert direction_hint(label)
