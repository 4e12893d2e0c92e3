"""Speed and memory of the commands as ratios; `make bench` prints the table.

Ratios, never seconds, decide: to one thread of numpy drawing the same number of normals, and
to an interpreter that imports what a command cannot do without.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from support import PAPER, Study, paper_study, simulated_study
from watched_process import MTU, added_mib

from mtu_cli.model.features import feature_points
from mtu_cli.model.measurands import AngleTrials
from mtu_cli.model.prediction import predict
from mtu_cli.model.settings import Settings

TRIALS = 4_000_000


def best(run: Callable[[], object], times: int = 3) -> float:
    """Shortest of several runs, s: the least disturbed one."""
    found = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        found.append(time.perf_counter() - start)
    return min(found)


def draw_normals(count: int, block: int = 8192 * 26) -> None:
    """One thread of numpy (SFC64) drawing `count` normals into an array that stays in cache."""
    rng = np.random.Generator(np.random.SFC64(1))
    out = np.empty(block)
    for _ in range(count // block):
        rng.standard_normal(out=out)


def orthogonality(study: Study, trials: int) -> None:
    """The angle with shared covariance: the command's first half, its second is the same work."""
    entry = study.part.part.orthogonality[0]
    ids, points, _ = feature_points(study.part, study.model, [*entry.row, *entry.column])
    prediction = predict(study.model, ids, points)
    model = AngleTrials(prediction, entry.id, entry.row, entry.column, independent=False)
    Settings(trials=trials).run(model)


def test_orthogonality_against_bare_normals() -> None:
    for name, study in (("paper", paper_study()), ("simulated", simulated_study())):
        bare = best(lambda: draw_normals(26 * TRIALS))
        ours = best(lambda study=study: orthogonality(study, TRIALS))  # type: ignore[misc]  # bound now
        print(f"\northogonality, {name}: {TRIALS} trials / bare normals: {ours / bare:.2f}")
        assert ours / bare <= 1.0


def test_memory_does_not_grow_with_the_trials() -> None:
    before = (
        "from support import paper_study\n"
        "from test_bench_commands import orthogonality\n"
        "study = paper_study()"
    )
    for trials in (1_000_000, 20_000_000, 100_000_000):
        added = added_mib(before, f"orthogonality(study, {trials})")
        print(f"\n{trials} trials: {added:.0f} MiB above import")
        assert added <= 200


def test_start_up() -> None:
    """Over the imports that none can do without: processor time, medians of five processes, with
    as many threads as a user has.
    """
    env = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}

    def once(command: Sequence[str]) -> float:
        before = os.times()
        subprocess.run(command, capture_output=True, check=True, cwd=PAPER, env=env)
        after = os.times()
        user = after.children_user - before.children_user
        return user + after.children_system - before.children_system

    def run(*command: str) -> float:
        return statistics.median(once(command) for _ in range(5))

    bare = run(sys.executable, "-c", "import typer, rich")
    numbers = run(sys.executable, "-c", "import numpy, scipy.special, pydantic, typer, yaml")
    ratios = {
        "--help": (run(str(MTU), "--help") / bare, 3.0),
        "help figures": (run(str(MTU), "help", "figures") / bare, 4.0),
        "lengths": (run(str(MTU), "lengths") / numbers, 1.5),
    }
    for name, (ratio, most) in ratios.items():
        print(f"\nmtu {name} / the imports: {ratio:.2f}, at most {most:g}")
    assert all(ratio <= most for ratio, most in ratios.values())
