"""Forward-backward selection as the textbook has it, every step by regressions from scratch."""

from collections.abc import Sequence

from scipy.special import fdtrc

from mtu_cli.stats.least_squares import FloatArray, least_squares


def by_full_refits(
    Z: FloatArray, number: float, enter: float = 0.05, remove: float = 0.10
) -> list[int]:
    """The chosen of the columns 1 ... k-2 of rows (constant, columns, target), which count as
    `number` independent ones.
    """

    def rss(columns: Sequence[int]) -> float:
        return least_squares(Z[:, [0, *columns]], Z[:, -1]).rss

    def p(less: float, more: float, columns: int) -> float:
        dof = number - columns - 1
        return float(fdtrc(1, dof, (less - more) / more * dof)) if dof > 0 else 1.0

    chosen: list[int] = []
    while others := [j for j in range(1, Z.shape[1] - 1) if j not in chosen]:
        entry = {j: rss([*chosen, j]) for j in others}
        best = min(entry, key=lambda j: entry[j])
        if p(rss(chosen), entry[best], len(chosen) + 1) >= enter:
            break
        chosen.append(best)
        while True:
            # Of one column each: the largest p is that of the least rise.
            exits = {j: rss([i for i in chosen if i != j]) for j in chosen}
            worst = min(exits, key=lambda j: exits[j])
            if p(exits[worst], rss(chosen), len(chosen)) <= remove:
                break
            chosen.remove(worst)
    return sorted(chosen)
