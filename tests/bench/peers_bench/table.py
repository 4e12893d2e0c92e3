"""What was measured, as a table of ratios."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from peers_bench.rounds import Series
from peers_bench.tools import ADAPTIVE, BARE, OURS, PEERS, Tool

NOTHING = "-"
LISTED = (BARE, OURS, ADAPTIVE, *PEERS)


def in_columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Texts in columns: the first to the left, the others to the right."""
    table = [list(row) for row in rows]
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    return [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    ]


def shown(name: Tool) -> str:
    return "only drawing the normals" if name == BARE else name.name


def monte_carlo(
    one: Mapping[str, Series],
    free: Mapping[str, Series],
    memory: Mapping[str, float] | None = None,
) -> list[str]:
    """Trials, then time over that of the bare normals and over `mtu`'s, one thread and default.

    The reference of default threads is still one thread of numpy.
    """
    head = ["", "trials", "1 thread: / bare", "/ mtu", "cpu / mtu", "default: / bare", "/ mtu"]
    rows = [head + ([] if memory is None else ["MiB"])]
    for tool in LISTED:
        if not tool.monte_carlo or (tool.installed and tool.name not in one):
            continue
        if not tool.installed:
            rows.append([shown(tool), "not installed", *[""] * (len(rows[0]) - 2)])
            continue
        series, own = one[tool.name], free[tool.name]
        row = [shown(tool), f"{'~' if tool.slow else ''}{_trials(tool, series)}"]
        row += [f"{series.over(one[BARE.name]):.2f}", f"{series.over(one[OURS.name]):.2f}"]
        row += [f"{series.cpu_over(one[OURS.name]):.2f}"]
        row += [f"{own.over(free[BARE.name]):.2f}", f"{own.over(free[OURS.name]):.2f}"]
        if memory is not None:
            row.append(f"{memory[tool.name]:.0f}" if tool.name in memory else NOTHING)
        rows.append(row)
    return in_columns(rows)


def _trials(tool: Tool, series: Series) -> str:
    if tool == ADAPTIVE:
        return "its own"
    return f"{series.trials * (5 if tool.slow else 1)}"


def fastest(series: Mapping[str, Series]) -> tuple[Tool, float] | None:
    """The peer that is fastest, and its time over `mtu`'s; None where no peer is installed."""
    ratios = [(t, series[t.name].over(series[OURS.name])) for t in PEERS if t.name in series]
    return min(ratios, key=lambda item: item[1], default=None)


def plain_rows(values: Mapping[str, tuple[str, ...]], head: Sequence[str]) -> list[str]:
    """Rows by tool name, in the order given; what is not installed is listed as such."""
    return in_columns([["", *head], *([name, *cells] for name, cells in values.items())])
