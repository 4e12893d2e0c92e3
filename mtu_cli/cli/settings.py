"""The settings of a call: options over the study over defaults."""

from __future__ import annotations

from typing import Any

from mtu_cli.cli.inputs import Inputs
from mtu_cli.files.study import (
    MAX_COVERAGE,
    MAX_DIGITS,
    MAX_THREADS,
    MAX_TRIALS,
    MIN_TRIALS,
)
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.settings import Settings
from mtu_cli.stats.monte_carlo import Progress

OPTIONS = {
    "coverage_factor": "k",
    "digits": "digits",
    "seed": "seed",
    "correlation": "correlation",
    "trials": "trials",
    "threads": "threads",
}
"""Option of each setting, which a study calls as `Settings` does."""
BELOW_FACTOR = 20.0
"""More than Student's factor of any 95 %; from here on a factor looks like a percentage."""
LEAST_PROBABILITY = 0.8
"""From here to 1 a factor looks like a coverage probability."""


def read_settings(inputs: Inputs, progress: Progress | None) -> Settings:
    """Raises InputError for every setting that is out of range, at once."""
    given = {name: _given(inputs, name, option) for name, option in OPTIONS.items()}
    stated = {name: value for name, value in given.items() if value is not None}
    settings = Settings(progress=progress, **stated)
    problems = [
        finding(
            "out-of-range",
            path=_named(inputs, name),
            value=str(getattr(settings, name)),
            expected=expected,
        )
        for name, (good, expected) in _ranges(settings).items()
        if not good
    ]
    if problems:
        raise InputError(problems)
    return settings


def doubts(inputs: Inputs, settings: Settings) -> list[Finding]:
    """Settings of the call, or of its study, that may be meant otherwise."""
    k = settings.coverage_factor
    if not (LEAST_PROBABILITY <= k < 1 or k >= BELOW_FACTOR):
        return []
    setting = _named(inputs, "coverage_factor")
    return [finding("factor-like-probability", setting=setting, k=k, expected="2 for about 95 %")]


def _named(inputs: Inputs, name: str) -> str:
    """The option of a setting, or what the study calls it where that gives it."""
    option = OPTIONS[name]
    if inputs.options.values.get(option) is None and inputs.study is not None:
        return f"settings.{name} of {inputs.study.source.shown}"
    return f"--{option}"


def _given(inputs: Inputs, name: str, option: str) -> Any:
    value = inputs.options.values.get(option)
    if value is None and inputs.study is not None:
        value = getattr(inputs.study.study.settings, name)
    return value


def _ranges(settings: Settings) -> dict[str, tuple[bool, str]]:
    """Whether each setting is within its range, and the range in words."""
    k, trials, threads = settings.coverage_factor, settings.trials, settings.threads
    return {
        "coverage_factor": (
            0 < k < MAX_COVERAGE,
            f"a coverage factor above 0 and below {MAX_COVERAGE:g}, 2 for about 95 %",
        ),
        "digits": (1 <= settings.digits <= MAX_DIGITS, f"1 to {MAX_DIGITS}"),
        "seed": (settings.seed >= 0, "0 or more"),
        "correlation": (
            settings.correlation in ("shared", "independent"),
            "shared or independent",
        ),
        "trials": (
            trials is None or MIN_TRIALS <= trials <= MAX_TRIALS,
            f"{MIN_TRIALS} (a 95 % interval needs them) to {MAX_TRIALS}",
        ),
        "threads": (threads is None or 1 <= threads <= MAX_THREADS, f"1 to {MAX_THREADS}"),
    }
