"""Calls of every command, and the files that each reads, one of them damaged."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from random import Random

from fuzz.cases import damaged, generator
from fuzz.samples import MILL, RING, Kind, Sample, parameters_of
from mtu_cli.formats.control import CONTROLLERS

OLD = b'{"old": true}\n'

Files = dict[str, tuple[Kind, str]]
"""What a file of the call's folder is a copy of, by its name there."""


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """A command as it is called, how often, and with which files; all of them may be damaged."""

    words: str
    share: int
    files: Files
    options: Sequence[str] = ()
    outputs: Sequence[str] = ("-o out.json", "--csv out.csv")
    pictures: bool = True


@dataclass(frozen=True, kw_only=True)
class Call:
    """A drawn call: `outputs` are the files that it must write whole or not at all."""

    number: int
    arguments: list[str]
    outputs: tuple[str, ...]
    damaged: str

    @property
    def command(self) -> list[str]:
        """The words of the command itself."""
        return self.arguments[: 2 if self.arguments[0] == "graph" else 1]


MACHINE: Files = {"machine.yaml": ("machine", f"{MILL}/machine.yaml")}
PART: Files = {"part.yaml": ("part", f"{MILL}/part.yaml")}
KNOWN: Files = {"components.json": ("components", "mill.json")}
POINTS: Files = {"cmm.csv": ("points", "data/undeclared/cmm.csv")}
NOMINALS: Files = {"cmm.csv": ("points", "data/undeclared/nominals.csv")}
READ: Files = {"lbb.csv": ("readings", "data/undeclared/lbb.csv")}
EFFECTS: Files = {"own.yaml": ("effects", "configs/effects/few.yaml")}
STUDY: Files = {"mtu.yaml": ("study", "flat/mtu.yaml")}
RING_MACHINE: Files = {"machine.yaml": ("machine", f"{RING}/machine.yaml")}
RING_FILES: Files = RING_MACHINE | {
    "part.yaml": ("part", f"{RING}/part.yaml"),
    "ring.json": ("components", "ring.json"),
    "drift.json": ("thermal", "drift.json"),
    "cmm.csv": ("points", "data/valdes-ring/ring.csv"),
}
LASER: Files = {"laser.csv": ("readings", "data/valdes-ring/laser.csv")}
DRIFT: Files = {"drift.csv": ("drift", "data/valdes-ring/drift.csv")}
FLAT: Files = MACHINE | PART | READ | POINTS | STUDY
PREDICTED = "-m machine.yaml -p part.yaml -c components.json"
RINGS = "-m machine.yaml -p part.yaml -c ring.json -c drift.json --cmm cmm.csv"
COVERAGE = ("--k nan", "--k 0", "--k 3", "--k 1e308", "--k -1", "--digits 0", "--digits 3")
SEEDS = ("--seed -1", "--seed 0", "--seed 99999999999999999999", "--threads 0", "--threads 2")
ANYWHERE = ("--at x=1", "--at T_1_degC=20", "--at a", "--at =", "--correlation independent")
DATUM = ("--datum offset", "--datum offset,rotation", "--datum x")


def _budgets() -> list[Pattern]:
    names = ("gum-h1-end-gauge", "gum-h2-impedance", "ring-gauge-diameter", "valdes-x275")
    return [
        Pattern(
            words="budget budget.yaml --trials 2000",
            share=4,
            files={"budget.yaml": ("budget", f"configs/budgets/{name}.yaml")},
            options=(*COVERAGE, *SEEDS),
        )
        for name in names
    ]


def _graphs() -> list[Pattern]:
    trials = "--trials 2000"
    found = []
    for name, share in (("bore-to-bore", 3), ("ball-centre", 2), ("work-coordinates", 2)):
        files: Files = {"graph.yaml": ("graph", f"configs/graphs/{name}.yaml")}
        place = {"bore-to-bore": "d", "ball-centre": "P1.x", "work-coordinates": "Q.x"}[name]
        found += [
            Pattern(words="graph check graph.yaml", share=share, files=files, pictures=False),
            Pattern(
                words=f"graph simulate graph.yaml {trials}",
                share=share,
                files=files,
                options=("--of d", "--of H1.x", *COVERAGE, *SEEDS),
            ),
            Pattern(
                words=f"graph sweep graph.yaml --vary axis_um=0.5:2.5:3 --of {place} {trials}",
                share=1,
                files=files,
                options=("--vary probe_um=1,2", "--vary repeats=1,1e3", "--vary a=b", *SEEDS),
            ),
            *(
                Pattern(
                    words="graph draw graph.yaml",
                    share=1,
                    files=files,
                    outputs=(f"--to out.{ending}",),
                    pictures=False,
                )
                for ending in ("dot", "mmd", "pl")
            ),
        ]
    return found


