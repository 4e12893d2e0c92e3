"""What the pipeline of configs/pipeline tells at its end, and which machines its gates stop."""

from __future__ import annotations

import os
from pathlib import Path

import made_files
from pipeline_runner import make, placed, quick


def measured(study: Path, errors: list[float]) -> None:
    """Parts of two holes, each in its places but for an error (mm) that both have."""
    rows = [
        f"{part},{hole},{repeat},{place + error + repeat / 1e4:.4f},{10 - error + repeat / 5e3:.4f}"
        for part, error in enumerate(errors, 1)
        for hole, place in (("a", 10.0), ("b", 140.0))
        for repeat in (1, 2)
    ]
    text = "\n".join(["part,feature,repeat,x_mm,y_mm", *rows, ""])
    (study / "cmm.csv").write_text(text, "utf-8")


def test_a_gate_stops_parts_that_scatter_more_than_predicted(tmp_path: Path) -> None:
    """Off by a tenth of a millimetre to either side, they are where they should be in the mean."""
    study, out = tmp_path / "shop" / "mill", tmp_path / "out"
    placed(study, "cmm: [cmm.csv]\n")
    measured(study, [0.08, -0.1, 0.09, -0.07, 0.1, -0.09, 0.07, -0.08])
    stamp = out / "mill" / "compare.passed"
    stopped = make(out, f"ROOT={study.parent}", "GATE=1", str(stamp))
    assert stopped.returncode == 2
    assert "mtu: gate under-predicted: a x" in stopped.stderr, stopped.stderr
    assert not stamp.exists()
    report = (out / "mill" / "compare.json").read_text("utf-8")
    assert '"under_predicted": true' in report
    assert '"biased": true' not in report


def test_the_end_says_where_the_reports_are(tmp_path: Path) -> None:
    placed(tmp_path / "shop" / "mill")
    out = tmp_path / "out"
    told = f"reports, tables and pictures: {out}/<study>/"
    call = (f"ROOT={tmp_path / 'shop'}", "GATE=1", quick(tmp_path))
    for _ in range(2):
        # The second finds nothing to do.
        ran = make(out, "-j2", *call)
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout.splitlines().count(told) == 1
    for option in ("-q", "-n"):
        ran = make(out, option, *call)
        assert ran.returncode == 0, ran.stderr
        assert "reports" not in ran.stdout


def test_a_study_that_cannot_run_stops_no_other(tmp_path: Path) -> None:
    placed(tmp_path / "root" / "a")
    (tmp_path / "root" / "a" / "machine.yaml").unlink()
    placed(tmp_path / "root" / "b")
    found = make(tmp_path / "out", f"ROOT={tmp_path / 'root'}")
    assert found.returncode == 2
    assert "no such file: 'machine.yaml'" in found.stderr
    assert not (tmp_path / "out" / "a" / "points.json").exists()
    assert (tmp_path / "out" / "b" / "points.json").exists()
    head = found.stdout.index("study: done, or which of its steps have not\n")
    assert found.stdout[head:].splitlines()[1:3] == [
        "a: not done: predict-points lengths",
        "b: done",
    ]


def test_runs_that_need_a_unit_or_a_profile_are_imported_and_a_part_is_not_asked_for(
    tmp_path: Path,
) -> None:
    study, out = tmp_path / "shop" / "mill", tmp_path / "out"
    study.mkdir(parents=True)
    (study / "machine.yaml").write_text(
        "schema: mtu/machine/1\nname: m\ncomponents: {dx_x: {of: x, unit: um}}\n"
        "equations: {Ex: dx_x}\n"
    )
    for name, text in (("laser.txt", made_files.LASER), ("map.yaml", made_files.MAP),
                       ("mapped.csv", made_files.MAPPED)):  # fmt: skip
        (study / name).write_text(text)
    (study / "mtu.yaml").write_text(
        "schema: mtu/study/1\nmachine: machine.yaml\nlaser:\n"
        "- {file: laser.txt, component: dx_x, unit: um}\n- {file: mapped.csv, map: map.yaml}\n"
    )
    root = f"ROOT={study.parent}"
    assert f"{out}/mill/readings.csv" in make(out, root, "-n").stdout
    assert make(out, root, f"{out}/mill/readings.csv").returncode == 0
    assert len((out / "mill" / "readings.csv").read_text().splitlines()) == 12
    assert make(out, root, "-q", f"{out}/mill/readings.csv").returncode == 0
    (study / "map.yaml").write_text(made_files.MAP + "# once more\n")
    os.utime(study / "map.yaml", (2e9, 2e9))
    assert make(out, root, "-q", f"{out}/mill/readings.csv").returncode == 1
    assert "predict-points" not in make(out, root, "-n").stdout
