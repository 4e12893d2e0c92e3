"""Speed of `mtu close-loop` on a shop day, as a ratio; `make bench` prints it.

The reference is what the search is made of, small triangular factors and some of a whole table,
in an interpreter that starts with numpy: it takes `REFERENCE_SECONDS` of processor time on the
machine on which five seconds are promised, and what slows one slows the other.
"""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from shop_day import ShopDay, effect, measure, write_csv, write_machine, write_part
from shop_day.noise import SIG_CMM
from watched_process import MTU

PROMISED_SECONDS, REFERENCE_SECONDS = 5.0, 0.6
REFERENCE = """
import numpy as np
rng = np.random.default_rng(1)
small, whole, y = rng.normal(size=(120, 12)), rng.normal(size=(2520, 60)), rng.normal(size=120)
for _ in range(6000):
    Q, R = np.linalg.qr(small)
    np.linalg.solve(R, Q.T @ y)
for _ in range(60):
    np.linalg.qr(whole)
"""


def processor_seconds(*command: str, cwd: Path) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    subprocess.run(command, capture_output=True, check=True, cwd=cwd, env=one_thread)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_a_shop_day_takes_seconds(tmp_path: Path) -> None:
    """21 parts, 24 holes, five repeats, two effects: calibration, folds and files included."""
    day, rng = ShopDay("A", 3), np.random.default_rng(3)
    truths = [effect(day, name, rng, 2.0) for name in ("backlash-x", "scale-y")]
    write_machine(tmp_path / "machine.yaml")
    write_part(day, tmp_path / "part.yaml")
    cells = measure(day, rng, truths)[..., None]
    write_csv(day, cells + SIG_CMM * rng.normal(size=(*cells.shape[:-1], 5)), tmp_path / "cmm.csv")
    files = ("-m", "machine.yaml", "-p", "part.yaml", "--cmm", "cmm.csv", "-o", "found.json")
    pairs = [
        (
            processor_seconds(sys.executable, "-c", REFERENCE, cwd=tmp_path),
            processor_seconds(str(MTU), "close-loop", *files, cwd=tmp_path),
        )
        for _ in range(3)
    ]
    bare, ours = (min(own) for own in zip(*pairs, strict=True))
    print(f"\nclose-loop, 21 x 24 x 5: {ours:.1f} s of processor, {ours / bare:.1f} x reference")
    assert ours / bare <= PROMISED_SECONDS / REFERENCE_SECONDS
