"""What a study draws where the number of trials adapts."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from mtu_cli.model import settings


@pytest.mark.parametrize(
    ("outputs", "most"), [(1, 10_000_000), (6, 10_000_000), (60, 1_000_000), (5000, 300_000)]
)
def test_many_outputs_take_fewer_trials_each(
    outputs: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixty million values in all, as README says; not fewer than 300 000 trials."""
    asked: list[int] = []
    monkeypatch.setattr(
        settings, "monte_carlo", lambda *_, max_trials, **__: asked.append(max_trials)
    )
    model = SimpleNamespace(names=[f"d{i}" for i in range(outputs)])
    settings.Settings().run(model)
    assert asked == [most]
