"""What the command reports of a data set: `mtu close-loop` in this process, files in, JSON out."""

import contextlib
import io
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from loop_bench.sets import Ask, Drawn

ERRORS = ("rms_um", "chi2_per_dof")


def called(*arguments: str) -> tuple[int, float, str]:
    """Exit code, processor time (s) and standard error of one call of the installed command."""
    from mtu_cli.cli.main import main

    out, errors = (io.TextIOWrapper(io.BytesIO(), write_through=True) for _ in range(2))
    before, sys.argv = sys.argv, ["mtu", *arguments]
    start, code = time.process_time(), 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            main()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    finally:
        sys.argv = before
    return code, time.process_time() - start, errors.buffer.getvalue().decode()


def judged(drawn: Drawn, folder: Path, seed: int) -> dict[str, Any]:
    """The files of a set through the command, with all its defaults."""
    arguments = list(drawn.arguments)
    with contextlib.chdir(folder):
        if drawn.known is not None:
            code, _, message = called("fit-components", *drawn.known, "-o", "known.json", "-q")
            if code:
                return {"code": code, "message": message[-300:]}
            arguments += ["-c", "known.json"]
        code, seconds, message = called(
            "close-loop", *arguments, "--seed", str(seed), "-o", "report.json", "-q",
            "--write-machine", "found.yaml", "--write-components", "found.json",
        )  # fmt: skip
        if code:
            return {"code": code, "message": message[-300:]}
        report = json.loads(Path("report.json").read_text())
        aside = [x for x in report["warnings"] if x["code"] == "outliers-set-aside"]
        outliers = sum(len(x["facts"]["entries"]) for x in aside)
        record = summary(report["results"])
        record |= {"code": 0, "seconds": round(seconds, 2), "outliers": outliers}
        if drawn.asks and Path("found.yaml").exists():
            record["predicted"] = [predicted(ask) for ask in drawn.asks]
    return record


def summary(results: Mapping[str, Any]) -> dict[str, Any]:
    """What a record keeps of a report, by names that both old and new reports have."""
    unexplained = results["unexplained"]
    errors = {
        key: {name: results[key][name] for name in ERRORS if name in results[key]}
        for key in ("before", "after", "after_averaged")
        if results.get(key)
    }
    return {
        "verdict": results["verdict"],
        "effects": [effect_of(item) for item in results["effects"]],
        "unexplained": bool(unexplained["found"]),
        "fired": [item["name"] for item in unexplained["checks"] if item.get("fired")],
        **rounded(errors),
    }


def effect_of(item: Mapping[str, Any]) -> dict[str, Any]:
    kept = ("name", "family", "axis", "covariate", "chosen", "class", "aliases", "verdict")
    effect = {key: item[key] for key in kept if item.get(key) not in (None, [])}
    numbers = ("p_familywise", "log_bayes_factor", "posterior")
    effect |= {key: item[key] for key in numbers if item.get(key) is not None}
    effect["equations"] = sorted(item.get("equations") or [])
    effect["parameters"] = {
        name: [size["value"], size["u"], *(size.get("interval95") or [])]
        for name, size in (item.get("parameters") or {}).items()
    }
    effect["searched"] = {
        name: [value["value"], value.get("interval95")]
        for name, value in (item.get("searched") or {}).items()
    }
    stated: dict[str, Any] = rounded(effect)
    return stated


def predicted(ask: Ask) -> dict[str, Any]:
    """Of each place and axis: what the written machine predicts, null (records of before: its u
    without scatter), the 95 % interval; what is true of the mean and of a future reading, and half
    the width of the interval if all were known.
    """
    lines = ["schema: mtu/part/1", "name: asked", "features:"]
    for i, (x, y, *z) in enumerate(ask.places.tolist()):
        height = f", z_mm: {z[0]!r}" if z else ""
        lines.append(f"  p{i}: {{x_mm: {x!r}, y_mm: {y!r}{height}}}")
    Path("asked.yaml").write_text("\n".join(lines) + "\n")
    at = [text for name, value in ask.at.items() for text in ("--at", f"{name}={value:.10g}")]
    code, _, message = called(
        "predict-points", "-m", "found.yaml", "-c", "found.json", "-p", "asked.yaml", *at,
        "-o", "predicted.json", "-q",
    )  # fmt: skip
    if code:
        return {"code": code, "message": message[-200:]}
    points = json.loads(Path("predicted.json").read_text())["results"]["points"]
    rows = []
    for i, point in enumerate(points):
        for a, axis in enumerate("xyz"[: ask.true.shape[1]]):
            interval = point[f"interval95_{axis}_um"]
            both = (ask.future, ask.known_half)
            more = [None if values is None else values[i, a] for values in both]
            rows.append([point[f"E{axis}_um"], None, *interval, ask.true[i, a], *more])
    return {"inside": True, "rows": rounded(rows)}


def rounded(value: Any, digits: int = 5) -> Any:
    """Floats to some significant digits, all through."""
    if isinstance(value, float | np.floating):
        return float(f"{value:.{digits}g}") if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: rounded(item, digits) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item, digits) for item in value]
    return value
