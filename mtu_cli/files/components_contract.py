"""What of a report of fit-components is read back, as it is stated."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mtu_cli.files.report_file import Figure, Matrix, NonNegative


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("should not be negative")
    return value


Deviation = Annotated[Figure, AfterValidator(_not_negative)]


class ReportedComponent(BaseModel):
    """One entry of `results.components`; in `unit` and mm, as the report states them."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    of: str | None
    unit: str
    degree: int = Field(ge=0)
    n_passes: int | None
    coefficients: list[float] = Field(min_length=1)
    covariance: Matrix
    covariance_independent: Matrix | None
    s: NonNegative | None
    s_repeat: Deviation
    pass_covariance: Matrix
    pass_covariance_moment: Matrix
    half_difference_mean_square: list[list[float]] | None = None
    run_covariance: list[list[float]] | None = None
    pass_center_mm: float
    pass_dof: NonNegative | None
    repeat_dof: NonNegative | None
    position_range_mm: tuple[float, float] | None


class ReportedGroup(BaseModel):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    components: list[str]
    widths: list[int]
    coefficient_covariance: Matrix
    pass_covariance: Matrix
    half_difference_mean_square: list[list[float]] | None = None
    pass_dof: NonNegative
    n_passes: int | None


class ReportedEffects(BaseModel):
    """`results.effects`: parameters of a machine's effects, each in its own unit, together.

    `parameters` are named ``effect.parameter``; `covariance` is over all of them in order.
    """

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    parameters: list[str]
    units: list[str]
    values: list[float]
    covariance: list[list[float]]
