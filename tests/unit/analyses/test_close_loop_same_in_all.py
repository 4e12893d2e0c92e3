"""Two sizes of one effect: the rate of the t test, what is told of it, and what stands beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.special import stdtr, stdtrit
from scipy.stats import binom

from mtu_cli.close_loop_sealed.analyses.loop import otherwise, varying
from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.otherwise import DOUBTED, MATTERS, with_otherwise
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import (
    DISAGREES,
    Constant,
    constants,
    with_constants,
)
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import same_of
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.varying import _alike, _shape, _times, at_reference
from mtu_cli.close_loop_sealed.model.effect_library import candidates

GROWTH, NOISE = 12e-6, 1.3e-3
"""1/K and mm."""
X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)
FEW = replace(LIBRARY, families=tuple(
    own for own in LIBRARY.families if own.family.family in ("scale", "thermal-growth")
))  # fmt: skip


def day(
    seed: int,
    scale: float = 0.0,
    turn: float = 4e-6,
    within: float = 0.0,
    ends: tuple[float, float] = (24.0, 28.0),
    shift: float = 0.0,
) -> tuple[Prepared, Step]:
    """Eight parts at 24 to 28 degC, or other `ends`: what grows by 6 K on the mean is near to a
    scale of 72 um/m. The growth counted from 20 degC as it would be found; each part's scale is
    `turn` off, and it gets warmer by `within` from its first hole to the last. All lie off by
    `shift`.
    """
    rng = np.random.default_rng(seed)
    T = rng.permutation(np.linspace(*ends, 8))[:, None]
    T = T + within * np.linspace(-0.5, 0.5, 12) if within else T
    own = table(
        8,
        12,
        axes=("x",),
        places=PLACES,
        covariates={"T_scale_degC": T, "sequence": np.arange(1.0, 9.0)[:, None]},
    )
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = shift + rng.normal(0.0, NOISE, (8, 12)) + rng.normal(0.0, 2e-3, (8, 1))
    errors += (scale + GROWTH * (T - 20.0) + rng.normal(0.0, turn, (8, 1))) * (X.ravel() - 200.0)
    own = replace(own, errors=errors[..., None])
    prepared = prepare(own, candidates(own, FEW), own.pass_dof)
    names = [c.name for c in prepared.candidates]
    index = names.index("thermal-growth-x")
    start = sum(len(columns) for columns in prepared.scan.columns[:index])
    (member,) = (
        m
        for m in range(start, start + len(prepared.scan.columns[index]))
        if "(T_scale_degC - 20)" in prepared.members[m].equations["Ex"]
    )
    return prepared, Step(
        index=index, member=member, p=0.0, log_bayes=9.0, posterior=1.0, credible=(index,)
    )


def told(prepared: Prepared, step: Step) -> Constant:
    (own,) = constants(prepared, [step.member])
    assert prepared.candidates[own.index].name == "scale-x"
    return own


def test_a_constant_is_told_by_chance_as_often_as_stated() -> None:
    runs = 400
    p = np.array([told(*day(seed)).p for seed in range(runs)])
    for alpha in (0.05, 0.3):
        # Welch's degrees of freedom are no more than near.
        hits = int((p < alpha).sum())
        assert binom.ppf(1e-3, runs, 0.7 * alpha) <= hits <= binom.ppf(1 - 1e-3, runs, 1.2 * alpha)


def test_growth_and_constant_are_the_line_of_the_parts_slopes() -> None:
    """Against the slopes of single parts, and their line in the temperature."""
    prepared, step = day(3, scale=60e-6)
    x = X.ravel() - 200.0
    slopes = prepared.table.errors[..., 0] - prepared.table.errors[..., 0].mean(axis=1)[:, None]
    slopes = slopes @ (x - x.mean()) / ((x - x.mean()) @ (x - x.mean()))
    T = prepared.table.covariates["T_scale_degC"][:, 0] - 20.0
    line, (s2,), *_ = np.linalg.lstsq(np.stack([T, np.ones(8)], axis=1), slopes)
    C = np.linalg.inv(np.stack([T, np.ones(8)]) @ np.stack([T, np.ones(8)], axis=1)) * s2 / 6
    own = told(prepared, step)
    assert own.beta[0] == pytest.approx(line[0], rel=1e-9)
    # The slopes in y that go along with those in x by chance are weighted, too.
    assert own.value == pytest.approx(line[1], rel=0.01)
    # By the scatter of single entries and of parts, where the line's is one of six: chi^2 of it.
    assert line[1] / np.sqrt(C[1, 1]) / own.t == pytest.approx(1.0, abs=0.3)
    assert own.dof == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("scale", [0.0, 20e-6, 60e-6])
def test_the_growth_beside_a_constant_is_covered_as_often_as_stated(scale: float) -> None:
    runs, held = 100, np.zeros(2, int)
    for seed in range(runs):
        own = told(*day(seed, scale))
        k = float(stdtrit(own.dof, 0.975))
        held[0] += abs(own.beta[0] - GROWTH) < k * np.sqrt(own.covariance[0, 0])
        held[1] += abs(own.value - scale) < k * own.u
    for count in held.tolist():
        assert binom.ppf(1e-3, runs, 0.95) <= count <= binom.ppf(1 - 1e-3, runs, 0.97)


@pytest.mark.parametrize("within", [0.02, 1.0])
def test_it_is_hidden_also_where_the_temperature_drifts_within_a_part(within: float) -> None:
    """Then a growth at the mean over the parts is no exact multiple of a scale."""
    found = []
    for scale in (0.0, 45e-6):
        prepared, step = day(4, scale, within=within)
        gate = calibrated(prepared.scan, 99, 1)
        steps, _ = with_constants(prepared, gate, [step], 0.05, 4)
        found.append([prepared.candidates[own.index].name for own in steps])
    assert found == [["thermal-growth-x"], ["thermal-growth-x", "scale-x"]]


def test_what_stands_beside_has_the_p_of_all_tests() -> None:
    prepared, step = day(2, 60e-6)
    gate = calibrated(prepared.scan, 199, 1)
    (_, constant), _ = with_constants(prepared, gate, [step], 0.05, 4)
    own = told(prepared, step)
    assert own.p < constant.p == pytest.approx(gate.family_p(np.array([-np.log(own.p)]))[0])
    assert constant.constant
    n = own.dof + 1
    ratio = own.dof * np.log1p(own.t**2 / own.dof)
    assert constant.log_bayes == pytest.approx(0.5 * ratio * (n - 1) / n - 0.5 * np.log1p(n))
    # A candidate that is not looked for, or was found, is not taken; nor at a smaller rate.
    assert with_constants(prepared, gate, [step], 0.05, 4, frozenset({constant.index})) == (
        [step],
        False,
    )
    assert with_constants(prepared, gate, [step, constant], 0.05, 4) == ([step, constant], False)
    assert with_constants(prepared, gate, [step], 0.5 * own.p, 4) == ([step], False)
    # Beside it there is nothing left that is hidden.
    assert not [*constants(prepared, [step.member, constant.member])]


def test_only_what_is_told_at_one_in_a_hundred_stands_beside() -> None:
    taken = {}
    for seed in range(40):
        prepared, step = day(seed, 25e-6)
        gate = calibrated(prepared.scan, 99, 1)
        taken[told(prepared, step).p] = len(with_constants(prepared, gate, [step], 0.05, 4)[0]) == 2
    assert all(p < DISAGREES for p, own in taken.items() if own)
    assert any(0.01 < p < 0.03 for p in taken)
    assert any(p < 0.01 for p in taken)


def other_form(prepared: Prepared, step: Step) -> int:
    """The growth counted from the mean of the day."""
    start = sum(len(columns) for columns in prepared.scan.columns[: step.index])
    forms = range(start, start + len(prepared.scan.columns[step.index]))
    (other,) = (m for m in forms if m != step.member)
    return other


def test_two_forms_of_one_growth_are_a_growth_and_a_constant() -> None:
    """One from 20 degC and one from the mean of the day: they differ in a scale alone."""
    prepared, step = day(4, -60e-6)
    gate = calibrated(prepared.scan, 199, 1)
    other = other_form(prepared, step)
    (found, _) = with_constants(prepared, gate, [step, replace(step, member=other)], 0.05, 4)
    assert found[0] is step
    assert [prepared.candidates[own.index].name for own in found[1:]] == ["scale-x"]


def test_the_second_form_is_a_constant_where_the_first_is_the_same_in_no_part() -> None:
    """One from the mean of the day hides no scale: nothing but the second form has told it."""
    prepared, step = day(4, -60e-6)
    gate = calibrated(prepared.scan, 199, 1)
    other = other_form(prepared, step)
    (own,) = prepared.scan.flat()[other]
    assert not same_of(prepared.scan, own)
    mean = replace(step, member=other, p=2e-3)
    ((first, scale), stopped) = with_constants(prepared, gate, [mean, step], 0.05, 4)
    assert first is mean
    assert (prepared.candidates[scale.index].name, scale.p) == ("scale-x", step.p)
    assert scale.constant
    assert not stopped
    # One that is not looked for does not take the place of it: nor is it lost then.
    for order in ([mean, step], [step, mean]):
        unsure = frozenset({scale.index})
        assert with_constants(prepared, gate, order, 0.05, 4, unsure) == (order, False)
    # One that was found by itself is not found twice.
    again = replace(scale, constant=False)
    assert with_constants(prepared, gate, [mean, again, step], 0.05, 4) == ([mean, again], False)


def test_a_second_form_stays_where_no_candidate_is_its_constant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    growths = tuple(own for own in FEW.families if own.family.family == "thermal-growth")
    monkeypatch.setitem(day.__globals__, "FEW", replace(FEW, families=growths))
    prepared, step = day(4, -60e-6)
    gate = calibrated(prepared.scan, 199, 1)
    other = replace(step, member=other_form(prepared, step))
    for order in ([other, step], [step, other]):
        assert with_constants(prepared, gate, order, 0.05, 4) == (order, False)


def test_what_is_not_hidden_has_to_pass_all_tests() -> None:
    """A large scale is there for all tests to find: its own p is not enough."""
    for scale, hidden in ((40e-6, True), (200e-6, False)):
        prepared, step = day(5, scale)
        gate = calibrated(prepared.scan, 199, 1)
        own = told(prepared, step)
        assert own.hidden == hidden
        assert own.p < 0.01
        (found, _) = with_constants(prepared, gate, [step], 1.5 * own.p, 4)
        assert (len(found) == 2) == hidden
        (found, _) = with_constants(prepared, gate, [step], 0.05, 4)
        assert len(found) == 2


def test_constants_are_causes_that_may_be_too_many() -> None:
    prepared, step = day(4, 120e-6)
    gate = calibrated(prepared.scan, 199, 1)
    assert with_constants(prepared, gate, [step], 0.05, 1) == ([step], True)
    (found, stopped) = with_constants(prepared, gate, [step], 0.05, 2)
    assert (len(found), stopped) == (2, False)


def test_a_hidden_effect_keeps_its_own_class() -> None:
    """Beside the growth that hides it what fits the means is looked at, not what is left of them:
    all that might be there instead would be as likely.
    """
    prepared, _ = day(4, 120e-6)
    gate = calibrated(prepared.scan, 299, 1)
    seen = search(prepared, gate, alpha=0.05, most=4)
    names = {prepared.candidates[s.index].name: s for s in seen.steps}
    assert {"thermal-growth-x", "scale-x"} <= set(names)
    scale = names["scale-x"]
    assert scale.credible == (scale.index,)
    assert scale.posterior > 0.95


def test_no_more_causes_than_asked_for() -> None:
    prepared, _ = day(4, 60e-6)
    gate = calibrated(prepared.scan, 299, 1)
    one, two = (search(prepared, gate, alpha=0.05, most=most) for most in (1, 2))
    assert [len(seen.members) for seen in (one, two)] == [1, 2]
    assert one.stopped
    assert not two.stopped


def described(prepared: Prepared, step: Step) -> FoundEffect:
    """One effect as the report has it, with what it would be beside another."""
    gate = calibrated(prepared.scan, 199, 1)
    nothing = search(prepared, gate, alpha=1e-300, most=1)
    found = replace(nothing, steps=(step,))
    told = Described(prepared=prepared, found=found, effects=added(prepared, found, 1), chosen=())
    (effect,) = with_otherwise(told, found_effects(told, [None]))
    return effect


def scale_step(prepared: Prepared, step: Step) -> Step:
    names = [own.name for own in prepared.candidates]
    index = names.index("scale-x")
    member = sum(len(columns) for columns in prepared.scan.columns[:index])
    return replace(step, index=index, member=member, credible=(index,))


def test_a_scale_is_given_as_it_would_be_beside_a_growth() -> None:
    """The same estimate as a growth beside a scale, told of the scale."""
    prepared, step = day(6, ends=(25.7, 26.3))
    effect = described(prepared, scale_step(prepared, step))
    (other,) = effect.otherwise
    own = told(prepared, step)
    assert (other.name, other.covariate) == ("thermal-growth-x", "T_scale_degC")
    assert other.at_reference
    assert other.parameter[:2] == ("scale", "um/m")
    assert other.parameter[2:] == pytest.approx((own.value, own.u))
    assert other.constant[:2] == ("growth", "um/m/K")
    assert other.constant[2:] == pytest.approx((own.beta[0], np.sqrt(own.covariance[0, 0])))
    t = own.beta[0] / np.sqrt(own.covariance[0, 0])
    assert 2 * stdtr(6.0, -abs(t)) == pytest.approx(other.p, rel=0.3)
    assert effect.holds_within == ("T_scale_degC",)


def test_an_offset_is_given_as_it_would_be_beside_a_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the line of the parts' means in the temperature: what it is at 20 degC."""
    more = ("thermal-drift", "offset")
    also = tuple(own for own in LIBRARY.families if own.family.family in more)
    monkeypatch.setitem(day.__globals__, "FEW", replace(FEW, families=(*FEW.families, *also)))
    prepared, step = day(6, ends=(25.7, 26.3))
    index = len(prepared.scan.columns)
    offset = replace(step, index=index, member=-1, credible=(index,))
    effect = described(prepared, offset)
    (other,) = effect.otherwise
    means = prepared.table.errors[:, :, 0].mean(axis=1)
    T = prepared.table.covariates["T_scale_degC"][:, 0]
    line, (s2,), *_ = np.linalg.lstsq(np.stack([T - T.mean(), np.ones(8)], axis=1), means)
    assert other.name == "thermal-drift-x"
    assert other.constant[2] == pytest.approx(line[0])
    assert other.constant[3] == pytest.approx(
        np.sqrt(s2 / 6 / ((T - T.mean()) ** 2).sum()), rel=0.1
    )
    _, _, shift, u = effect.parameters[0]
    assert other.parameter[2] == pytest.approx(shift - 6.0 * line[0])
    assert other.parameter[3] == pytest.approx(np.hypot(u, 6.0 * other.constant[3]))
    # At the temperature of ISO 1 nothing is to be told.
    prepared, step = day(6, ends=(19.7, 20.3))
    assert described(prepared, offset).otherwise == ()


