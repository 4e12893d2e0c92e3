"""The settings of a call: options over the study over defaults."""

from __future__ import annotations

from typing import Any

from mtu_cli.cli.inputs import Inputs
from mtu_cli.errors import InputError, Problem
from mtu_cli.files.study import (
    MAX_COVERAGE,
    MAX_DIGITS,
    MAX_THREADS,
    MAX_TRIALS,
    MIN_TRIALS,
)
from mtu_cli.model.settings import DEFAULT_SEED, Settings
from mtu_cli.stats.monte_carlo import Progress


def read_settings(inputs: Inputs, progress: Progress | None) -> Settings:
    """Raises InputError for every setting that is out of range, at once."""
    options = inputs.options
    study = inputs.study.study.settings if inputs.study else None

    def chosen(option: str, key: str, default: Any) -> Any:
        given = options.values.get(option)
        if given is None and study is not None:
            given = getattr(study, key)
        return default if given is None else given

    k = chosen("k", "coverage_factor", 2.0)
    digits = chosen("digits", "digits", 2)
    seed = chosen("seed", "seed", DEFAULT_SEED)
    correlation = chosen("correlation", "correlation", "shared")
    trials = chosen("trials", "trials", None)
    threads = chosen("threads", "threads", None)
    checks = [
        (0 < k < MAX_COVERAGE, "--k", k, f"a coverage factor above 0 and below {MAX_COVERAGE:g}"),
        (1 <= digits <= MAX_DIGITS, "--digits", digits, f"1 to {MAX_DIGITS}"),
        (seed >= 0, "--seed", seed, "0 or more"),
        (
            correlation in ("shared", "independent"),
            "--correlation",
            correlation,
            "shared or independent",
        ),
        (
            trials is None or MIN_TRIALS <= trials <= MAX_TRIALS,
            "--trials",
            trials,
            f"{MIN_TRIALS} (a 95 % interval needs them) to {MAX_TRIALS}",
        ),
        (
            threads is None or 1 <= threads <= MAX_THREADS,
            "--threads",
            threads,
            f"1 to {MAX_THREADS}",
        ),
    ]
    problems = [
        Problem(what=f"{option} is out of range", value=str(value), expected=expected)
        for good, option, value, expected in checks
        if not good
    ]
    if problems:
        raise InputError(problems)
    return Settings(
        coverage_factor=float(k),
        seed=seed,
        correlation=correlation,
        trials=trials,
        digits=digits,
        threads=threads,
        progress=progress,
    )
