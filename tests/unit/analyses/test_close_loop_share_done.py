"""What is told of a loop while it is being closed."""

from __future__ import annotations

from mtu_cli.close_loop_sealed.analyses.loop.share_done import NOBODY, ShareDone


def test_tables_follow_one_another_to_the_end() -> None:
    told: list[tuple[int, int | None]] = []
    for number, steps in enumerate((2, 5)):
        tell = ShareDone(lambda done, total: told.append((done, total)), number, 2)
        for done in range(1, steps + 1):
            tell(done, steps)
    shares = [done / total for done, total in told if total is not None]
    assert shares == [0.25, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]


def test_where_nobody_listens_nothing_is_told() -> None:
    NOBODY(1, 2)
