"""Whole processes with their time and largest memory, for benches that compare commands."""

from __future__ import annotations

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
