"""Maps of arrows: every error is seen, to scale, and every feature has its name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from close_loop_examples import effect, on_table, result
from effect_tables import table
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from matplotlib.text import Annotation

from mtu_cli.close_loop_sealed.reports.close_loop import figure as loop_figure
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import GAP, MOST, Maps, Side, cut_of
from mtu_cli.reports.arrows import page_of as unstyled
from mtu_cli.reports.labels import folded
from mtu_cli.stats.least_squares import FloatArray

XYZ = ("x", "y", "z")
page_of = figures.styled(unstyled)


def grid(x: int = 4, y: int = 3, z: int = 3) -> FloatArray:
    """Features at the same x and y at `z` heights."""
    sides = np.meshgrid(100.0 * np.arange(z), 120.0 * np.arange(x), 130.0 * np.arange(y))
    heights, across, along = (side.ravel() for side in sides)
    return np.column_stack([across, along, 10 + 0.5 * heights])


def maps(
    places: FloatArray, factor: float = 1.0, axes: tuple[str, ...] = XYZ, covariance: bool = False
) -> Maps:
    """Errors of some um before, half as much after; along z `factor` times those in the plane."""
    n = len(places)
    errors = np.random.default_rng(3).normal(0, 5, (n, 3)) * [1, 1, factor]
    C = np.tile(np.diag([1.0, 2.0, 3.0]), (n, 1, 1)) if covariance else None
    before = Side(name="before", colour=figures.ORANGE, errors=errors, covariance=C)
    after = replace(before, name="after", colour=figures.BLUE, errors=0.5 * errors)
    ids = tuple(f"H{i + 1}" for i in range(n))
    sides = (before,) if covariance else (before, after)
    return Maps(ids=ids, places=places, axes=axes, groups=(("", sides),), k=2.0)


def quivers(page: Figure) -> list[tuple[Any, list[Quiver]]]:
    """The arrows of every panel with its title."""
    return [
        (panel, [item for item in panel.collections if isinstance(item, Quiver)])
        for panel in page.axes
        if panel.axison
    ]


def scale_of(title: str, page: Figure) -> float:
    """mm of the figure a um, as the scale's arrow of the panel's row says."""
    row = [p for p in page.axes if p.axison and p.get_title(loc="left")[:2] == title[:2]]
    for one in row:
        for text in one.texts:
            if isinstance(text, Annotation) and text.arrow_patch is not None:
                (words,) = [t.get_text() for t in one.texts if t.get_text().endswith(" um")]
                low, high = one.get_xlim()
                return float(text.xy[0] * (high - low) / float(words.removesuffix(" um")))
    raise AssertionError(title)


SURFACE = np.column_stack([grid(6, 6, 1)[:, :2], np.linspace(0, 40, 36)])
FACE = grid(1, 6, 6) @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
SOME_KNOWN = SURFACE * np.where(np.arange(36)[:, None] % 2, 1.0, [1, 1, np.nan])
HALF_KNOWN = np.where([[1, 1, i >= 3] for i in range(72)], grid(2, 3, 12), np.nan)


@pytest.mark.parametrize(
    ("places", "axes", "plane", "levels"),
    [
        (grid(), XYZ, (0, 1), ["z = 10 mm", "z = 60 mm", "z = 110 mm"]),
        (grid(), ("x", "y"), (0, 1), ["z = 10 mm", "z = 60 mm", "z = 110 mm"]),
        (grid(z=1), XYZ, (0, 1), ["z = 10 mm"]),
        (SURFACE, XYZ, (0, 1), ["z 0 to 40 mm"]),
        (grid()[:, [2, 0, 1]] * [0, 1, 1] + [100, 0, 0], XYZ, (1, 2), ["x = 100 mm"]),
        (grid() * [1, 1, np.nan], ("x", "y"), (0, 1), [""]),
        (grid(1, 1, 1), XYZ, (0, 1), ["z = 10 mm"]),
        (SOME_KNOWN, XYZ, (0, 1), ["z 1.14286 to 40 mm"]),
    ],
)  # fmt: skip
def test_the_plane_and_the_levels(
    places: FloatArray, axes: tuple[str, ...], plane: tuple[int, int], levels: list[str]
) -> None:
    found = cut_of(places, axes)
    assert found.plane == plane
    assert [level.at for level in found.levels] == levels
    assert sorted(np.concatenate([level.rows for level in found.levels])) == list(
        range(len(places))
    )


@pytest.mark.parametrize("axes", [("x", "y"), XYZ])
@pytest.mark.parametrize(("places", "panels"), [(SOME_KNOWN, 1), (HALF_KNOWN, MOST)])
def test_features_without_a_height_are_seen_from_above(
    places: FloatArray, panels: int, axes: tuple[str, ...]
) -> None:
    """From the side they would have no place, be it the side with the fewest levels."""
    assert cut_of(places, axes).plane == (0, 1)
    found = quivers(page_of(maps(places, axes=axes), ""))
    assert len(found) == panels * (len(axes) - 1)
    drawn = [len(np.asarray(own[0].U)) for _, own in found]
    assert sum(drawn[:panels]) == sum(len(level.rows) for level in cut_of(places, axes).levels)


def test_heights_that_differ_by_rounding_are_one_level() -> None:
    places = grid(z=2)
    places[:, 2] += np.random.default_rng(0).normal(0, 1e-3, len(places))
    assert [len(level.rows) for level in cut_of(places, XYZ).levels] == [12, 12]


@pytest.mark.parametrize("factor", [0.01, 1.0, 300.0])
def test_all_three_errors_of_every_feature_are_drawn_to_scale(factor: float) -> None:
    """Those across the plane upwards, whatever their size beside those in it."""
    drawn = maps(grid(), factor)
    page = page_of(drawn, "title")
    found = quivers(page)
    titles = [panel.get_title(loc="left") for panel, _ in found]
    heights = ("z = 10 mm", "z = 60 mm", "z = 110 mm")
    assert titles == [f"{e}, {z}" for e in ("Ex and Ey", "Ez (up is +)") for z in heights]
    sides = drawn.groups[0][1]
    longest: dict[str, float] = {}
    for title, (panel, arrows) in zip(titles, found, strict=True):
        rows = np.flatnonzero(np.isclose(drawn.places[:, 2], float(title.split()[-2])))
        scale = scale_of(title, page)
        for side, item in zip(sides, arrows, strict=True):
            own = side.errors[rows]
            wanted = own[:, :2] if "Ex" in title else np.column_stack([0 * own[:, 2], own[:, 2]])
            shown = np.column_stack([np.asarray(item.U), np.asarray(item.V)])
            np.testing.assert_allclose(shown, scale * wanted, rtol=1e-9, atol=1e-9 * scale)
            tips = np.asarray(item.get_offsets()) + shown
            assert (tips > [panel.get_xlim()[0], panel.get_ylim()[0]]).all()
            assert (tips < [panel.get_xlim()[1], panel.get_ylim()[1]]).all()
            longest[title[:2]] = max(longest.get(title[:2], 0.0), np.abs(shown).max())
    # Neither is lost beside the other.
    assert min(longest.values()) > 0.2 * max(longest.values())


@pytest.mark.parametrize("uncertain", [False, True])
def test_names_keep_clear_of_one_another(uncertain: bool) -> None:
    page = page_of(maps(grid(z=1), covariance=uncertain), "")
    with figures.house_style():
        page.draw_without_rendering()
    for panel, _ in quivers(page):
        texts: list[Any] = [text for text in panel.texts if text.get_text().startswith("H")]
        boxes = [text.get_window_extent() for text in texts]
        assert len(boxes) == 12
        for i, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[i + 1 :])
            assert panel.bbox.padded(GAP * figures.DOTS_PER_INCH).contains(box.x0, box.y0)


def test_what_did_not_change_is_seen_behind_what_it_became() -> None:
    drawn = maps(grid(z=2))
    before, _ = drawn.groups[0][1]
    same = replace(drawn, groups=(("", (before, replace(before, colour=figures.BLUE))),))
    first, second = quivers(page_of(same, ""))[0][1]
    assert first.width is not None
    assert second.width is not None
    assert first.width > 1.5 * second.width


def test_levels_that_are_not_drawn_are_told() -> None:
    """Every axis has more levels than a sheet."""
    count = MOST + 3
    page = page_of(maps(grid(count, count, count), axes=("x", "y")), "title")
    assert page.get_suptitle() == f"title ({MOST} of {count} levels)"
    titles = [panel.get_title(loc="left") for panel, _ in quivers(page)]
    assert (len(titles), titles[0], titles[-1]) == (
        MOST, "Ex and Ey, z = 10 mm", "Ex and Ey, z = 560 mm",
    )  # fmt: skip


@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 1), (12, 2, 3), (2, 8, 2), (2, 2, 5)])
def test_parts_of_every_shape_can_be_drawn(shape: tuple[int, int, int]) -> None:
    drawn = maps(grid(*shape))
    page = page_of(drawn, "")
    assert sum(len(arrows) == 2 for _, arrows in quivers(page)) == 2 * shape[2]
    width, height = page.get_size_inches()
    assert 0.3 < width / height < 4


def test_no_errors_and_errors_that_are_not_known_can_be_drawn() -> None:
    """An axis that no feature was measured along has no panels; other features go without."""
    drawn = maps(grid(2, 2, 2))
    (before, after) = drawn.groups[0][1]
    nothing = replace(before, errors=np.zeros((8, 3)))
    holed = after.errors.copy()
    holed[0, 2], holed[1] = np.nan, np.nan
    # Of a whole level.
    holed[drawn.places[:, 2] > 50, 2] = np.nan
    unknown = before.errors * [1, 1, np.nan]
    still = replace(drawn, groups=(("", (nothing,)),))
    assert len(quivers(page_of(still, ""))) == 2
    for errors, panels in ((holed, 4), (unknown, 2)):
        sides = (
            replace(nothing, errors=nothing.errors + 0 * errors),
            replace(after, errors=errors),
        )
        page = page_of(replace(drawn, groups=(("", sides),)), "")
        found = quivers(page)
        assert len(found) == panels
        numbers = [np.asarray([item.U, item.V]) for _, own in found for item in own]
        assert all(np.isfinite(own).all() for own in numbers)
        shown = sum(own.shape[1] for own in numbers) / 2
        known = np.isfinite(errors[:, :2]).all(axis=1).sum() + np.isfinite(errors[:, 2]).sum()
        assert shown == known


def test_a_loss_along_z_is_seen_in_the_picture_of_the_loop() -> None:
    """In x and y nothing changes; features of two operations are in panels of their own."""
    lost = effect("backlash-z", equations={"Ez": "lost_motion*dir_x"})
    places = np.repeat(grid(3, 2, 1), 2, axis=0)
    residuals = table(9, 12, axes=XYZ, places=places, operations=("drilled", "milled"))
    names = tuple(f"{o} H{i}" for i in range(6) for o in ("drilled", "milled"))
    errors = np.random.default_rng(1).normal(0, 3e-3, (9, 12, 3))
    explained = np.zeros_like(errors)
    explained[:, :, 2] = 5e-3
    item = on_table(
        "named", (lost,), explained=explained,
        table=replace(residuals, errors=errors + explained, features=names),
    )  # fmt: skip
    found = [entry for entry in quivers(loop_figure(result(item))) if len(entry[1]) == 2]
    titles = [panel.get_title(loc="left") for panel, _ in found]
    assert titles == [
        f"{operation}, {what}, z = 10 mm"
        for operation in ("drilled", "milled")
        for what in ("Ex and Ey", "Ez (up is +)")
    ]
    for title, (_, (before, after)) in zip(titles, found, strict=True):
        same = np.allclose(np.asarray(before.V), np.asarray(after.V))
        assert same == ("Ex" in title)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("H1", "H1"),
        ("bore 3 of the upper flange", "bore 3 of the\nupper flange"),
        ("bore of the upper flange, left of the rib", "bore of the\nupper f…he rib"),
        ("a" * 60, "a" * 14 + "\n" + "aaaaaaa…aaaaaa"),
    ],
)  # fmt: skip
def test_long_names_are_folded(name: str, shown: str) -> None:
    assert folded(name, 14) == shown
