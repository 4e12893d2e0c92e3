"""What stands beside an effect in its class: what acts where it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from separation_examples import index, members_of, prepared_day

from mtu_cli.close_loop_sealed.analyses.loop.ranking import ranked
from mtu_cli.close_loop_sealed.analyses.loop.state import Step


@pytest.mark.parametrize("name", ["squareness-xy", "scale-y", "rotation-z"])
def test_what_acts_along_other_axes_alone_is_no_rival(name: str) -> None:
    """By the letters of the equations; a scatter lies in all axes."""
    prepared = prepared_day("A", 3)
    scan = prepared.scan

    def axes(i: int) -> set[str]:
        own = prepared.candidates[i]
        by_equations = {key[1:] for member in own.members for key in member.equations}
        return by_equations or ({own.axis} if own.axis else {"x", "y"})

    own, member = index(prepared, name), members_of(prepared, name)[0]
    step = Step(index=own, member=member, p=0.01, log_bayes=1.0, posterior=0.5, credible=(own,))
    along = {key[1:] for key in prepared.members[member].equations}
    unnamed = np.full(2 * len(prepared.table.axes), -np.inf)
    found = ranked(scan, step, np.zeros(len(prepared.candidates)), unnamed)
    offsets = set(range(len(scan.columns), scan.tested))
    rivals = {i for i in range(len(prepared.candidates)) if axes(i) & along} - offsets
    assert set(found.credible) <= rivals
    assert found.posterior == pytest.approx(1 / len(rivals))
    # What is constant is a mean error and nothing else, whatever is there beside it.
    for first in sorted(offsets):
        level = replace(step, index=first, member=-1, credible=(first,))
        found = ranked(scan, level, np.zeros(len(prepared.candidates)), unnamed)
        assert (found.credible, found.posterior) == ((first,), 1.0)


def test_a_scatter_has_rivals_along_all_axes() -> None:
    prepared = prepared_day("A", 3)
    count, first = len(prepared.candidates), prepared.scan.tested
    step = Step(index=first, member=-1, p=0.01, log_bayes=1.0, posterior=0.5, credible=(first,))
    unnamed = np.full(2 * len(prepared.table.axes), -np.inf)
    scores = np.full(count, -np.inf)
    means = [index(prepared, name) for name in ("scale-x", "scale-y")]
    scores[[first, *means]] = 0.0
    found = ranked(prepared.scan, step, scores, unnamed)
    assert set(found.credible) == {first, *means}
    assert found.posterior == pytest.approx(1 / 3)
