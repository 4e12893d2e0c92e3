"""Simulated drift tests by seed, and what `thermal-fit` makes of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from made_tables import made_readings
from numpy.typing import NDArray

from mtu_cli.analyses.thermal_fit import METHODS, thermal_fit
from mtu_cli.analyses.thermal_fit.result import ThermalFit
from mtu_cli.files.readings import Readings

Floats = NDArray[np.float64]

STEP_MIN = 5.0
NAMES = ("T_a_degC", "T_b_degC", "T_c_degC")


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of drift test: sensors a and b correlate at `r`; `memory` of noise of share `slow`;
    `lag_min` of the sensors (one of them in each set); `zeroed` in every cycle.
    """

    r: float = 0.8
    cycles: int = 5
    n: int = 40
    noise_um: float = 0.3
    memory: float = 0.0
    slow: float = 0.0
    lag_min: float = 0.0
    zeroed: bool = False


KINDS = {
    "zeroed": Kind(zeroed=True),
    "zeroed, memory": Kind(zeroed=True, memory=0.9, slow=0.6),
    "r 0.95": Kind(r=0.95),
    "r 0.99": Kind(r=0.99),
    "r 0.999": Kind(r=0.9985),
    "lags": Kind(lag_min=45.0),
    "memory": Kind(memory=0.9, slow=0.6),
    "memory, r 0.95": Kind(r=0.95, memory=0.9, slow=0.6),
    "memory, twelve cycles": Kind(r=0.9, memory=0.95, slow=0.8, cycles=12),
}


def _remembering(rng: np.random.Generator, n: int, memory: float) -> Floats:
    """(n,) of variance 1, stationary, each value `memory` times the last and a new part."""
    found: Floats = rng.standard_normal(n)
    for i in range(1, n):
        found[i] = memory * found[i - 1] + np.sqrt(1 - memory**2) * found[i]
    return found


def _lagged(signal: Floats, lag: float) -> Floats:
    """tau du/dt = T - u, T linear between the readings."""
    found = signal.copy()
    decay = np.exp(-STEP_MIN / lag)
    for i in range(1, len(signal)):
        slope = (signal[i] - signal[i - 1]) / STEP_MIN
        found[i] = signal[i] - slope * lag + (found[i - 1] - signal[i - 1] + slope * lag) * decay
    return found


def drift_test(rng: np.random.Generator, kind: Kind) -> tuple[Readings, Floats]:
    """A drift test and its true gradients (3,) in um per degC."""
    truth = rng.normal(0, 2, 3)
    lags = np.zeros(3)
    if kind.lag_min:
        lags[rng.integers(3)] = kind.lag_min * rng.uniform(0.6, 1.6)
    T, y, cycle = [], [], []
    for c in range(kind.cycles):
        t = STEP_MIN * np.arange(kind.n)
        room = rng.uniform(4, 8) * (1 - np.exp(-t / 30.0))
        room = room if c % 2 == 0 else room[-1] - room
        a = room + 0.8 * _remembering(rng, kind.n, 0.9)
        b = a + float(np.std(a)) * np.sqrt(1 / kind.r**2 - 1) * _remembering(rng, kind.n, 0.9)
        slow = np.exp(-t / 120.0) if c % 2 else 1 - np.exp(-t / 120.0)
        own = np.column_stack([a, b, 5 * slow + 0.8 * _remembering(rng, kind.n, 0.9)])
        own += rng.normal(0, 1.0)
        seen = np.column_stack(
            [_lagged(x, lag) if lag else x for x, lag in zip(own.T, lags, strict=True)]
        )
        noise = np.sqrt(kind.slow) * _remembering(rng, kind.n, kind.memory)
        noise += np.sqrt(1 - kind.slow) * rng.standard_normal(kind.n)
        T.append(20 + own + 0.01 * rng.standard_normal(own.shape))
        y.append(seen @ truth + kind.noise_um * noise)
        cycle += [c] * kind.n
    number = np.array(cycle)
    readings = made_readings(
        1e-3 * np.concatenate(y), ("d",), cycle=number, role="drift",
        time=STEP_MIN * np.arange(len(cycle)) + 1440.0 * number,
        covariates=dict(zip(NAMES, np.vstack(T).T, strict=True)),
    )  # fmt: skip
    return readings, truth


def zeroed(readings: Readings) -> Readings:
    """The same with the probe set to 0 at the first reading of every cycle."""
    _, first, which = np.unique(readings.cycle, return_index=True, return_inverse=True)
    return replace(readings, error=readings.error - readings.error[first][which])


def fitted(readings: Readings, method: str = "auto") -> ThermalFit:
    """As the command fits it."""
    return thermal_fit(readings, {"d": (None, "um")}, reference=20.0, method=method)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Of one set: `covered` by separable gradient, whether some are inseparable, held-out rms over
    that of the unzeroed test and over the best single model's, whether cycles have offsets.
    """

    covered: tuple[bool, ...]
    inseparable: bool
    to_unzeroed: float
    to_single: float
    offsets: bool


def seen(rng: np.random.Generator, kind: Kind) -> Seen:
    """One set, fitted."""
    readings, truth = drift_test(rng, kind)
    free = fitted(readings).components["d"] if kind.zeroed else None
    given = zeroed(readings) if kind.zeroed else readings
    item = fitted(given).components["d"]
    assert item.held_out is not None
    by_name = dict(zip(NAMES, 1e-3 * truth, strict=True))
    together = {sensor for group in item.inseparable for sensor in group.sensors}
    singles = [fitted(given, each).components["d"].held_out for each in METHODS[1:]]
    least = min(each.after for each in singles if each is not None)
    after = item.held_out.after
    return Seen(
        covered=tuple(
            bool(own.interval[0] <= by_name[own.sensors[0]] <= own.interval[1])
            for own in item.gradients
            if own.sensors[0] not in together and own.interval is not None
        ),
        inseparable=bool(item.inseparable),
        to_unzeroed=after / free.held_out.after if free and free.held_out else float("nan"),
        to_single=after / least,
        offsets=item.offsets,
    )


def row(kind: Kind, sets: int, seed: int) -> dict[str, float]:
    """The means of what `sets` drift tests of a kind come to, and the number of `gradients`."""
    found = [seen(rng, kind) for rng in np.random.default_rng(seed).spawn(sets)]
    covered = [x for each in found for x in each.covered]
    shares = {"gradients": len(covered), "coverage": float(np.mean(covered)) if covered else np.nan}
    names = ("inseparable", "to_unzeroed", "to_single", "offsets")
    return shares | {name: float(np.mean([getattr(x, name) for x in found])) for name in names}