def _predictions() -> list[Pattern]:
    files = MACHINE | PART | KNOWN
    asked = (*COVERAGE, *SEEDS, *ANYWHERE)
    return [
        Pattern(
            words=f"predict-points {PREDICTED} --trials 2000",
            share=7,
            files=files,
            options=("--grid 3", "--grid 0", "--grid 2,2,2", "--covariance", *asked),
        ),
        Pattern(
            words=f"lengths {PREDICTED} --trials 2000",
            share=7,
            files=files,
            options=("--fail-if nonconforming=0.01", "--fail-if nonconforming", *asked),
        ),
        Pattern(
            words=f"orthogonality {PREDICTED} --trials 2000", share=6, files=files, options=asked
        ),
        Pattern(
            words=f"compare {PREDICTED} --cmm cmm.csv --trials 2000",
            share=8,
            files=files | POINTS,
            options=("--fail-if biased", *DATUM, *asked),
        ),
    ]


def _loops() -> list[Pattern]:
    files = MACHINE | PART | KNOWN
    return [
        Pattern(
            words=f"close-loop {PREDICTED} --cmm cmm.csv",
            share=4,
            files=files | POINTS,
            options=("--fail-if found", "--alpha 2", "--exclude backlash", "--seed 3", *DATUM),
        ),
        Pattern(
            words=f"close-loop {PREDICTED} --cmm cmm.csv --effects own.yaml --max-effects 1",
            share=3,
            files=files | POINTS | EFFECTS,
            outputs=("-o out.json", "--write-machine out.yaml"),
        ),
        Pattern(
            words=f"simulate {PREDICTED} --parts 2 --passes 2",
            share=5,
            files=files,
            options=("--effect Ex:1e-3*dir_x", "--effect Ex:x/0", "--seed -1", "--repeats 3"),
            outputs=("--write-lbb out.csv", "--write-cmm points.csv"),
            pictures=False,
        ),
    ]


def _shop() -> list[Pattern]:
    """Files of instruments and controls, as a shop has them."""
    readings = [("x.rtl", 2), ("wide.csv", 2), ("e.dat", 1), ("laser.txt", 1)]
    points = [("p_chr.txt", 1), ("c.dfq", 1), ("a.qif", 1), ("p.csv", 1)]
    found = [
        Pattern(
            words=f"iso230 --laser dx_x={name}",
            share=share,
            files={name: ("instrument", f"instruments/{name}")},
            options=("--standard vdi3441", "--limit A=5", "--before wide.csv"),
        )
        for name, share in readings
        if name != "laser.txt"  # it states no unit
    ]
    found += [
        Pattern(
            words=f"import {name} --as {kind} --component dx_x --unit um",
            share=share,
            files={name: ("instrument", f"instruments/{name}")},
            options=("--decimal ,", "--directions forward", "--component 1"),
            outputs=("-o out.csv",),
            pictures=False,
        )
        for kind, names in (("readings", readings), ("points", points))
        for name, share in names
    ]
    found += [
        Pattern(
            words=f"inspect {name}",
            share=1,
            files={name: ("instrument", f"instruments/{name}")},
            outputs=("-o out.json",),
            pictures=False,
        )
        for name in ("b.b5r", "d.rtx", "t.csv")
    ]
    found.append(
        Pattern(
            words="import any.txt --as readings --map map.yaml",
            share=3,
            files={"map.yaml": ("map", "maps/any.yaml"), "any.txt": ("instrument", "maps/any.txt")},
            outputs=("-o out.csv",),
            pictures=False,
        )
    )
    compensate = "compensate -m machine.yaml --laser laser.csv --component pos_x --trials 1000"
    for name in CONTROLLERS:
        more = "".join(
            f" --set {key}={value}" for key, value in parameters_of(name).items() if value
        )
        table: Files = {"now.tab": ("control", f"controls/{name}.tab")}
        found.append(
            Pattern(words=f"compensate --for {name}{more} --read now.tab", share=1, files=table)
        )
        if name in ("linuxcnc", "beckhoff", "isg-csv"):
            words = f"{compensate} --for {name}{more} --current now.tab --to-file out.tab"
            found.append(Pattern(words=words, share=1, files=RING_MACHINE | LASER | table))
    found.append(
        Pattern(
            words=f"{compensate} --for table --verify after.csv",
            share=3,
            files=RING_MACHINE | LASER | {"after.csv": ("readings", "data/valdes-ring/laser.csv")},
            options=("--direction forward", "--reverse-axis"),
        )
    )
    return found


