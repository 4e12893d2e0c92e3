"""Coefficients of several effects, estimated together beside the scatter that they leave."""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.close_loop_sealed.analyses.loop.estimate import estimate, raw_design
from mtu_cli.close_loop_sealed.analyses.loop.few_parts import with_scatter_of_parts
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit


def jointly(
    prepared: Prepared, columns: Sequence[MemberColumns], *, rough: bool = False
) -> tuple[Prepared, StratifiedFit]:
    """Generalised least squares on `columns`, and the table with the null of what they leave.

    With the covariance that few parts leave; `rough`: as the weights have it.
    """
    scan = prepared.scan
    left, fit = prepared, estimate(scan, prepared.y, columns)
    for _ in range(2):
        left = prepared.with_null_of(prepared.y - raw_design(scan, columns) @ fit.beta)
        fit = estimate(left.scan, prepared.y, columns)
    return left, fit if rough else with_scatter_of_parts(left.scan, columns, fit)
