"""What a fold has of the candidates, and what it keeps of them on all cells."""

import numpy as np
from loop_tables import candidate

from mtu_cli.close_loop_sealed.analyses.loop.folds import cut_candidates, identity
from mtu_cli.close_loop_sealed.model.effect_candidate import Column


def test_steps_that_are_the_same_on_what_is_kept_foretell_their_mean() -> None:
    number = np.arange(12)
    columns: list[Column] = [{0: np.asarray(number >= at, float)[:, None]} for at in range(2, 11)]
    steps = candidate("step", *((column,) for column in columns))
    kept = (number < 5) | (number > 7)
    own = cut_candidates([steps], kept, 0)
    (left,) = own.candidates
    # From part 5, 6, 7 or 8 on, counted from 0: parts 5 to 7 are not there to tell.
    assert len(left.members) == 3 + 1 + 2
    (between,) = (m for m in left.members if m.columns[0][0].sum() == 4 and kept[5:].sum() == 4)
    whole = own.whole[identity("step", between)].columns[0][0][:, 0]
    np.testing.assert_allclose(whole, [0, 0, 0, 0, 0, 0.25, 0.5, 0.75, 1, 1, 1, 1])
    # It is as likely as all that it stands for.
    assert own.weights[identity("step", between)] == 4.0
    assert sum(own.weights.values()) == len(columns)
