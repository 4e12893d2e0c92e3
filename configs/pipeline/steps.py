"""What the pipelines have to do: the steps of each study, by what its files name. The Makefile and
the Snakefile take their calls of `mtu` from here.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path
from typing import Any, NamedTuple

import yaml

ROLES = ("machine", "part", "components", "lbb", "laser", "cmm", "drift")
ASKED = ("lengths", "orthogonality")
MODELS = ("components", "thermal")
AT = dict.fromkeys(("valdes-cmm", "valdes-ring"), "--at 'T_*_degC=23'")
"""Temperatures that predictions of a study need: AT_<study>=... of make, `at` of Snakemake."""
ODD = re.compile(r"[^A-Za-z0-9._+@/\x80-\U0010ffff-]")
RENAME = "make takes letters, digits and . _ + @ - in names alone: rename the folder"


class Step(NamedTuple):
    """A command: what a study must name (one of these), its files beside the JSON report by option,
    whether it takes the fitted models and the temperatures, and the gate that it may meet.
    """

    command: str
    needs: str
    files: str = ""
    models: bool = False
    at: bool = False
    gate: str = ""


STEPS = {
    "components": Step("fit-components", "lbb laser", "plot=components.png"),
    "thermal": Step("thermal-fit", "drift", "plot=thermal.png"),
    "iso230": Step("iso230", "lbb laser", "csv=iso230.csv plot=iso230.png"),
    "points": Step("predict-points", "geometric", "plot=points.png", True, True),
    "lengths": Step("lengths", "lengths", "csv=lengths.csv", True, True, "nonconforming=0.05"),
    "orthogonality": Step("orthogonality", "orthogonality", "csv=orthogonality.csv", True, True),
    "anova": Step("anova", "cmm", "csv=anova.csv", gate="unusual"),
    "compare": Step("compare", "cmm", "plot=compare.png", True, gate="biased,under-predicted"),
    "loop": Step("close-loop", "cmm", "plot=loop.png write-machine=machine-extended.yaml", True,
                 gate="found,unexplained"),
    "correct": Step("correct", "cmm", "plot=correct.png", True),
}  # fmt: skip


def contents(path: Path) -> dict[str, Any] | None:
    """A YAML file; None where mtu would say what is wrong with it."""
    try:
        found = yaml.safe_load(path.read_text("utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return None
    return found if isinstance(found, dict) else None


def _entries(value: Any) -> list[dict[str, Any]]:
    """What a study names of a role: one file or several, plain or with what they leave open."""
    items = value if isinstance(value, list) else [value]
    return [each if isinstance(each, dict) else {"file": each} for each in items]


class Study:
    """A study below the folder `root`: its `files`, None where one is not there or has a name that
    make cannot take, and its `steps`. What is wrong with it mtu itself says.
    """

    def __init__(self, root: Path, name: str) -> None:
        self.name, self.folder = name, root / name
        stated = contents(self.folder / "mtu.yaml") or {}
        entries = {role: _entries(stated[role]) for role in ROLES if stated.get(role)}
        paths = {role: [self.folder / str(each.get(key)) for each in given
                        for key in ("file", *(["map"] if "map" in each else []))]
                 for role, given in entries.items()}  # fmt: skip
        files = [self.folder / "mtu.yaml", *sorted({x for each in paths.values() for x in each})]
        odd = any(ODD.search(str(path)) or not path.is_file() for path in files)
        self.files = None if odd else files
        machine, part = (contents(paths[x][0]) if x in paths else {} for x in ("machine", "part"))
        keys = {*entries}
        known = keys & {"lbb", "laser", "components"} or "'coefficients'" in repr(machine)
        if known or machine is None or "drift" not in keys:
            keys |= {key for key in ASKED if part is None or part.get(key)}
            keys |= {"geometric"} if "part" in keys else set()
        else:
            keys -= {"cmm"}
        self.steps = [name for name, step in STEPS.items() if keys & {*step.needs.split()}]
        self.tolerances = part is None or "'tolerance_um'" in repr(part.get("lengths"))

    def models(self, step: str) -> list[str]:
        """The steps whose reports a step takes."""
        return [name for name in MODELS if name in self.steps] if STEPS[step].models else []

    def gate(self, step: str) -> str:
        """The gate of a step; lengths without a tolerance have none."""
        return STEPS[step].gate if step != "lengths" or self.tolerances else ""

    def call(self, step: str, out: str, at: str) -> str:
        """The words after `mtu` of a step that writes to the folder `out`, for a shell."""
        known = STEPS[step]
        models = "".join(f" -c {out}/{name}.json" for name in self.models(step))
        files = (each.split("=") for each in known.files.split())
        more = "".join(f" --{option} {out}/{name}" for option, name in files)
        at = f" {at}" if known.at and at else ""
        study = shlex.quote(str(self.folder))
        return f"{known.command} {study}{models}{at} -q -o {out}/{step}.json{more}"


def studies_of(root: Path, names: list[str] | None) -> list[Study]:
    """The studies of these names, all without; raises ValueError where there is none."""
    every = sorted(path.parent.name for path in root.glob("*/mtu.yaml"))
    found = every if names is None else names
    missing = [name for name in found or ["*"] if not (root / name / "mtu.yaml").is_file()]
    if missing:
        hint = "ROOT=... names the folder that holds a folder with mtu.yaml for each machine"
        raise ValueError(f"no study: no {root}/{missing[0]}/mtu.yaml here; {hint}")
    if odd := ", ".join(f"'{root / name}'" for name in found if ODD.search(str(root / name))):
        raise ValueError(f"{odd}: {RENAME}")
    return [Study(root, name) for name in found]


def for_make(given: dict[str, str]) -> list[str]:
    """Lines of a makefile; raises ValueError for names that a gate must not pass with."""
    for name in ("ROOT", "OUT", "STUDIES"):
        value = given.get(name, "-")
        if name != "STUDIES" and not value.strip():
            raise ValueError(f"{name}= names no folder: name one, or leave it out")
        if name != "STUDIES" and name in given:
            given[name] = value = os.path.normpath(os.path.join(given["CALLED"], value))
        if ODD.search("".join(value.split()) if name == "STUDIES" else value):
            raise ValueError(f"{name}='{value}': {RENAME}")
    root, top = Path(given.get("ROOT", "..")), os.path.abspath("../..")
    top = "../.." if ODD.search(top) else top
    # Of another folder apart: a study there may have the name of one here.
    apart = given.get("ROOT", "").replace("+", "++").replace("-", "+-").replace("/", "-")
    out = given.get("OUT", f"{top}/out/pipeline{apart}")
    if os.path.realpath(root) == os.path.realpath(out):
        raise ValueError(f"OUT='{out}' holds the studies: name another folder")
    lines = [f"override ROOT := {root}", f"override OUT := {out}"]
    if given["GOALS"] == "clean":
        return lines
    # Shells complete the name of a folder with a stroke.
    named = {name.rstrip("/") for name in given.get("STUDIES", "").split()}
    studies = studies_of(root, sorted(named) if "STUDIES" in given else None)
    lines += [f"override STUDIES := {' '.join(each.name for each in studies)}"]
    lines += [f"AT_{name} ?= {at}" for name, at in AT.items()]
    done = "passed" if given.get("GATE") else "done"
    for name, step in STEPS.items() if done == "passed" else ():
        lines += [f"{name.upper()}_GATE ?= --fail-if {step.gate}"] if step.gate else []
    for study in studies:
        to = f"{out}/{study.name}"
        files = " ".join(map(str, study.files or ["$(NOT_THERE)"]))
        ends = {step: done if STEPS[step].gate else "json" for step in study.steps}
        targets = {step: f"{to}/{step}.{end}" for step, end in ends.items()}
        lines += [f".PHONY: study/{study.name}", f"steps: study/{study.name}",
                  f"study/{study.name}: {' '.join(targets.values())}"]  # fmt: skip
        for step, target in targets.items():
            models = " ".join(targets[model] for model in study.models(step))
            gated = "steps.py" if STEPS[step].gate and done == "passed" else ""
            call = study.call(step, to, f"$(AT_{study.name})" if STEPS[step].at else "")
            gate = f" $({step.upper()}_GATE)" if study.gate(step) else ""
            stamp = " && touch $@" if STEPS[step].gate else ""
            lines += [f"{target}: {files} {models} {gated}",
                      f"\t$(call begin,{study.name},{STEPS[step].command})",
                      f"\t$(MTU) {call}{gate}{stamp}"]  # fmt: skip
    return lines


if __name__ == "__main__":
    try:
        lines = for_make(dict(word.split("=", 1) for word in sys.argv[1:]))
    except ValueError as fault:
        text = str(fault).replace("$", "$$").replace("#", "\\#")
        lines = [f"FAULT := {text}", "$(error $(FAULT))"]
    # The shell of make takes lines for words; a ~ is in no name.
    print("~~".join(lines))
