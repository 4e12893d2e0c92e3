"""Derivatives by what is searched, against those of a sine."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.close_loop_sealed.model.effect_candidate import Column
from mtu_cli.close_loop_sealed.model.effect_slopes import slopes

X = np.linspace(0.0, 600.0, 41)[None]


def waves(pitch: np.ndarray) -> tuple[Column, ...]:
    angle = 2 * np.pi * X / pitch[:, None, None]
    return {0: np.sin(angle)}, {0: np.cos(angle)}


@pytest.mark.parametrize("twice", [False, True])
def test_of_a_wave_by_the_logarithm_of_its_pitch(twice: bool) -> None:
    """With a = 2 pi x/p, da/d log p = -a: of sin a that is -a cos a, then a cos a - a^2 sin a."""
    pitch = np.array([150.0, 20.0, 2.5])
    a = 2 * np.pi * X / pitch[:, None, None]
    first = (-a * np.cos(a), a * np.sin(a))
    second = (a * np.cos(a) - a**2 * np.sin(a), -a * np.sin(a) - a**2 * np.cos(a))
    found = slopes(waves, pitch, twice=twice)
    wanted = first + second if twice else first
    assert len(found) == len(wanted)
    for n, (own, exact) in enumerate(zip(found, wanted, strict=True)):
        # A step h is off by a^2 h^2/6 of the size of the first, a^2 h^2/12 of the second.
        off = (a.max() * 1e-5) ** 2 / 6 if n < 2 else (a.max() * 1e-4) ** 2 / 12
        assert np.abs(own[0] - exact).max() <= 1.1 * off * np.abs(exact).max()
