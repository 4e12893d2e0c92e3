"""The same from the outside: files in, the installed command, its report out."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from shop_day import ShopDay, Truth, measure, write_csv, write_machine, write_part
from shop_day.noise import SIG_CMM

COMMAND_REPEATS = 5
"""On the CMM: a table of 21 x 24 x 5."""


def commanded(day: ShopDay, rng: np.random.Generator, truths: Sequence[Truth]) -> dict[str, Any]:
    """What `mtu close-loop` reports of a machine without known errors, and its time, s."""
    cells = measure(day, rng, truths)
    repeats = cells[..., None] + SIG_CMM * rng.normal(size=(*cells.shape, COMMAND_REPEATS))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        asked: list[str | Path] = [Path(sys.executable).with_name("mtu"), "close-loop"]
        asked += ["-m", write_machine(folder / "machine.yaml")]
        asked += ["-p", write_part(day, folder / "part.yaml")]
        asked += ["--cmm", write_csv(day, repeats, folder / "cmm.csv")]
        asked += ["-o", folder / "report.json", "--seed", str(int(rng.integers(2**31)))]
        start = time.perf_counter()
        subprocess.run(asked, check=True, capture_output=True, cwd=folder)
        seconds = time.perf_counter() - start
        results = json.loads((folder / "report.json").read_text())["results"]
    effects = results["effects"]
    return {
        "names": [effect["name"] for effect in effects],
        "first_class": effects[0]["class"] if effects else [],
        "verdict": results["verdict"],
        "seconds": seconds,
    }
