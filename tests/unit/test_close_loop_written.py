"""What is warned of where a machine is written from what may be no more than a hint."""

from __future__ import annotations

from dataclasses import replace

import pytest
from close_loop_examples import effect, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.cli.close_loop import _doubts

GROWTH = ScatterSize(
    parameter=("s", "um/m", 17e-6, 2.8e-6),
    by_axis=(("x", 24.2e-6), ("y", 0.4e-6)),
    u_by_axis=(4.1e-6, 3.2e-6),
    p_alike=1e-9,
)
PLAY = effect()
SCATTER = effect("scale-scatter", parameters=(), equations={}, kind="scatter", scatter=GROWTH)
OTHER = effect("backlash-y", class_names=("backlash-y", "trend-y"))
HINT, ONE_OF = "what is written is a hint: something", "of effects that this data cannot tell apart"


@pytest.mark.parametrize(
    ("verdict", "effects", "changed", "told"),
    [
        ("named", (PLAY,), {}, []),
        # What has no name lies in the scatter, which is not written.
        ("unexplained", (replace(SCATTER, axis=None), PLAY), {}, []),
        ("unexplained", (PLAY,), {"fired": ("serial-shape",)}, [HINT]),
        ("class", (PLAY, OTHER), {}, [ONE_OF]),
        ("unexplained", (PLAY, OTHER), {"nameless": ("unnamed-drift-y",)},
         ["of what is written backlash-y is a hint"]),
        ("unexplained", (SCATTER,), {"fired": ("serial-shape",)}, []),
    ],
)  # fmt: skip
def test_a_hint_that_is_written_is_told(
    verdict: str, effects: tuple[FoundEffect, ...], changed: dict[str, object], told: list[str]
) -> None:
    found = result(on_table(verdict, effects, **changed))  # type: ignore[arg-type]
    said = _doubts(found, True)
    assert len(said) == len(told)
    assert all(own.message.startswith(text) for own, text in zip(said, told, strict=True))
    assert _doubts(found, False) == []
