"""Operations that lie elsewhere on every part, as if parts were clamped anew for them."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import TableResult
from mtu_cli.close_loop_sealed.bridge import loop_warning
from mtu_cli.close_loop_sealed.model.loose_features import smooth_of
from mtu_cli.close_loop_sealed.stats.group_shifts import group_shift
from mtu_cli.findings import Finding
from mtu_cli.units import p_text, um_text

CODE = "operation-shifts"


def shift_warnings(result: TableResult) -> list[Finding]:
    """Of what the effects leave, without gross entries; of readings none, nor of a datum that
    every operation has for itself.
    """
    table = result.table
    if table.component is not None or table.datum != "none" or len(table.operations) < 2:
        return []
    left = table.errors - result.explained
    there = np.asarray(np.isfinite(left).all(axis=2))
    known = np.where(there[:, :, None], left, 0.0)
    smooth = smooth_of(table.places.mean(axis=0))
    # Of few features parts that turn shift groups of them, too.
    turns = smooth.shape[1] > 1
    found = group_shift(known, there, smooth, table.operation) if turns else None
    if found is None:
        return []
    sizes = [
        f"{axis} {um_text(s)} ± {um_text(u)}"
        for axis, s, u in zip(table.axes, found.s.tolist(), found.u.tolist(), strict=True)
        if s > 0
    ]
    own, *others = table.operations[found.group], *table.operations
    others.remove(own)
    what = f"operation {own} lies elsewhere against the others on every part"
    if len(others) == 1:
        what = f"operations {own} and {others[0]} lie elsewhere against each other on every part"
    text = (
        f"{what}, by s = {', '.join(sizes)} um, more than single features scatter "
        f"({p_text(found.p)}): as if parts were clamped anew between them, or bent. No effect of "
        "the library says that, and a shift of an operation that is found beside it is known no "
        f"better than s/sqrt({len(table.parts)}): make them in one clamping, or measure the "
        "clamping by itself; --datum offset gives each operation of a part a place of its own"
    )
    return [loop_warning(code=CODE, message=text)]
