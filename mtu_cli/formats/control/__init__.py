"""Tables of controls: the registry of their formats."""

from __future__ import annotations

from mtu_cli.formats.control.errors import Controller
from mtu_cli.formats.control.heidenhain import HEIDENHAIN
from mtu_cli.formats.control.isg import BECKHOFF, ETALON, ISG_CSV
from mtu_cli.formats.control.linuxcnc import LINUXCNC
from mtu_cli.formats.control.listings import MITSUBISHI, TABLE
from mtu_cli.formats.control.motion import ACS, AEROTECH, PMAC
from mtu_cli.formats.control.siemens import CEC, ENC

CONTROLLERS: dict[str, Controller] = {
    each.name: each
    for each in (
        *(LINUXCNC, ENC, CEC, HEIDENHAIN, BECKHOFF, ISG_CSV, ETALON),
        *(AEROTECH, ACS, PMAC, MITSUBISHI, TABLE),
    )
}
"""By the name of --for; `KLIPPER` holds a skew, no table of an axis."""
KLIPPER = "klipper"
NAMES = (*CONTROLLERS, KLIPPER)
