"""Positioning tests that were published with their data, and readings made for tests."""

from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.analyses.iso230 import Axis as Positioning
from mtu_cli.stats.least_squares import FloatArray

SOURCE = "paulscherrerinstitute/ecmccfg, examples/*/report.md_ISO230.dat and ecmcISO230_2.py"
SETS = {
    1: """
        15.0 | 93.184 -20.657 -20.454 -21.879 -22.083 | 11.112 11.723 13.149 14.574 11.520
        25.2 | 62.774 12.065 14.101 16.545 15.527 | -0.969 -0.358 5.752 5.548 5.955
        35.4 | -18.956 -22.418 -22.418 -23.436 -20.992 | -27.102 -31.175 -32.397 -33.212 -33.823
        45.6 | -25.539 -20.244 -22.891 -22.076 -18.818 | -10.468 -10.061 -7.821 -9.043 -9.246
        55.8 | -5.239 1.685 0.463 1.074 0.871 | 37.121 39.768 47.507 46.896 44.859
    """,
    2: """
        -10 | -0.09902 -0.09402 -0.08202 -0.09102 -0.09402 \
            | -0.08102 -0.10202 -0.08702 -0.09202 -0.10002
        -4.88 | -0.10302 -0.10402 -0.09502 -0.11102 -0.09302 \
            | -0.08702 -0.09702 -0.09702 -0.09502 -0.08202
        0.24 | -0.08602 -0.10202 -0.09102 -0.07602 -0.09902 \
            | -0.07202 -0.09002 -0.08802 -0.08702 -0.08702
        5.36 | -0.07202 -0.09202 -0.09502 -0.10302 -0.08102 \
            | -0.10202 -0.08602 -0.08602 -0.09302 -0.07802
        10.48 | -0.10402 -0.12602 -0.13002 -0.14102 -0.10702 \
            | -0.10002 -0.11202 -0.12902 -0.10902 -0.09702
    """,
    3: """
        15 | 4.74806 4.74806 4.95194 6.37912 6.78688 | 0.67043 1.68984 2.09760 3.93254 3.32089
        25 | -2.59865 -1.57924 -2.59865 -1.78312 -1.37535 \
            | -0.35595 -0.35595 -1.37535 0.05182 -0.76371
        35 | -10.35312 -7.49877 -6.68324 -5.86772 -6.68324 \
            | 0.24874 -7.09101 -2.80949 -0.36291 -4.64443
        45 | -2.20481 -1.59316 -1.18540 -1.59316 0.24177 \
            | -2.20481 -0.57376 -1.79705 -1.18540 -3.42810
        55 | 2.68139 2.88527 6.96291 5.73962 2.88527 | 2.88527 0.84645 7.16679 8.18620 0.43869
    """,
}
"""um: target, runs forward, runs in reverse."""
EXPECTED: dict[int, dict[str, float]] = {
    1: {
        "B": 43.4594, "B_mean": -7.1849, "R_forward": 204.7595, "R_reverse": 18.2970,
        "R": 204.7595, "E_forward": 46.1161, "E_reverse": 74.7720, "E": 74.7720, "M": 48.0935,
        "A_forward": 204.7595, "A_reverse": 89.2653, "A": 204.7595,
    },
    2: {
        "B": 0.01220, "B_mean": -0.00540, "R_forward": 0.06290, "R_reverse": 0.05033,
        "R": 0.06882, "E_forward": 0.0330, "E_reverse": 0.0246, "E": 0.0368, "M": 0.0277,
        "A_forward": 0.08881, "A_reverse": 0.06428, "A": 0.08881,
    },
    3: {
        "B": 4.4854, "B_mean": -0.3670, "R_forward": 7.9404, "R_reverse": 14.3357, "R": 14.3357,
        "E_forward": 12.9400, "E_reverse": 6.8365, "E": 12.9400, "M": 9.2423,
        "A_forward": 19.0975, "A_reverse": 20.0840, "A": 21.9689,
    },
}  # fmt: skip
AT_TARGETS = {
    1: [204.7595, 86.5110, 18.7152, 19.7816, 58.2781],
    2: [0.0352, 0.0377, 0.0417, 0.0487, 0.0688],
    3: [7.7460, 3.6593, 14.0442, 4.5734, 14.3357],
}
VDI: dict[int, dict[str, float]] = {
    1: {"U_max": 43.4594, "U_mean": 19.5506, "Ps_max": 157.8594, "Ps_mean": 55.9122,
        "Pa": 48.0935, "P": 168.6529},
    2: {"U_max": 0.0122, "Ps_max": 0.0849, "Pa": 0.0277, "P": 0.1072},
    3: {"U_max": 4.4854, "U_mean": 1.9980, "Ps_max": 16.7070, "Ps_mean": 9.4491, "Pa": 9.2423,
        "P": 27.1707},
}  # fmt: skip


def published(number: int) -> tuple[FloatArray, FloatArray]:
    """Targets (m,) in mm and readings (2, m, n) in um of a set."""
    lines = [line for line in SETS[number].replace("\\\n", " ").splitlines() if line.strip()]
    cells = [line.split("|") for line in lines]
    targets = np.array([float(row[0]) for row in cells])
    readings = [[[float(x) for x in row[way].split()] for row in cells] for way in (1, 2)]
    return targets, np.array(readings)


def positioning(targets: FloatArray, readings: FloatArray, **more: Any) -> Positioning:
    """A test of an axis of which these readings (2, m, n), um, were made."""
    return Positioning(
        name="dx_x", unit="um", rotary=False, targets=targets, readings=readings * 1e-3, **more
    )


def write_readings(
    path: Path, targets: FloatArray, readings: FloatArray, component: str = "dx_x"
) -> Path:
    """The CSV of a set (2, m, n), um; nan is not written."""
    lines = ["component,position_mm,pass,direction,error,unit"]
    for way, name in enumerate(("forward", "reverse")):
        for i, target in enumerate(targets.tolist()):
            for run, value in enumerate(readings[way, i].tolist(), 1):
                if value == value:
                    lines.append(f"{component},{target!r},{run},{name},{value!r},um")
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path
