"""Packed columns: what is taken out, what is left, and which members can still be tested."""

from __future__ import annotations

import numpy as np
from crossed_tables import Floats, made, sizes, whole_frame
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns, Packed, packed, whitened
from mtu_cli.close_loop_sealed.stats.profile_ratio import member_ratios
from mtu_cli.close_loop_sealed.stats.strata import Strata

STRATA = made(6, 9, 2)
FRAME = whole_frame(STRATA)
RNG_SEED = 11


def plain(strata: Strata = STRATA) -> Floats:
    return np.broadcast_to(np.eye(strata.lines), (strata.shape[2], strata.lines, strata.lines))


def tilted() -> Floats:
    """A whitening that is not the identity, other for each axis."""
    found = plain().copy()
    found[0] = [[0.5, 0.1], [0.0, 0.7]]
    found[1] = [[0.9, 0.0], [-0.2, 0.4]]
    return np.asarray(found)


def of_table(seed: int) -> dict[int, Floats]:
    """A column with a value of its own in every entry: in all strata of both axes."""
    rng = np.random.default_rng(seed)
    return FRAME.column({0: rng.normal(size=(6, 9)), 1: rng.normal(size=(6, 9))})


def of_columns(seed: int, axis: int) -> dict[int, Floats]:
    return FRAME.column({axis: np.random.default_rng(seed).normal(size=(1, 9))})


def raw(member: MemberColumns) -> Floats:
    X = np.zeros((STRATA.size, len(member)))
    for j, column in enumerate(member):
        for index, values in column.items():
            X[STRATA.all[index].slice, j] = values
    return X


def without(y: Floats, found: MemberColumns, whitening: Floats) -> Floats:
    """Each stratum's coordinates less their own regression on what was found, by lstsq."""
    left = whitened(STRATA, whitening, y)
    X = whitened(STRATA, whitening, raw(found))
    for stratum in STRATA.all:
        own = X[stratum.slice]
        own = own[:, (own**2).sum(axis=0) > 0]
        if 0 < own.shape[1] < stratum.size:
            beta = np.linalg.lstsq(own, left[stratum.slice], rcond=None)[0]
            left[stratum.slice] -= own @ beta
    return left


def test_what_was_found_is_projected_out_of_each_stratum() -> None:
    y = np.random.default_rng(RNG_SEED).normal(size=(3, STRATA.size))
    found = (of_table(1), of_columns(2, 0))
    for whitening in (plain(), tilted()):
        pack = packed(STRATA, sizes(STRATA), whitening, [], [found])
        expected = np.array([without(own, found, whitening) for own in y])
        np.testing.assert_allclose(pack.without_found(y), expected, rtol=0, atol=1e-10)
        spent = np.array([2 if s.kind == "column" and s.axis == 0 else 1 for s in STRATA.all])
        np.testing.assert_array_equal(pack.dof, sizes(STRATA) - spent)


def test_the_data_are_left_as_they_were() -> None:
    y = np.random.default_rng(RNG_SEED).normal(size=STRATA.size)
    before = y.copy()
    packed(STRATA, sizes(STRATA), tilted(), [], [(of_table(1),)]).without_found(y)
    assert np.array_equal(y, before)


def test_whitening_acts_on_the_leading_coordinates_of_columns_alone() -> None:
    X = np.random.default_rng(RNG_SEED).normal(size=(STRATA.size, 2))
    expected = X.copy()
    for stratum in STRATA.all:
        if stratum.kind == "column":
            at = slice(stratum.start, stratum.start + 2)
            expected[at] = tilted()[stratum.axis] @ X[at]
    np.testing.assert_allclose(whitened(STRATA, tilted(), X), expected, rtol=1e-14)


def usable(pack: Packed) -> NDArray[np.bool_]:
    return pack.usable


def test_members_that_were_found_cannot_be_found_again() -> None:
    # One stratum and many: the member itself, one that holds it, and one that does not.
    simple, broad = of_columns(2, 0), of_table(1)
    other, wide = of_columns(3, 0), of_table(4)
    members = [(simple,), (simple, other), (other,), (broad,), (broad, wide), (wide,)]
    pack = packed(STRATA, sizes(STRATA), tilted(), [members], [(simple,), (broad,)])
    np.testing.assert_array_equal(usable(pack), [False, False, True, False, False, True])
    y = pack.without_found(np.random.default_rng(RNG_SEED).normal(size=(2, STRATA.size)))
    found = member_ratios(pack, y)
    LR, log_bayes = found.ratio, found.log_bayes
    assert (LR[:, ~usable(pack)] == -1).all()
    assert (log_bayes[:, ~usable(pack)] < -1e5).all()
    assert (LR[:, usable(pack)] > 0).all()


def test_a_stratum_that_is_used_up_tells_nothing_more() -> None:
    # Five coordinates tell the parts apart: five trends leave nothing of them, not even rounding.
    trends = [FRAME.column({0: row[:, None]}) for row in np.eye(6)[:5]]
    (part,) = (i for i, s in enumerate(STRATA.all) if s.kind == "part" and s.axis == 0)
    broad = of_table(1)
    rest = {index: values for index, values in broad.items() if index != part}
    later = FRAME.column({0: np.arange(6.0)[:, None] ** 2})
    members = [[(broad,)], [(rest,)], [(later,)]]
    found = [(trend,) for trend in trends]
    pack = packed(STRATA, sizes(STRATA), plain(), members, found)
    y = pack.without_found(np.random.default_rng(RNG_SEED).normal(size=(1, STRATA.size)))
    np.testing.assert_array_equal(y[:, STRATA.all[part].slice], 0)
    LR = member_ratios(pack, y).ratio
    assert LR[0, 0] == LR[0, 1] > 0
    np.testing.assert_array_equal(pack.usable, [True, True, False])


def test_a_member_that_leaves_no_scatter_to_be_judged_by_is_not_tested() -> None:
    # Five coordinates: with three columns two are left, with four but one.
    columns = [FRAME.column({0: row[:, None]}) for row in np.eye(6)[:4]]
    pack = packed(STRATA, sizes(STRATA), plain(), [[columns[:3]], [columns]])
    np.testing.assert_array_equal(pack.usable, [True, False])


def test_the_same_column_twice_takes_one_degree_of_freedom() -> None:
    column = of_columns(2, 1)
    pack = packed(STRATA, sizes(STRATA), plain(), [], [(column,), (column,)])
    assert (sizes(STRATA) - pack.dof).sum() == 1