def test_a_level_is_told_as_an_offset_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The constant of a step's equation, which takes an offset up, is that of the temperature."""
    more = ("thermal-drift", "offset", "step")
    also = tuple(own for own in LIBRARY.families if own.family.family in more)
    monkeypatch.setitem(day.__globals__, "FEW", replace(FEW, families=(*FEW.families, *also)))
    prepared, step = day(6, ends=(25.7, 26.3), shift=12e-3)
    names = [own.name for own in prepared.candidates]
    index = names.index("step-x")
    first = sum(len(columns) for columns in prepared.scan.columns[:index])
    jump = replace(step, index=index, member=first + 3, credible=(index,))
    effect = described(prepared, jump)
    (other,) = effect.otherwise
    name, _, value, u = effect.parameters[-1]
    assert (other.parameter[0], name) == ("level", "level")
    assert other.name == "thermal-drift-x"
    assert other.parameter[2] == pytest.approx(value - 6.0 * other.constant[2])
    assert other.parameter[3] == pytest.approx(np.hypot(u, 6.0 * other.constant[3]))
    assert effect.holds_within == ("T_scale_degC",)


def test_what_would_differ_is_told_though_it_is_as_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts from 20 to 25 degC tell a scale at 20 degC nearly as well beside a growth."""
    prepared, step = day(6, ends=(20.0, 25.0))
    scale = scale_step(prepared, step)
    effect = described(prepared, scale)
    (other,) = effect.otherwise
    _, _, value, u = effect.parameters[0]
    assert other.p < DOUBTED
    assert other.parameter[3] < MATTERS * u
    assert abs(other.parameter[2] - value) > u
    monkeypatch.setattr(otherwise, "DOUBTED", 0.5 * other.p)
    assert described(prepared, scale).otherwise == ()


def test_the_surest_of_several_has_the_p_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale of x beside a growth and a growth of all axes that is the same here."""
    prepared, step = day(6, ends=(25.7, 26.3))
    scale = scale_step(prepared, step)
    (one,) = described(prepared, scale).otherwise
    likes = list(_alike(prepared, [scale], _shape(prepared, scale)))
    assert len(likes) == 1
    monkeypatch.setattr(varying, "_alike", lambda *_: iter(likes * 3))
    (three,) = described(prepared, scale).otherwise
    assert three.p == pytest.approx(1 - (1 - one.p) ** 3)


