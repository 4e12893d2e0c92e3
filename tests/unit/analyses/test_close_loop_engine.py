"""The engine of closing the loop: each part of it against a slow plain version, or its rate."""

from contextlib import suppress
from dataclasses import replace
from itertools import cycle, islice, pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_tables import shop_covariates, table
from loop_examples import effect, parameter, searched, uncorrelated
from scipy.integrate import quad
from scipy.stats import binom, f, invgamma

from mtu_cli.analyses.close_loop import _scatter as scatter_of
from mtu_cli.analyses.close_loop import close_loop
from mtu_cli.analyses.close_loop import diagnosis as engine
from mtu_cli.analyses.close_loop import experiment as planned
from mtu_cli.analyses.close_loop.describe import crossings, effects_of, without_references
from mtu_cli.analyses.close_loop.diagnosis import Diagnosis, diagnosis_of
from mtu_cli.analyses.close_loop.experiment import follow_ups, minimum_detectable
from mtu_cli.analyses.close_loop.gate import Gate
from mtu_cli.analyses.close_loop.likelihood import Likelihood, outliers
from mtu_cli.analyses.close_loop.result import FoundEffect
from mtu_cli.analyses.close_loop.strata import Missing
from mtu_cli.findings import InputError
from mtu_cli.language import evaluate, linear_form, parse
from mtu_cli.model.effect_library import Candidate, candidates_of, effect_library
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

P, H = 12, 6
NOISE_MM = 1e-3
KEPT = ("sequence", "dir_x")


def noise(seed: int, parts: int = P, **kinds: float) -> ResidualTable:
    """A table with no effect: parts, features and single entries scatter (mm)."""
    rng = np.random.default_rng(seed)
    own = {name: value for name, value in shop_covariates(parts, H).items() if name in KEPT}
    sizes = {"part": NOISE_MM, "feature": NOISE_MM} | kinds
    errors = NOISE_MM * rng.standard_normal((parts, H, 2))
    errors += sizes["part"] * rng.standard_normal((parts, 1, 2))
    errors += sizes["feature"] * rng.standard_normal((1, H, 2))
    return replace(table(parts, H, covariates=own), errors=errors)


def candidates(own: ResidualTable, *families: str) -> tuple[Candidate, ...]:
    """Those of some families of the built-in library, or of all but the waves."""
    found = candidates_of(own, effect_library(), ("cyclic",))
    return tuple(item for item in found if not families or item.family in families)


def posed_of(own: ResidualTable, *families: str) -> Likelihood:
    return Likelihood(own, candidates(own, *families))


def diagnosis(own: ResidualTable, *families: str) -> Diagnosis:
    return diagnosis_of(own, candidates(own, *families), alpha=0.05, most=2, seed=1, nulls=299)


def test_the_evidence_of_one_column_is_the_integral_over_its_size() -> None:
    """Of a direction that changes from part to part: one stratum has all of it. The size has the
    variance g s^2, g the law of Zellner and Siow; s is the likeliest.
    """
    own = noise(1)
    own.errors[..., 0] += 0.4 * NOISE_MM * own.covariates["dir_x"]
    like = posed_of(own, "backlash")
    (s,) = (s for s in like.design.strata.of("part") if like.design.strata.axis[s] == 0)
    (index,) = like.closure([0])
    x = like.design.columns.dense([index])[0]
    part = like.design.strata.slices[s]
    y, n, x = like.y[part], like.n[s], x[part]
    assert x @ x == pytest.approx(1)

    def weighed(g: float) -> float:
        left = y @ y - g / (1 + g) * (x @ y) ** 2
        likelihood = (left / (y @ y)) ** (-n / 2) / np.sqrt(1 + g)
        return float(likelihood * invgamma.pdf(g, 0.5, scale=n / 2))

    ends = (0, n, 1e3 * n, np.inf)
    slow = sum(quad(weighed, low, high)[0] for low, high in pairwise(ends))
    assert like.evidence((index,))[0] == pytest.approx(np.log(slow), abs=0.05)


@pytest.mark.parametrize("sloped", [False, True])
def test_missing_cells_are_as_left_out(sloped: bool) -> None:
    """Against least squares of the measured cells with a constant for every feature, and for every
    part a constant, or a line.
    """
    rng = np.random.default_rng(2)
    there = rng.random((7, 8)) > 0.2
    lines = np.linalg.qr(np.vander(np.arange(8.0), 1 + sloped, increasing=True))[0]
    x, y = rng.standard_normal((2, 7, 8))
    gaps = Missing(there, lines)
    x_in, y_in = (gaps.interaction(gaps.filled(np.where(there, v, 9.0))) for v in (x, y))
    parts, features = np.indices((7, 8))
    free = [(parts == i) * line[features] for i in range(7) for line in lines.T]
    X = np.array([*free, *(features == j for j in range(8)), x])[:, there].astype(float).T
    size, *_ = np.linalg.lstsq(X, y[there], rcond=None)
    assert np.sum(x_in * y_in) / np.sum(x_in**2) == pytest.approx(size[-1])
    squares = np.sum(y_in**2) - np.sum(x_in * y_in) ** 2 / np.sum(x_in**2)
    assert squares == pytest.approx(np.sum((y[there] - X @ size) ** 2))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sizes_are_those_of_dense_generalised_least_squares(seed: int) -> None:
    """V = parts x all + features x all + single entries, by the variances of the strata."""
    own = noise(seed, part=2 * NOISE_MM)
    own.errors[..., 0] += 5e-3 * own.covariates["dir_x"]
    found = diagnosis(own, "backlash")
    assert found.names == ["backlash-x"]
    sizes = found.sizes
    strata, scale = found.design.strata, found.design.scale
    of = {
        kind: scale**2 / sizes.fit.weights[s]
        for kind in ("part", "feature", "interaction")
        for s in strata.of(kind)
        if strata.axis[s] == 0
    }
    same_part, same_feature = (np.kron(np.eye(P), np.ones((H, H))), np.tile(np.eye(H), (P, P)))
    V = of["interaction"] * np.eye(P * H) + (of["part"] - of["interaction"]) / H * same_part
    V += (of["feature"] - of["interaction"]) / P * same_feature
    x = np.broadcast_to(own.covariates["dir_x"], (P, H)).ravel()
    X = np.column_stack([x, np.ones(P * H)])
    covariance = np.linalg.inv(X.T @ np.linalg.solve(V, X))
    beta = covariance @ X.T @ np.linalg.solve(V, own.errors[..., 0].ravel())
    (effect,) = sizes.effects
    size = effect.parameters[0]
    assert size.value == pytest.approx(beta[0], rel=1e-6)
    assert size.u == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    assert sizes.levels[0].value == pytest.approx(beta[1], rel=1e-6)


