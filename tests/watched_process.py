"""Whole processes with their time and largest memory, for benches that compare commands."""

import json
import subprocess
import sys
from pathlib import Path

MTU = Path(sys.executable).parent / "mtu"
READ = """
import json, sys
import pandas
frame = pandas.read_csv(sys.argv[1], low_memory=sys.argv[2] == "default")
if len(sys.argv) > 3:
    deep = int(frame.memory_usage(deep=True).sum())
    print(json.dumps({"rows": len(frame), "deep": deep}))
"""
WATCHED = """
import json, resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"seconds": time.perf_counter() - start, "bytes": usage.ru_maxrss * 1024}))
"""


def watched(*command: object) -> dict[str, float]:
    """Seconds and largest memory of a process, from start to end. A virtual machine takes seconds
    for memory that its host has yet to give: it is taken before.
    """
    subprocess.run([sys.executable, "-c", "touched = b'x' * (6 << 30)"], check=True)
    found = subprocess.run(
        [sys.executable, "-c", WATCHED, *map(str, command)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    numbers: dict[str, float] = json.loads(found.stdout)
    return numbers


def against_pandas(path: Path, out: Path, *arguments: object, runs: int) -> tuple[float, float]:
    """Time of `mtu` with these arguments, which reads `path`, over that of a process that imports
    pandas and reads it with one thread, and its largest memory over that of the frame.

    pandas before 3.1 reads with one thread, later versions with all cores unless `low_memory=False`
    is asked for: that ratio is printed, too. Runs alternate and the best of each counts, so that a
    busy machine disturbs both alike.
    """
    size = subprocess.run(
        [sys.executable, "-c", READ, path, "default", "size"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    frame = json.loads(size.stdout)
    commands: dict[str, list[object]] = {
        "mtu": [MTU, *arguments, "-o", out, "-q"],
        "one thread": [sys.executable, "-c", READ, path, "whole"],
        "default": [sys.executable, "-c", READ, path, "default"],
    }
    found = [{name: watched(*command) for name, command in commands.items()} for _ in range(runs)]
    best = {name: min(run[name]["seconds"] for run in found) for name in commands}
    memory = max(run["mtu"]["bytes"] for run in found) / frame["deep"]
    print(
        f"\nmtu {arguments[0]}, {frame['rows']} rows: {best['mtu']:.2f} s, "
        f"{best['mtu'] / best['one thread']:.2f} x pandas with one thread, "
        f"{best['mtu'] / best['default']:.2f} x with its defaults; "
        f"memory {memory:.2f} x the frame's"
    )
    return best["mtu"] / best["one thread"], memory


ADDED = """
import sys
sys.path[:0] = sys.argv[1].split(":")
{before}
def read(key):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key))

# The peak of importing would hide what follows: Linux lets it be reset.
open("/proc/self/clear_refs", "w").write("5")
start = read("VmRSS")
{run}
print((read("VmHWM") - start) / 1024)
"""


def added_mib(before: str, run: str) -> float:
    """Largest memory that `run` takes beyond what its process has after `before`."""
    path = ":".join(item for item in sys.path if item)
    code = ADDED.format(before=before, run=run)
    found = subprocess.run(
        [sys.executable, "-c", code, path], capture_output=True, text=True, check=True
    )
    return float(found.stdout)