@pytest.mark.parametrize("ends", [(25.7, 26.3), (20.0, 25.0)])
def test_what_it_is_at_20_degC_is_the_same_whatever_the_growth_is_counted_from(
    ends: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scale and a growth span the same from 20 degC and from the mean of the day on."""
    prepared, step = day(6, ends=ends)
    scale = scale_step(prepared, step)
    shape = _shape(prepared, scale)
    assert shape is not None
    (from_20,) = _alike(prepared, [scale], shape)
    m = other_form(prepared, step)
    found = _times(prepared.table, prepared.members[m], shape)
    assert found is not None
    from_mean = replace(from_20, member=m, ratio=found[0], zero=found[1], mean=found[2])
    assert from_20.zero == pytest.approx(20.0)
    assert from_mean.zero == pytest.approx(np.mean(ends))
    told_at = []
    for like in (from_20, from_mean):
        monkeypatch.setattr(varying, "_alike", lambda *_, like=like: iter([like]))
        told_at.append(at_reference(prepared, [scale], scale, (0.0, 1.0)))
    one, other = told_at
    assert one is not None
    assert other is not None
    assert other.value == pytest.approx(one.value, rel=1e-6)
    assert other.u == pytest.approx(one.u, rel=1e-6)
    assert other.p == pytest.approx(one.p, rel=1e-6)


def test_what_is_found_is_not_told_of_again() -> None:
    """Neither beside itself, nor of what varies or is no effect of a temperature."""
    prepared, step = day(6, ends=(25.7, 26.3))
    scale = scale_step(prepared, step)
    assert list(_alike(prepared, [scale, step], _shape(prepared, scale))) == []
    assert list(_alike(prepared, [step], _shape(prepared, step))) == []


def test_no_growth_is_told_of_where_it_would_change_little() -> None:
    """About 20 degC a scale is as certain beside a growth."""
    prepared, step = day(6, scale=60e-6, ends=(18.5, 22.5))
    assert described(prepared, scale_step(prepared, step)).otherwise == ()


def test_what_was_not_told_is_given_as_it_would_be() -> None:
    prepared, step = day(6)
    effect = described(prepared, step)
    (other,) = effect.otherwise
    own = told(prepared, step)
    assert other.name == "scale-x"
    assert other.parameter[:2] == ("growth", "um/m/K")
    assert other.parameter[2:] == pytest.approx((own.beta[0], np.sqrt(own.covariance[0, 0])))
    assert other.constant[:2] == ("scale", "um/m")
    assert other.constant[2:] == pytest.approx((own.value, own.u))
    assert other.p == pytest.approx(own.p)
    # By itself it is more certain: if there is no scale.
    assert effect.parameters[0][3] < other.parameter[3]


def test_nothing_is_told_where_it_would_be_no_less_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the scatter that is left of a table happens to be less beside it."""
    prepared, step = day(6, ends=(18.0, 26.0))
    (other,) = described(prepared, step).otherwise
    assert other.p > DOUBTED
    monkeypatch.setattr(otherwise, "_u_of", lambda *_: other.parameter[3])
    assert described(prepared, step).otherwise == ()
    # What is likely is told in any case.
    monkeypatch.setattr(otherwise, "DOUBTED", 1.0)
    assert described(prepared, step).otherwise == (other,)