def test_the_gate_alarms_rarely_on_pure_noise() -> None:
    """Family-wise, whatever of parts, features and entries scatters most: that parts or features
    do by more than entries is what two checks say, on all of those and on no others.
    """
    sets, alpha = 120, 0.1
    checks = {"part": "part-variance", "feature": "column-variance"}
    flat = {"part": 0.0, "feature": 0.0}
    kinds: list[dict[str, float]] = [{}, {"part": 5e-3}, {"feature": 5e-3}, flat]
    alarms = 0
    for seed, kind in enumerate(islice(cycle(kinds), sets)):
        likelihood = posed_of(noise(seed, parts=7, **kind))
        p = Gate(likelihood, np.random.default_rng(seed), 299)(())
        for name in (checks[of] for of, size in kind.items() if size > NOISE_MM):
            assert p.pop(name) <= alpha
        alarms += min(p.values()) <= alpha
    low, high = (binom.ppf(q, sets, alpha) for q in (0.001, 0.999))
    assert low <= alarms <= high


def test_a_rate_below_one_in_the_null_tables_finds_what_is_plain() -> None:
    """As many null tables are drawn as a p below the rate takes; many components share a rate."""
    own = noise(2)
    own.errors[..., 0] += 20 * NOISE_MM * own.covariates["dir_x"]
    chosen = candidates(own, "backlash")
    found = diagnosis_of(own, chosen, alpha=0.002, most=1, seed=1, nulls=99)
    assert found.names == ["backlash-x"]
    assert found.entries[0].p == pytest.approx(1 / 1000)


def test_features_or_parts_that_differ_by_more_than_entries_scatter_are_left() -> None:
    """As much as single entries is ordinary; parts are held against what the model expects."""
    few = ("backlash", "squareness")
    assert diagnosis(noise(5), *few).verdict == "none"
    assert diagnosis(noise(5, feature=6 * NOISE_MM), *few).fired == ("column-variance",)
    assert diagnosis(noise(5, part=6 * NOISE_MM), *few).fired == ("part-variance",)
    expected = np.zeros((1, H, 2, 2))
    expected[0, :, [0, 1], [0, 1]] = 6 * NOISE_MM
    own = noise(5, part=6 * NOISE_MM)
    assert diagnosis(replace(own, of_part=expected), *few).verdict == "none"
    strict = replace(own, of_part=expected / 8, pass_dof=50.0)
    assert diagnosis(strict, *few).fired == ("part-variance",)


def test_the_variance_checks_are_f_tests_of_the_means() -> None:
    """Of means of parts and features in a plain table, against what single entries explain."""
    own = noise(6, part=3 * NOISE_MM, feature=2.5 * NOISE_MM)
    gate = Gate(posed_of(own, "backlash"), np.random.default_rng(0), 9)
    fit = gate.likelihood.fit(())
    strata = gate.strata
    squares = np.array([np.sum(fit.residual[part] ** 2) for part in strata.slices])
    checks = gate._variances(fit, squares, strata.of("interaction"), squares > 0)
    E = own.errors - own.errors.mean(axis=(0, 1))
    rest = E - E.mean(axis=0) - E.mean(axis=1, keepdims=True)
    entry, dof = np.sum(rest**2, axis=(0, 1)) / ((P - 1) * (H - 1)), (P - 1) * (H - 1)
    for name, axis, n in (("column-variance", 0, P), ("part-variance", 1, H)):
        own_dof = P * H // n - 1
        square = n * np.sum(E.mean(axis=axis) ** 2, axis=0) / own_dof
        p = f.sf(square / ((1 + n) * entry), own_dof, dof)
        assert np.exp(-checks[name][0]) == pytest.approx(2 * p.min(), rel=1e-6)


def test_two_effects_that_hide_each_other_leave_features_that_differ() -> None:
    """An angle and a hole that is off, neither of which is plain beside the other."""
    own = noise(8, part=0.2 * NOISE_MM, feature=0.1 * NOISE_MM)
    y = own.places[0, :, 1] - own.places[0, :, 1].mean()
    own.errors[..., 0] += 5 * NOISE_MM * y / np.abs(y).max()
    own.errors[:, int(np.argmin(y)), 0] += 12 * NOISE_MM
    found = diagnosis(own, "squareness", "feature-outlier")
    assert found.names == []
    assert (found.verdict, found.fired) == ("unexplained", ("column-variance",))


