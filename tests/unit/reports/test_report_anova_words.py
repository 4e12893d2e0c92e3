"""What is said of the scatter in x and y: sentences with the ratio and its interval."""

from __future__ import annotations

import pytest
from measured_examples import study

from mtu_cli.analyses.anova import analyse_variance
from mtu_cli.analyses.anova.axis_scatter import AxisScatter
from mtu_cli.model.settings import Settings
from mtu_cli.reports.anova import document
from mtu_cli.reports.anova_words import _axes, sentences
from mtu_cli.stats.scatter_ratio import ScatterRatio

INF, NAN = float("inf"), float("nan")


@pytest.mark.parametrize(
    ("s", "low", "high", "p", "said"),
    [
        (0.097, 0, 0.3, 1e-5, "x scatters at least 3.3 times as much as y {of} (p <0.001)."),
        (0, 0, 0.16, 0.002, "x scatters at least 6.2 times as much as y {of} (p = 0.002)."),
        (3, 2, INF, 0.002, "y scatters at least 2.0 times as much as x {of} (p = 0.002)."),
        (NAN, 2, INF, 0.002, "y scatters at least 2.0 times as much as x {of} (p = 0.002)."),
        (2, 1.5, 3, 0.01, "y scatters 2.0 times as much as x {of} (95 %: 1.5 to 3.0, p = 0.010)."),
        (0.5, 0.4, 0.8, 0.01, "x scatters 2.0 times as much as y {of} (95 %: 1.2 to 2.5, "
         "p = 0.010)."),
        (2, 1.98, 2.02, 0.01, "y scatters 2.0 times as much as x {of} (95 %: 2.0, p = 0.010)."),
        (0.2, 0, 1.1, 0.04, "x scatters more than y {of} (p = 0.040)."),
        (0.8, 0, 1.7, 0.4, "No sign that y scatters more than x or less {of} (s ratio y/x 0.80, "
         "95 %: 0 to 1.7, p = 0.40)."),
        (3, 0.5, INF, 0.2, "No sign that y scatters more than x or less {of} (s ratio y/x 3.0, "
         "95 %: 0.50 or more, p = 0.20)."),
        (NAN, 0, INF, 0.7, "No sign that y scatters more than x or less {of} (s ratio y/x 95 %: "
         "no bounds, p = 0.70)."),
        (0, NAN, NAN, 0.03, "Parts scatter in x, and not to be seen in y (p = 0.030)."),
        (NAN, NAN, NAN, 0.12, "Parts scatter in y, and not to be seen in x (p = 0.12, which may "
         "be chance)."),
        (NAN, NAN, NAN, NAN, "Nothing scatters from part to part in x or y."),
    ],
)  # fmt: skip
def test_ratio_and_interval_in_words(
    s: float, low: float, high: float, p: float, said: str
) -> None:
    test = ScatterRatio(ratio=s**2, p=p, p_familywise=p, rows=21)
    item = AxisScatter(operation="", test=test, interval=(low**2, high**2), apart=True)
    assert _axes(item) == said.format(of="from part to part")


@pytest.mark.parametrize("parts", [1, 2, 3, 4])
def test_the_axes_are_always_compared_or_it_is_said_why_not(parts: int) -> None:
    result = analyse_variance(study(parts, 2, 3), None, "reml", Settings())
    entries = document(result)["axis_scatter"]
    if parts == 1:
        assert (sentences(result)[0][:9], entries) == ("One part:", [])
        return
    (entry,) = entries
    assert entry["parts"] == parts
    assert len(entry["variance_ratio_interval95"]) == 2
    assert (entry["p"] is None) == (parts < 4)
    few = f"{parts} parts are too few to compare the scatter in x and y."
    assert (few in sentences(result)) == (parts < 4)
    assert parts < 4 or "from part to part" in sentences(result)[-1]