PATTERNS: list[Pattern] = [
    *_predictions(),
    *_loops(),
    *_budgets(),
    *_graphs(),
    *_shop(),
    Pattern(words="fit-components", share=8, files=FLAT, options=("--fail-if drift", *COVERAGE)),
    Pattern(words="fit-components -m machine.yaml --laser laser.csv", share=5,
            files=RING_MACHINE | LASER, options=COVERAGE),
    Pattern(words="iso230 --laser laser.csv", share=3, files=LASER,
            options=("--limit A=5", "--limit x", "--standard vdi3441", "--fail-if nonconforming")),
    Pattern(words="lengths", share=4, files=FLAT, options=(*COVERAGE, *SEEDS)),
    Pattern(words="compare --trials 2000", share=3, files=FLAT, options=(*DATUM, *SEEDS)),
    Pattern(words="anova -p part.yaml --cmm cmm.csv", share=8, files=PART | POINTS,
            options=("--method anova", "--method x", "--fail-if unusual", *DATUM)),
    Pattern(words="anova --cmm cmm.csv", share=5, files=NOMINALS, options=("--method paper",)),
    Pattern(words="thermal-fit -m machine.yaml --drift drift.csv --model ridge", share=5,
            files=RING_MACHINE | DRIFT, options=("--model x",)),
    Pattern(words="thermal-fit --drift drift.csv --model stepwise", share=2, files=DRIFT),
    Pattern(words=f"correct {RINGS}", share=6, files=RING_FILES, options=(*COVERAGE, *ANYWHERE)),
]  # fmt: skip


def drawn_call(prepared: Path, folder: Path, seed: int, number: int) -> Call:
    """Call `number` with its files written into `folder`, which is made anew."""
    rng = generator(seed, "commands", number)
    pattern = rng.choices(PATTERNS, [item.share for item in PATTERNS])[0]
    _lay_out(pattern, prepared, folder)
    name = rng.choice([*pattern.files])
    kind, source = pattern.files[name]
    content = (prepared / source).read_bytes()
    sound = Sample(kind=kind, path=prepared / source, content=content)
    (folder / name).write_bytes(damaged(sound, rng, mild=0.6))
    arguments = _arguments(pattern, rng)
    outputs = tuple(name for option, name in pairwise(arguments) if _writes(option))
    if outputs and rng.random() < 0.3:
        (folder / outputs[0]).write_bytes(OLD)
    return Call(number=number, arguments=arguments, outputs=outputs, damaged=name)


def sound_call(pattern: Pattern, prepared: Path, folder: Path) -> Call:
    """A pattern with its sound files in `folder`, which is made anew: it must come to its end,
    or damage to them would never be seen.
    """
    _lay_out(pattern, prepared, folder)
    arguments = _words(pattern)
    outputs = tuple(name for option, name in pairwise(arguments) if _writes(option))
    return Call(number=-1, arguments=arguments, outputs=outputs, damaged=next(iter(pattern.files)))


def _lay_out(pattern: Pattern, prepared: Path, folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, (_, source) in pattern.files.items():
        shutil.copyfile(prepared / source, folder / name)


def _writes(option: str) -> bool:
    return option in ("-o", "--csv", "--plot", "--to", "--to-file") or option.startswith("--write-")


def _words(pattern: Pattern) -> list[str]:
    return " ".join([pattern.words, *pattern.outputs]).split()


def _arguments(pattern: Pattern, rng: Random) -> list[str]:
    words = _words(pattern)
    if pattern.pictures and rng.random() < 0.06:
        words += ["--plot", "out.svg"]
    if pattern.options and rng.random() < 0.15:
        words += rng.choice(pattern.options).split()
    return words
