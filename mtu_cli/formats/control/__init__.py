"""Tables of controls: the registry of their formats."""

from __future__ import annotations

from mtu_cli.formats.control import columns, keyed
from mtu_cli.formats.control.errors import Controller

CONTROLLERS: dict[str, Controller] = {
    each.name: each
    for each in (
        *(columns.LINUXCNC, keyed.ENC, keyed.CEC, columns.HEIDENHAIN, keyed.BECKHOFF),
        *(columns.ISG_CSV, columns.ETALON, keyed.AEROTECH, keyed.ACS, keyed.PMAC),
        *(columns.MITSUBISHI, columns.TABLE),
    )
}
"""By the name of --for; `KLIPPER` holds a skew, no table of an axis."""
KLIPPER = "klipper"
NAMES = (*CONTROLLERS, KLIPPER)
