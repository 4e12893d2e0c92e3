"""After a follow-up has been made, fewer effects can be meant: on simulated days."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from loop_bench.days import shop_table
from separation_examples import prepared_of
from shop_day import SIGMA, ShopDay, measure
from shop_day.day import Floats

from mtu_cli.close_loop_sealed.analyses.loop.evidence import evidence
from mtu_cli.close_loop_sealed.analyses.loop.ranking import CREDIBLE, posterior_of


def reversed_after(day: ShopDay, parts: int) -> None:
    way = np.where(np.arange(day.P) < parts, 1.0, -1.0)[:, None]
    for name in ("dir_x", "dir_y"):
        day.covariates[name] = way * day.covariates[name]


def cold_after(day: ShopDay, parts: int) -> None:
    for name in ("time_min", "T_spindle_degC"):
        again = day.covariates[name].copy()
        again[parts:] = again[: day.P - parts]
        day.covariates[name] = again


def diagnosed(day: ShopDay, errors: Floats) -> tuple[int, str]:
    """How many share the 95 % credible set, and the most probable one; "" of two alike."""
    prepared = prepared_of(shop_table(day, errors))
    scan = prepared.scan
    looked = evidence(scan, scan.pack(), prepared.y, prepared.grand)
    posterior = posterior_of(np.concatenate([looked.log_bayes[: scan.tested], looked.unnamed]))
    names = [*scan.names[: scan.tested], *("without a name",) * len(looked.unnamed)]
    largest = np.sort(posterior)[::-1]
    # Two that do the same at these places differ by rounding alone: neither is the first.
    first = names[int(posterior.argmax())] if largest[0] - largest[1] > 1e-9 else ""
    return int(np.searchsorted(np.cumsum(largest), CREDIBLE)) + 1, first


def followed_up(
    family: str, change: Callable[[ShopDay, int], None] | None, seed: int
) -> tuple[int, str]:
    """Of a day with 21 parts as found and 6 made otherwise."""
    day = ShopDay("A", seed, 27)
    if change is not None:
        change(day, 21)
    field = np.zeros((27, day.H, 2))
    if family == "backlash-y":
        field[..., 1] = 0.5 * SIGMA * day.full("dir_y")
    else:
        field[..., 0] = 12.0 * (1 - np.exp(-day.full("time_min") / 100.0))
    field -= field.mean(axis=(0, 1))
    return diagnosed(day, measure(day, np.random.default_rng([seed, 7])) + field)


FOLLOWED = [("backlash-y", reversed_after), ("warm-up-x", cold_after)]


@pytest.mark.parametrize(("family", "change"), FOLLOWED)
def test_the_class_shrinks_when_the_follow_up_is_made(
    family: str, change: Callable[[ShopDay, int], None]
) -> None:
    days = range(8)
    more = [followed_up(family, None, seed) for seed in days]
    after = [followed_up(family, change, seed) for seed in days]
    sizes = [np.mean([size for size, _ in found]) for found in (more, after)]
    assert sizes[1] < 1.5 < 1.8 < sizes[0]
    right = [sum(name == family for _, name in found) for found in (more, after)]
    assert right[1] == len(days) > right[0]
