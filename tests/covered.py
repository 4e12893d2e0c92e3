"""What the tests cover of the floors that calculate, in a few lines."""

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from coverage import Coverage

ENOUGH = 95.0
"""Per cent of lines and branches below which a file is named."""
COUNTED = ("num_statements", "num_branches")
REACHED = ("covered_lines", "covered_branches")

Summary = dict[str, float]


def coverage_lines() -> Iterator[str]:
    """A line for each measured folder, and one for each file in it that falls short.

    Reads the data that the run of the tests left in the working folder.
    """
    coverage = Coverage()
    coverage.load()
    files = _summaries(coverage)
    folders = coverage.get_option("run:source")
    for folder in folders if isinstance(folders, list) else ():
        within = {name: item for name, item in files.items() if name.startswith(f"{folder}/")}
        yield f"{_share(*within.values()):6.2f} % {folder}: lines and branches of all files"
        for name, item in within.items():
            if _share(item) < ENOUGH:
                yield f"{_share(item):6.2f} % {name}"


def _summaries(coverage: Coverage) -> dict[str, Summary]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "coverage.json"
        coverage.json_report(outfile=str(path))
        files = json.loads(path.read_text("utf-8"))["files"]
    return {name: item["summary"] for name, item in sorted(files.items())}


def _share(*items: Summary) -> float:
    counted = sum(item[name] for item in items for name in COUNTED)
    reached = sum(item[name] for item in items for name in REACHED)
    return 100.0 * reached / counted if counted else 100.0
