"""The datum of a call: the option over the study over none."""

from __future__ import annotations

from typing import cast

from mtu_cli.cli.inputs import Inputs
from mtu_cli.findings import error, suggestion
from mtu_cli.model.datum import DATUMS, Datum


def chosen_datum(inputs: Inputs) -> Datum:
    """Raises InputError for a datum that is not known."""
    study = inputs.study.study.settings if inputs.study else None
    datum = inputs.options.datum or (study.datum if study else None) or "none"
    if datum not in DATUMS:
        raise error("unknown-name", what="datum", value=datum, **suggestion(datum, DATUMS))
    return cast(Datum, datum)
