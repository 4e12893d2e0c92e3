"""What is warned of after a search."""

from __future__ import annotations

from dataclasses import replace

from loop_examples import effect, on_table, parameter, result

from mtu_cli.analyses.close_loop.warnings import loop_warnings

COLUMN = effect("covariate-x", parameter("slope", "um", 1.0, 0.01), covariate="deviation")


def test_a_column_that_is_the_error_is_warned_of() -> None:
    item = on_table(replace(COLUMN, explained_share=0.9999))
    assert [own.code for own in loop_warnings(result(item), 4)] == ["covariate-is-the-error"]
    assert not list(loop_warnings(result(on_table(COLUMN)), 4))