def test_a_mean_of_exactly_0_is_tested_too() -> None:
    own = noise(1)
    half = own.errors[: P // 2]
    centred = replace(own, errors=np.concatenate([half, -half]))
    assert Gate(posed_of(centred), np.random.default_rng(0), 299)(())["offset-x"] == 1.0


def test_what_the_coefficients_leave_open_must_be_larger_to_be_found() -> None:
    """A scale that is known to 20 um at the ends: the information S of a column of size 1 there
    becomes 1/(1/S + u^2), of which the detectable size is the root's inverse.
    """
    own, u = noise(7), 20 * NOISE_MM
    x = own.places[..., 0] - own.places[..., 0].mean()
    common = np.zeros((P, H, 2, 1))
    common[..., 0, 0] = u * x / np.abs(x).max()
    found = [diagnosis(replace(own, common=known), "scale") for known in (common[..., :0], common)]
    sizes = [minimum_detectable(each)["scale-x"] for each in found]
    design = found[0].design
    (s,) = (s for s in design.strata.of("feature") if design.strata.axis[s] == 0)
    S = np.sum(x**2) / np.abs(x).max() ** 2 * found[0].models.likelihood.fit(()).weights[s]
    # The coefficients take a degree of freedom of five, too.
    assert sizes[1] / sizes[0] == pytest.approx(np.sqrt(1 + S * (u / design.scale) ** 2), rel=0.2)


def test_single_entries_far_off_are_listed_with_their_errors() -> None:
    own, library = noise(3), effect_library()
    own.errors[4, 2] += (0.0, 12 * NOISE_MM)
    few = replace(library, families=tuple(x for x in library.families if x.family == "backlash"))
    found = close_loop([own], few, alpha=0.05, max_effects=1, seed=1)
    (warning,) = found.warnings
    assert warning.code == "outliers-set-aside"
    assert warning.facts["entries"] == ["H3 of P5 in y"]
    assert warning.facts["errors"] == pytest.approx([own.errors[4, 2, 1] * 1e3])
    assert warning.facts["unit"] == "um"


@pytest.mark.parametrize("reference", [20.0, 22.0, 24.0])
@pytest.mark.parametrize("beside", [0.0, 10 * NOISE_MM])
def test_an_offset_is_no_effect_where_only_the_reference_is_another(
    reference: float, beside: float
) -> None:
    """An axis that grows from x = 0 and a temperature that was met, without and with a lost motion:
    the level stands with the growth, whose joint covariance holds at its zero; that is told.
    """
    own, T = noise(12, parts=20), np.linspace(20, 27, 20)[:, None]
    own = replace(own, covariates={**own.covariates, "T_a_degC": T})
    own.errors[..., 0] += 1e-4 * own.places[..., 0] * (T - reference)
    own.errors[..., 0] += beside * own.covariates["dir_x"]
    found = diagnosis(own, "offset", "scale", "backlash", "thermal-drift", "thermal-growth")
    found = without_references(found)
    sizes = found.sizes
    effects = {e.name: e for e in effects_of(found, compare=True)}
    assert effects.keys() == {"thermal-growth-x"} | ({"backlash-x"} if beside else set())
    growth = effects["thermal-growth-x"]
    assert 0.5 < growth.explained_share < 1.05
    told = crossings([*effects.values()], sizes.covariance, own)
    zeros = {each.covariate: each for each in told}
    assert zeros.keys() == {"T_a_degC", "x"}
    assert abs(zeros["T_a_degC"].value - reference) < 3 * zeros["T_a_degC"].u < 0.5
    assert abs(zeros["x"].value) < 3 * zeros["x"].u < 10
    assert {(each.effect, each.whole) for each in told} == {("thermal-growth-x", not beside)}
    texts = linear_form(parse(growth.equations["Ex"]), [p.name for p in growth.parameters])
    for x in (0.0, 100.0):
        at = {"x": x, "T_a_degC": reference}
        J = np.array([evaluate(lever, at) for lever in texts.coefficients.values()])
        error = J @ [p.value for p in growth.parameters]
        rows = [p.row for p in growth.parameters]
        C = sizes.covariance[np.ix_(rows, rows)]
        assert abs(error) < 3 * np.sqrt(J @ C @ J) < 10 * NOISE_MM


@pytest.mark.parametrize("backlash", [0.0, 8 * NOISE_MM])
def test_a_level_goes_with_an_effect_that_a_machine_can_hold(backlash: float) -> None:
    """Beside a feature that is off on every part a level of the others: with the lost motion where
    there is one, else with the feature, as no machine can hold either.
    """
    own, level = noise(4, feature=0.2 * NOISE_MM), 1.5 * NOISE_MM
    own.errors[..., 0] += backlash * own.covariates["dir_x"] + level
    own.errors[:, 2, 0] += 30 * NOISE_MM
    found = diagnosis(own, "backlash", "feature-outlier")
    effects = {each.name: each for each in effects_of(found)}
    assert effects.keys() == {"feature-outlier"} | ({"backlash-x"} if backlash else set())
    levels = {p.name: (p, each.name) for each in effects.values() for p in each.of_role("level")}
    (of_x, first), (_, second) = levels["level_x"], levels["level_y"]
    assert (first, second) == ("backlash-x" if backlash else "feature-outlier", "feature-outlier")
    assert abs(of_x.value - level) < 3 * of_x.u < 1.5 * NOISE_MM


def test_the_average_predicts_better_than_lower_terms_that_are_0() -> None:
    """A growth alone: held out the average over whether its scale, drift and level are there has
    the smaller error.
    """
    library, chosen = effect_library(), ("scale", "thermal-drift", "thermal-growth")
    few = replace(library, families=tuple(x for x in library.families if x.family in chosen))
    squares = np.zeros(2)
    for seed in range(16):
        own, T = noise(seed, parts=20, feature=0.2 * NOISE_MM), np.linspace(24, 28, 20)[:, None]
        own = replace(own, covariates={**own.covariates, "T_a_degC": T})
        x = own.places[..., 0]
        own.errors[..., 0] += 1e-4 * (x - x.mean()) * (T - 20)
        (item,) = close_loop([own], few, alpha=0.05, max_effects=3, seed=1).tables
        squares += [each.by_axis["x"] ** 2 for each in (item.after, item.after_averaged)]
    assert 0.95 < squares[1] / squares[0] < 0.99


def test_growth_from_the_first_temperature_is_no_shift() -> None:
    """The reference lies at the end of what was met, its estimate as often within as beyond it: a
    shift is claimed, and the reference missed, no more often than 1 in 20.
    """
    sets, shifts, missed = 25, 0, 0
    for seed in range(sets):
        own, T = noise(seed, parts=20), np.linspace(22, 27, 20)[:, None]
        own = replace(own, covariates={**own.covariates, "T_a_degC": T})
        own.errors[..., 0] += 1e-4 * own.places[..., 0] * (T - 22)
        found = diagnosis(own, "offset", "scale", "thermal-drift", "thermal-growth")
        found = without_references(found)
        shifts += "offset-x" in found.names
        found = replace(found, offsets={})
        sizes = found.sizes
        told = crossings(effects_of(found), sizes.covariance, own)
        low, high = next((c.interval95 for c in told if c.covariate == "T_a_degC"), (0.0, 0.0))
        missed += not low <= 22 <= high
    assert shifts <= binom.ppf(0.999, sets, 0.05)
    assert missed <= binom.ppf(0.999, sets, 0.05)


@pytest.mark.parametrize("column", ["sequence", "T_a_degC"])
@pytest.mark.parametrize(("times", "steep"), [(15, 0.4), (25, 0.4), (20, 1.2)])
def test_an_offset_beside_a_drift_is_told(column: str, times: float, steep: float) -> None:
    """Of many u, and of both signs: as an effect of its own, or, where both together are zero at a
    place that was met, by that place. The nearest zero that was not met is 4 u beyond.
    """
    sets, right = 8, 0
    for seed in range(sets):
        own = noise(seed, parts=20, part=0.5 * NOISE_MM)
        order = np.arange(20.0)[:, None]
        own = replace(own, covariates={column: 20 + 0.3 * order if column[0] == "T" else order})
        shift = times * NOISE_MM * np.hypot(0.5 / np.sqrt(20), 1 / np.sqrt(H))
        drift = steep * NOISE_MM * (order - order.mean()) * (1 if seed % 2 else -1)
        own.errors[..., 0] += shift + drift
        found = diagnosis(own, "offset", "trend", "thermal-drift", "covariate")
        assert len(found.entries) == 1
        met = np.ptp(np.sign(shift + drift)) > 0
        right += ("offset-x" in without_references(found).names) == (not met)
    assert right >= binom.ppf(0.01, sets, 0.95)


def test_the_mean_of_parts_that_turn_at_random_is_no_rotation_of_all() -> None:
    """Their mean turns by 1/sqrt(P) of what each does: no more false names than alpha allows."""
    sets, wrong = 40, 0
    for seed in range(sets):
        own = noise(100 + seed, feature=0.3 * NOISE_MM)
        # 6 um at the furthest place.
        turn = np.random.default_rng(seed).normal(size=(P, 1, 1))
        x, y = (own.places[..., i] - own.places[..., i].mean() for i in (0, 1))
        arms = np.stack([-y, x], axis=2) / np.hypot(x, y).max()
        own = replace(own, errors=own.errors + 6 * NOISE_MM * turn * arms)
        names = diagnosis(own, "rotation", "rotation-scatter").names
        assert "rotation-scatter" in names
        wrong += "rotation-z" in names
    assert wrong <= binom.ppf(0.999, sets, 0.05)


def test_a_wave_of_several_pitches_is_written_as_the_places_that_were_measured() -> None:
    """Regular places cannot decide between the aliases of a wave: all make the same errors there,
    and between them the written table is as unsure as the wave is high.
    """
    n, amplitude = 12, 8 * NOISE_MM
    places = np.zeros((n, 3))
    places[:, 0] = 25.0 * np.arange(n)
    own = replace(noise(6), features=tuple(f"h{i}" for i in range(n)))
    rng = np.random.default_rng(6)
    errors = NOISE_MM * rng.standard_normal((P, n, 2))
    wave = amplitude * np.sin(2 * np.pi * places[:, 0] / 9.0)
    errors[..., 0] += wave
    own = replace(table(P, n, places=places, covariates=dict(own.covariates)), errors=errors)
    found = diagnosis_of(
        own, [c for c in candidates_of(own, effect_library()) if c.family == "cyclic"],
        alpha=0.05, most=1, seed=1, nulls=299,
    )  # fmt: skip
    (effect,) = effects_of(found)
    assert effect.name == "cyclic-x"
    assert effect.ambiguous
    assert effect.table is not None
    assert not effect.not_written
    (level,) = effect.of_role("level")
    assert effect.table.values + level.value == pytest.approx(wave, abs=5 * NOISE_MM / np.sqrt(P))
    assert effect.table.between == pytest.approx(amplitude**2, rel=0.2)


def test_what_is_searched_is_compared_given_the_smooth_effects(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By dense matrices: a walk of the parts is a part of the covariance, not free columns."""
    own = noise(3)
    time = np.linspace(5.0, 300.0, P)[:, None]
    own = replace(own, covariates={"time_min": time})
    own.errors[..., 0] -= 4 * NOISE_MM * np.exp(-time / 40.0)
    like = posed_of(own, "warm-up")
    design, walk = like.design, next(k for k in like.kernels.values() if len(k.directions) == 1)
    base = like.fit(like.smooth(like.fit(()), walk))
    assert base.columns
    monkeypatch.setattr(like, "weights", lambda *_: base.weights)
    items = design.members_at(design.members[0].form, np.array([20.0, 40.0, 80.0]))
    w = base.weights[design.strata.labels()]
    Z, sizes = design.columns.dense(base.columns), 1 / design.columns.precisions[list(base.columns)]
    live = w > 0
    V = np.diag(1 / w[live]) + Z[:, live].T @ (sizes[:, None] * Z[:, live])
    X = np.zeros((len(items), len(w)))
    for x, item in zip(X, items, strict=True):
        x[item.at] = item.columns[0]
    gains = engine._gains(like, base, design.add(0, items))
    for x, gain in zip(X, gains, strict=True):
        weighed = np.linalg.solve(V, x[live])
        assert gain == pytest.approx((weighed @ like.y[live]) ** 2 / (weighed @ x[live]), rel=1e-6)


def test_a_profile_in_the_place_of_a_wave_stands_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where several pitches fit, and the profile may have been found before the wave."""
    several = searched("pitch_mm", 12.5, (9.0, 9.1), (12.3, 12.7))
    monkeypatch.setattr(engine, "searched_set", lambda *_: several)
    of_x, wave, profile = SimpleNamespace(axis="x"), 0, -1
    member = SimpleNamespace(candidate=0)
    design = SimpleNamespace(candidates=[of_x], members=[member])
    added = (np.array([5.0, 4.0]), [wave, profile])
    models: Any = SimpleNamespace(
        design=design, likelihood=SimpleNamespace(kernels={profile: of_x}), named=[profile],
        additions=lambda model: added, members=lambda model: [item for item in model if item >= 0],
    )  # fmt: skip
    assert engine.without_aliases(models, (wave,)) == (profile,)
    assert engine.without_aliases(models, (profile, wave)) == (profile,)


def test_a_step_is_averaged_over_the_places_that_fit() -> None:
    """Between the parts that were measured it may be at any place: in the mean a ramp, and a step
    where the parts follow each other.
    """
    parts, jump = 16, 12 * NOISE_MM
    own = noise(4, parts, part=0.2 * NOISE_MM)
    errors = own.errors.copy()
    errors[8:, :, 0] += jump

    def written(sequence: FloatArray) -> FloatArray:
        there = replace(own, errors=errors, covariates={"sequence": sequence[:, None]})
        found = diagnosis(there, "step")
        (effect,) = effects_of(found)
        assert effect.name == "step-x"
        values = {p.name: p.value for p in effect.parameters}
        at = np.arange(6.0, 14.0)
        (text,) = effect.equations.values()
        shift = evaluate(parse(text), values | {"sequence": at}) - values["level_x"]
        return np.asarray(shift / values["jump"])

    counted = np.arange(1.0, parts + 1)
    np.testing.assert_allclose(written(counted), [0, 0, 0, 1, 1, 1, 1, 1], atol=1e-6)
    # Parts 9 to 11 were not measured.
    gap = np.where(counted > 8, counted + 3, counted)
    np.testing.assert_allclose(written(gap), [0, 0, 0, 0.25, 0.5, 0.75, 1, 1], atol=1e-6)
    # Counted by days: a gap of any width is an equation that a machine file may have.
    days = np.where(counted > 8, counted + 200, counted)
    np.testing.assert_allclose(written(days), np.clip((np.arange(8) - 2) / 200, 0, 1), atol=0.025)


def test_a_searched_value_at_an_end_of_its_range_does_not_leave_it() -> None:
    """A warm-up that has settled before the first part: sizes are those of least squares at the end
    of the range, without a change that would lead out of it.
    """
    parts = 16
    own = noise(9, parts, part=0.0, feature=0.0)
    time = np.linspace(60.0, 600.0, parts)[:, None]
    errors = own.errors.copy()
    errors[..., 0] += 60 * NOISE_MM * np.exp(-time / 25.0)
    found = diagnosis(replace(own, errors=errors, covariates={"time_min": time}), "warm-up")
    sizes = found.sizes
    (effect,) = sizes.effects
    assert effect.searched is not None
    assert effect.searched.value == pytest.approx(60.0)
    (change,) = effect.of_role("searched")
    assert change.value == pytest.approx(0.0, abs=1e-12)
    # By the logarithm of the time constant, of a fall.
    (text,) = effect.equations.values()
    lever = linear_form(parse(text), [p.name for p in effect.parameters]).coefficients[change.name]
    slope = time / 60 * np.exp(-time / 60)
    assert evaluate(lever, {"time_min": time}) == pytest.approx(slope, rel=1e-6)
    # Parts and features hardly scatter: plain least squares.
    settled = 1 - np.exp(-time[:, 0] / 60.0)
    X = np.column_stack([settled, np.ones(parts)])
    expected = np.linalg.lstsq(X, errors[..., 0].mean(axis=1), rcond=None)[0]
    assert effect.parameters[0].value == pytest.approx(expected[0], rel=1e-6)


# Where effects cancel: of sizes that are known to the last digit.


LEVEL = parameter("level_x", "um", 4.0, 0.4, "level")
DRIFT = effect(
    "thermal-drift-x",
    parameter("drift", "um/K", -2.0, 0.1),
    LEVEL,
    equations={"Ex": "drift*(T_a_degC - 20) + level_x"},
)
TO_20 = {"Ex": "drift*(T_a_degC - 20)"}
T = np.linspace(18, 26, 12)[:, None]
TABLE = replace(table(12, 9), covariates={"T_a_degC": T, "dir_x": np.tile([[-1.0], [1.0]], (6, 1))})


def test_an_axis_is_right_where_its_drift_and_level_cancel() -> None:
    (found,) = crossings(*uncorrelated(DRIFT), TABLE)
    assert (found.axis, found.covariate, found.whole) == ("x", "T_a_degC", True)
    assert found.value == pytest.approx(22.0)
    assert found.u == pytest.approx(np.sqrt(0.4**2 + 2**2 * 0.1**2) / 2)
    # The interval is Fieller's.
    for end in found.interval95:
        s = np.sqrt(0.4**2 + (end - 20) ** 2 * 0.1**2)
        assert abs(4 - 2 * (end - 20)) / s == pytest.approx(coverage_factor(0.95, 20.0))


@pytest.mark.parametrize(
    ("first", "last", "zero", "told"),
    [
        (20, 28, 22.0, True),
        # The interval of 0.5 K about it does not reach the data, or holds the reference at 20.
        (20, 28, 17.9, False),
        (23, 28, 21.0, False),
        (22, 28, 20.0, True),
        (20, 28, 19.7, True),
    ],
)
def test_a_temperature_that_was_not_met_is_told_only_of_the_reference(
    first: float, last: float, zero: float, told: bool
) -> None:
    own = replace(TABLE, covariates={"T_a_degC": np.linspace(first, last, 12)[:, None]})
    level = parameter("level_x", "um", 2 * (zero - 20), 0.4, "level")
    found = crossings(*uncorrelated(replace(DRIFT, parameters=(DRIFT.parameters[0], level))), own)
    assert [round(each.value, 6) for each in found] == [zero] * told


def test_a_zero_of_one_effect_is_told_though_that_of_all_was_not_met() -> None:
    own = replace(TABLE, covariates={"T_a_degC": np.linspace(20, 26, 12)[:, None]})
    shift = effect("offset-x", parameter("shift", "um", 12, 0.4), equations={"Ex": "shift"})
    shift = replace(shift, candidate=replace(shift.candidate, kind="offset"))
    (found,) = crossings(*uncorrelated(DRIFT, shift), own)
    assert (found.effect, found.whole) == ("thermal-drift-x", False)
    assert found.value == pytest.approx(22.0)


def grown(drift: float, level: float) -> FoundEffect:
    """A growth by 10 um/m/K from 23 degC on about some place, beside a level."""
    text = "growth*(x - 75)*(T_a_degC - 20) + scale*(x - 75) + drift*(T_a_degC - 20) + level_x"
    return effect(
        "thermal-growth-x",
        parameter("growth", "um/m/K", 10.0, 0.5),
        parameter("scale", "um/m", -30.0, 2.0, "margin"),
        parameter("drift", "um/K", drift, 0.05, "margin"),
        parameter("level_x", "um", level, 0.2, "level"),
        equations={"Ex": text},
    )


def test_a_growth_has_a_temperature_and_a_place_without_error() -> None:
    own = grown(1.0, -3.0)
    found = {each.covariate: each for each in crossings(*uncorrelated(own), TABLE)}
    assert found["T_a_degC"].value == pytest.approx(23.0)
    assert found["x"].value == pytest.approx(-25.0)
    assert all(each.whole for each in found.values())


@pytest.mark.parametrize("level", [0.0, 4.0])
def test_a_growth_beside_a_level_of_its_own_is_zero_nowhere(level: float) -> None:
    own = grown(1.0, level)
    assert crossings(*uncorrelated(own), TABLE) == ()


def test_an_effect_is_zero_with_its_level_though_another_is_not() -> None:
    other = effect("backlash-x", parameter("b", "um", 9, 1), equations={"Ex": "b*dir_x"})
    (found,) = crossings(*uncorrelated(DRIFT, other), TABLE)
    assert (found.effect, found.whole) == ("thermal-drift-x", False)
    assert found.value == pytest.approx(22.0)


@pytest.mark.parametrize(
    "effects",
    [
        # Its name is not certain, or the level is not with it.
        (replace(DRIFT, class_names=("thermal-drift-x", "warm-up-x")),),
        (
            effect("thermal-drift-x", parameter("drift", "um/K", -2.0, 0.1), equations=TO_20),
            effect(
                "backlash-x",
                parameter("b", "um", 9, 1),
                LEVEL,
                equations={"Ex": "b*dir_x + level_x"},
            ),
        ),
        # A direction; the level's sign is all that is known.
        (replace(DRIFT, equations={"Ex": "drift*dir_x + level_x"}),),
        (replace(DRIFT, equations={"Ex": "drift*1e-3*(T_a_degC - 20) + level_x"}),),
    ],
)
def test_no_zero_is_told_where_there_is_none(effects: tuple[FoundEffect, ...]) -> None:
    assert crossings(*uncorrelated(*effects), TABLE) == ()


def test_a_column_is_asked_in_the_strata_that_know_of_it() -> None:
    """Whatever other columns are tested with it: a share of 1e-6 in the interaction, from which
    another column has all of its information, says nothing.
    """
    rng = np.random.default_rng(5)
    load = rng.standard_normal((P, 1)) + 1e-3 * rng.standard_normal((P, H))
    alone = noise(4)
    alone.covariates["load"] = load
    beside = replace(alone, covariates={**alone.covariates, "hall": rng.standard_normal((P, H))})
    tested = []
    for own in (alone, beside):
        like = posed_of(own, "covariate")
        fit = like.fit(())
        at, lp = Gate(like, rng, 0)._members((), fit, fit.residual[None])
        forms = [like.design.members[m].form for m in at]
        tested.append([p for p, form in zip(lp[0], forms, strict=True) if form.used == ("load",)])
    assert len(tested[0]) == 2
    assert tested[0] == pytest.approx(tested[1], rel=1e-6)


def test_a_wave_of_two_steps_has_no_size_of_rounding() -> None:
    """Regular targets see its sine at the zeros alone: that column says nothing of its size."""
    rng, places = np.random.default_rng(22), np.full((11, 3), np.nan)
    places[:, 0] = 50.0 * np.arange(11)
    passes = {"sequence": np.arange(1.0, 4)[:, None]}
    own = table(
        3, 11, axes=("x",), places=places, covariates=passes, component="dx_x", operations=("",),
        fitted_degree=1,
    )  # fmt: skip
    errors = 1e-3 * rng.normal(size=own.errors.shape)
    errors[..., 0] += 3e-3 * np.cos(np.pi * np.arange(11))
    line = np.linalg.qr(np.vander(np.arange(11.0), 2))[0]
    errors -= (line @ (line.T @ errors.mean(axis=0)))[None]
    waves = [x for x in candidates_of(own, effect_library()) if x.family == "cyclic"]
    found = diagnosis_of(replace(own, errors=errors), waves, alpha=0.05, most=1, seed=1, nulls=99)
    (wave,) = found.sizes.effects
    assert wave.searched is not None
    assert any(low <= 100 <= high for low, high in wave.searched.intervals)
    assert max(abs(p.value) for p in wave.parameters) < 0.1
    form = found.design.members[found.models.members(found.model)[0]].form
    (member,) = found.design.members_at(form, np.array([100.0]))
    sine, cosine = np.sort(np.linalg.norm(member.columns[:2], axis=1))
    assert (sine, cosine > 5.0) == (0.0, True)


def test_a_clock_that_starts_anew_with_each_part_does_not_go_on() -> None:
    own = noise(1)
    clock = {**own.covariates, "time_min": np.arange(float(H))[None]}
    text, more = next(follow_ups(replace(own, covariates=clock), ()))
    assert "as before" in text
    assert (more.covariates["time_min"][-1] == np.arange(H)).all()


def laser_runs(passes: int, targets: int, errors: FloatArray) -> ResidualTable:
    """Readings of dx_x, forward and then in reverse, at targets 50 mm apart."""
    places = np.full((2 * targets, 3), np.nan)
    places[:, 0] = np.tile(50.0 * np.arange(targets), 2)
    way = np.repeat([1.0, -1.0], targets)
    covariates = {"sequence": np.arange(1.0, passes + 1)[:, None], "dir_x": way[None]}
    own = table(
        passes, 2 * targets, axes=("x",), places=places, covariates=covariates,
        component="dx_x", operations=("",),
    )  # fmt: skip
    return replace(own, errors=errors[..., None])


def test_two_readings_of_five_do_not_hide_each_other() -> None:
    """The first reverse readings of a laser are far off; along the line of their pass they would
    make others so. The constant that the fit took with them is no offset.
    """
    rng, s = np.random.default_rng(5), 1e-3
    errors = s * rng.normal(size=(5, 10)) + 2e-2 * rng.normal(size=10)
    errors[0, 5:7] += (0.11, 0.045)
    errors -= errors.mean()
    own = replace(laser_runs(5, 5, errors), fitted_degree=0)
    assert np.argwhere(outliers(own)[..., 0]).tolist() == [[0, 5], [0, 6]]
    (result,) = close_loop([own], effect_library(), alpha=0.05, max_effects=1, seed=1).tables
    assert result.outliers.sum() == 2
    assert {x.candidate.name: x.p_familywise for x in result.candidates}["offset-x"] == 1.0


@pytest.mark.parametrize("slope", [0.0, 30.0])
def test_sound_readings_of_passes_that_move_are_no_outliers(slope: float) -> None:
    """Of forty tables in which one pass is at a slope at most one has any."""
    rng, along = np.random.default_rng(6), np.tile(np.linspace(-1, 1, 4), 2)
    tables = rng.normal(size=(40, 8, 8)) + 2 * rng.normal(size=(40, 8, 1))
    tables[:, 0] += slope * along
    assert sum(outliers(laser_runs(8, 4, errors)).any() for errors in 1e-3 * tables) <= 1


@pytest.mark.parametrize("features", [2, 3, 4])
def test_a_whole_part_that_is_off_is_no_outlying_entry(features: int) -> None:
    rng = np.random.default_rng(7)
    own = table(21, features, axes=("x",), covariates={})
    errors = 1e-3 * rng.normal(size=own.errors.shape) + 1e-3 * rng.normal(size=(21, 1, 1))
    errors[7] += 0.05
    own = replace(own, errors=errors)
    assert not outliers(own).any()
    assert diagnosis(own, "part-outlier").names == ["part-outlier"]


def dense_design(parts: int, lines: FloatArray) -> FloatArray:
    """Columns (P H, k): a constant for every feature, and for every part its lines."""
    H = len(lines)
    return np.column_stack([np.kron(np.eye(parts), lines), np.tile(np.eye(H), (parts, 1))])


def test_what_all_passes_have_alike_is_no_repeatability() -> None:
    """Of a profile that has no name s^2 is that of least squares with a constant for every feature
    and four lines for every pass.
    """
    rng, s = np.random.default_rng(8), 1e-3
    own = laser_runs(2, 5, s * rng.normal(size=(2, 10)) + 2e-2 * rng.normal(size=10))
    found = diagnosis(own, "trend")
    assert found.names == []
    X, y = dense_design(2, own.free_lines), own.errors[..., 0].ravel()
    _, floor = scatter_of(found)
    rest = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    assert floor == pytest.approx(np.sqrt(rest @ rest / (len(y) - np.linalg.matrix_rank(X))))


def test_what_is_left_out_deviates_as_its_prediction_says() -> None:
    """Against dense least squares of the others: the deviation over its standard deviation, times
    that of the residual if only it were left out; 0 of what is alone in its feature.
    """
    rng, P, H = np.random.default_rng(9), 5, 8
    lines = np.linalg.qr(np.vander(np.arange(float(H)), 2))[0]
    Y, measured = rng.normal(size=(P, H)), np.ones((P, H), bool)
    measured[[0, 0, 3], [6, 7, 2]] = False
    X, there = dense_design(P, lines), measured.ravel()
    hat = X @ np.linalg.pinv(X)
    inverse = np.linalg.pinv(X[there].T @ X[there])
    deviation = Y.ravel() - X @ inverse @ X[there].T @ Y.ravel()[there]
    variance = 1 + np.einsum("ni,ij,nj->n", X, inverse, X)
    expected = np.where(there, 1.0, np.sqrt((1 - np.diag(hat)) / variance)) * deviation
    found = Missing(measured, lines).deviation(Y)
    assert found.ravel() == pytest.approx(expected, abs=1e-9)
    measured[:, 5] = False
    assert Missing(measured, lines).deviation(Y)[:, 5].tolist() == [0.0] * P


@pytest.mark.parametrize("seed", range(8))
def test_few_cells_are_judged_or_refused(seed: int) -> None:
    """Six parts of two features, the second measured on three of them; and at random."""
    rng, own = np.random.default_rng(seed), noise(9, parts=6)
    errors = own.errors[:, :2].copy()
    errors[3:, 1] = np.nan
    if seed:
        own = noise(seed, parts=8)
        errors = own.errors[:, :3].copy()
        errors[rng.random((8, 3)) < 0.5] = np.nan
        errors[2] += 0.05
    few = replace(own.taken(np.arange(errors.shape[1]), 1), errors=errors)
    few = replace(few, repeats=np.isfinite(errors).all(axis=2).astype(int))
    with suppress(InputError):
        (result,) = close_loop([few], effect_library(), alpha=0.05, max_effects=1, seed=1).tables
        assert np.isfinite(result.after.rms)


def tables_that_scatter(kind: str) -> tuple[ResidualTable, str]:
    """Reversals that differ from pass to pass, passes that bend, parts that turn; and an effect."""
    rng = np.random.default_rng(8)
    if kind == "lines":
        errors = 5e-5 * rng.normal(size=(5, 22))
        errors += np.repeat([1.0, -1.0], 11) * (5e-3 + 4e-4 * rng.normal(size=(5, 1)))
        return laser_runs(5, 11, errors), "backlash"
    if kind == "bends":
        u = np.linspace(-1, 1, 21)
        bends = np.array([u**2 - 0.35, u**3 - 0.6 * u])
        errors = 2e-4 * rng.normal(size=(5, 21)) + 2e-2 * rng.normal(size=(5, 2)) @ bends
        own = laser_runs(5, 21, np.tile(errors + 4e-2 * bends[0], 2)).taken(np.arange(21), 1)
        return replace(own, covariates={"sequence": own.covariates["sequence"]}), "curvature"
    own = table(20, 24, covariates={"sequence": np.arange(1.0, 21)[:, None]}, operations=("",))
    x, y = (own.places - own.mean_places.mean(axis=0))[..., :2].transpose(2, 0, 1)
    turn = 1e-4 * rng.normal(size=(20, 1))
    errors = 1e-3 * rng.normal(size=own.errors.shape) + np.stack([2e-4 * y - turn * y, turn * x], 2)
    return replace(own, errors=errors), "squareness"


@pytest.mark.parametrize("kind", ["lines", "bends", "motions"])
def test_the_predicted_separation_is_that_of_so_many_more(kind: str) -> None:
    """As much more of the same as makes the size over its u larger by the root of their number."""
    own, family = tables_that_scatter(kind)
    found = diagnosis(own, family, "trend", "rotation-scatter")
    assert ("rotation-scatter" in found.names) == (kind == "motions")
    entry = next(x for x in found.entries if x.name.startswith(family))
    names = [found.design.candidates[x.candidate].name for x in found.design.members]
    both = ((entry.name, entry.item, 0.6), ("trend-x", names.index("trend-x"), 0.4))
    with_rival = replace(entry, credible=both)
    first = [*islice(follow_ups(found.design.table, ()), 1)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planned, "follow_ups", lambda table, rivals: iter(first))
        best = planned.experiment(found, with_rival)
    effect = next(x for x in found.sizes.effects if x.name == entry.name)
    P, k = len(own.parts), [p.row for p in effect.of_role("own")]
    sizes = np.array([p.value for p in effect.of_role("own")])
    C = found.sizes.covariance[np.ix_(k, k)]
    assert best is not None
    expected = np.sqrt(sizes @ np.linalg.solve(C, sizes) * (P + 6) / P)
    assert best.predicted_d == pytest.approx(expected, rel=0.02)
