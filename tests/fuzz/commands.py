"""Calls of every command on files, one of them damaged: their end, words, and outputs."""

import csv
import io
import json
import resource
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from cli_runner import MTU, Listing, environment, listing

from fuzz.damage import damaged, generator
from fuzz.messages import unclean, warned
from fuzz.readers import LIMIT_S
from fuzz.samples import KIND_OF, MILL, RING, parameters_of, sample
from fuzz.tally import Verdict
from mtu_cli.formats.control import CONTROLLERS

OLD = b'{"old": true}\n'
WALL_S = 120.0
LARGEST_KB = 2_000_000
CODES = (0, 2, 3)


class Pattern(NamedTuple):
    """A command as it is called and how often; every file among its words may be damaged, those of
    a folder, too. One of `options` is added at times. Outputs are a report and a table if the
    words name none.
    """

    share: int
    words: str
    options: Sequence[str] = ()


COVERAGE = ("--k nan", "--k 0", "--k 3", "--k 1e308", "--k -1", "--digits 0", "--digits 3")
SEEDS = ("--seed -1", "--seed 0", "--seed 99999999999999999999", "--threads 0", "--threads 2")
ASKED = (*COVERAGE, *SEEDS, "--at x=1", "--at T_1_degC=20", "--at a", "--at =",
         "--correlation independent")  # fmt: skip
DATUM = ("--datum offset", "--datum offset,rotation", "--datum x")
MACHINE, PART = f"-m {MILL}/machine.yaml", f"-p {MILL}/part.yaml"
KNOWN, CMM = f"{MACHINE} {PART} -c mill.json", "--cmm data/undeclared/cmm.csv"
RINGS = f"-m {RING}/machine.yaml -p {RING}/part.yaml -c ring.json -c drift.json"
LASER, DRIFT = "--laser data/valdes-ring/laser.csv", "--drift data/valdes-ring/drift.csv"
COMPENSATE = f"compensate -m {RING}/machine.yaml {LASER} --component pos_x --trials 1000"
READ = ("x.rtl", "wide.csv", "e.dat", "laser.txt")
IMPORTED = {"readings": READ, "points": ("p_chr.txt", "c.dfq", "a.qif", "p.csv")}
BALL, TRIALS = "configs/graphs/ball-centre.yaml", "--trials 2000"
SETS = {
    name: "".join(f" --set {key}={value}" for key, value in parameters_of(name).items() if value)
    for name in CONTROLLERS
}
PATTERNS: list[Pattern] = [
    Pattern(7, f"predict-points {KNOWN} {TRIALS}",
            ("--grid 3", "--grid 0", "--grid 2,2,2", "--covariance", *ASKED)),
    Pattern(8, f"lengths {KNOWN} {TRIALS}",
            ("--fail-if nonconforming=0.01", "--fail-if nonconforming", *ASKED)),
    Pattern(6, f"orthogonality {KNOWN} {TRIALS}", ASKED),
    Pattern(8, f"compare {KNOWN} {CMM} {TRIALS}", ("--fail-if biased", *DATUM, *ASKED)),
    Pattern(6, f"close-loop {KNOWN} {CMM} --effects effects/few.yaml --max-effects 1 -o out.json "
            "--write-machine out.yaml", ("--alpha 2", "--exclude backlash", "--seed 3", *DATUM)),
    Pattern(5, f"simulate {KNOWN} --parts 2 --passes 2 --write-lbb out.csv --write-cmm out-p.csv",
            ("--effect Ex:1e-3*dir_x", "--effect Ex:x/0", "--seed -1", "--repeats 3")),
    *(Pattern(4, f"budget configs/budgets/{name}.yaml {TRIALS}", (*COVERAGE, *SEEDS))
      for name in ("gum-h1-end-gauge", "gum-h2-impedance", "ring-gauge-diameter", "valdes-x275")),
    *(Pattern(2, f"graph {what} configs/graphs/{name}.yaml", SEEDS if "trials" in what else ())
      for name in ("bore-to-bore", "ball-centre", "work-coordinates")
      for what in ("check", f"simulate {TRIALS}", "draw --to out.dot")),
    Pattern(3, f"graph sweep {BALL} --vary axis_um=0.5:2.5:3 --of P1.x {TRIALS}",
            ("--vary probe_um=1,2", "--vary repeats=1,1e3", "--vary a=b", *SEEDS)),
    # laser.txt states no unit.
    *(Pattern(1, f"iso230 --laser dx_x=instruments/{name}",
              ("--standard vdi3441", "--limit A=5", "--before instruments/wide.csv"))
      for name in READ[:-1]),
    *(Pattern(1, f"import instruments/{name} --as {kind} --component dx_x --unit um -o out.csv",
              ("--decimal ,", "--directions forward", "--component 1"))
      for kind, names in IMPORTED.items() for name in names),
    Pattern(1, "inspect instruments/d.rtx -o out.json"),
    Pattern(3, "import maps/any.txt --as readings --map maps/any.yaml -o out.csv"),
    *(Pattern(1, f"compensate --for {name}{more} --read controls/{name}.tab")
      for name, more in SETS.items()),
    Pattern(3, f"{COMPENSATE} --for beckhoff{SETS['beckhoff']} --current controls/beckhoff.tab "
            "--to-file out.tab -o out.json"),
    Pattern(3, f"{COMPENSATE} --for table --verify data/valdes-ring/laser.csv",
            ("--direction forward", "--reverse-axis")),
    Pattern(9, "fit-components flat", ("--fail-if drift", *COVERAGE)),
    Pattern(4, f"fit-components -m {RING}/machine.yaml {LASER}", COVERAGE),
    Pattern(3, f"iso230 {LASER}",
            ("--limit A=5", "--limit x", "--standard vdi3441", "--fail-if nonconforming")),
    Pattern(5, f"compare flat {TRIALS}", (*DATUM, *SEEDS)),
    Pattern(8, f"anova {PART} {CMM}",
            ("--method anova", "--method x", "--fail-if unusual", *DATUM)),
    Pattern(5, "anova --cmm data/undeclared/nominals.csv", ("--method paper",)),
    Pattern(6, f"thermal-fit -m {RING}/machine.yaml {DRIFT} --model ridge", ("--model x",)),
    Pattern(6, f"correct {RINGS} --cmm data/valdes-ring/ring.csv", ASKED),
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Call:
    """A drawn call: `outputs` are the files that it must write whole or not at all."""

    number: int
    arguments: list[str]
    outputs: tuple[str, ...]
    damaged: str


def files_of(pattern: Pattern) -> list[str]:
    """The files of the prepared folder that a call reads."""
    words = [part for word in pattern.words.split() for part in word.split("=")]
    return [name for name in KIND_OF if name in words or name.partition("/")[0] in words]


def sound_call(pattern: Pattern, prepared: Path, folder: Path) -> Call:
    """A pattern with its sound files in `folder`, which is made anew: it must come to its end,
    or damage to them would never be seen.
    """
    shutil.rmtree(folder, ignore_errors=True)
    files = files_of(pattern)
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(prepared / name, folder / name)
    more = "" if " out." in pattern.words else " -o out.json --csv out.csv"
    return _call(-1, (pattern.words + more).split(), files[0])


def drawn_call(prepared: Path, folder: Path, seed: int, number: int) -> Call:
    """Call `number` with its files written into `folder`, which is made anew."""
    rng = generator(seed, "commands", number)
    pattern = rng.choices(PATTERNS, [item.share for item in PATTERNS])[0]
    words = sound_call(pattern, prepared, folder).arguments
    name = rng.choice(files_of(pattern))
    (folder / name).write_bytes(damaged(sample(prepared, name), rng, mild=0.6))
    if "--csv" in words and rng.random() < 0.06:
        words += ["--plot", "out.svg"]
    if pattern.options and rng.random() < 0.15:
        words += rng.choice(pattern.options).split()
    call = _call(number, words, name)
    if call.outputs and rng.random() < 0.3:
        (folder / call.outputs[0]).write_bytes(OLD)
    return call


def _call(number: int, words: list[str], name: str) -> Call:
    writing = ("-o", "--csv", "--plot", "--to", "--to-file")
    pairs = [
        pair for pair in pairwise(words) if pair[0].startswith("--write-") or pair[0] in writing
    ]
    return Call(number=number, arguments=words, outputs=tuple(y for _, y in pairs), damaged=name)


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a process ended; `seconds` of processor time, `kilobytes` of memory at most, of all
    processes so far.
    """

    code: int
    output: str
    error: str
    seconds: float
    kilobytes: int


def run(arguments: list[str], folder: Path) -> Ended:
    """The installed command in a folder, stopped after two minutes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(
            [MTU, *arguments], cwd=folder, env=environment(), stdin=subprocess.DEVNULL,
            capture_output=True, timeout=WALL_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        done = subprocess.CompletedProcess(arguments, -9, b"", late.stderr or b"")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Ended(
        code=done.returncode,
        output=done.stdout.decode("utf-8", "replace"),
        error=done.stderr.decode("utf-8", "replace"),
        seconds=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        kilobytes=after.ru_maxrss,
    )


def judged_call(call: Call, folder: Path) -> Verdict:
    """The verdict on one call in its folder."""
    before = listing(folder)
    ended = run(call.arguments, folder)
    failure = failure_of(ended, before, listing(folder), call)
    outcome = {0: "done", 2: "refused", 3: "gate"}.get(ended.code, "failed")
    return Verdict(outcome=outcome, failure=failure, message=ended.error.strip())


def failure_of(ended: Ended, before: Listing, after: Listing, call: Call) -> str | None:
    """Why a call ended badly, or None; `before` and `after` are the files of its folder."""
    words = ended.error
    if ended.code not in CODES or "Traceback" in words:
        return f"exit code {ended.code}: {words[-3000:]}"
    if ended.seconds > LIMIT_S or ended.kilobytes > LARGEST_KB:
        return f"{ended.seconds:.1f} s of processor time, {ended.kilobytes} kB of memory"
    if found := warned(words):
        return found
    names = {*before, *after}
    changed = sorted(name for name in names if before.get(name, b"-") != after.get(name, b"-"))
    if ended.code != 2:
        return _failure_of_outputs(changed, after, call)
    if ended.output:
        return f"exit code 2 with output: {ended.output[:300]!r}"
    if changed:
        return f"exit code 2, but files changed: {changed}"
    if not words.startswith("mtu: "):
        return f"exit code 2 without words of its own: {words[:300]!r}"
    return unclean(words.removeprefix("mtu: ").removesuffix("\n"))


def _failure_of_outputs(changed: list[str], after: Listing, call: Call) -> str | None:
    # What cannot stand in a table stands beside it.
    if not set(changed) <= {*call.outputs, *(f"{name}.txt" for name in call.outputs)}:
        return f"files changed that are no outputs: {changed}"
    for name in call.outputs:
        content = after.get(name)
        if content is None or content == OLD:
            return f"without {name}, or with the old one"
        if fault := whole(name, content):
            return f"{name}: {fault}"
    return None


def whole(name: str, content: bytes) -> str | None:
    """What is wrong with an output, or None: reports, tables and pictures must be complete."""
    ending = name.rpartition(".")[2]
    try:
        text = content.decode()
        if ending == "json":
            document = json.loads(text, parse_constant=_refused)
            return None if str(document["schema"]).startswith("mtu/") else "no report"
        if ending == "csv":
            lines = [line for line in text.splitlines(keepends=True) if line[0] != "#"]
            rows = [*csv.reader(io.StringIO("".join(lines), newline=""), strict=True)]
            sound = text.endswith("\n") and len({len(row) for row in rows}) == 1
            return None if sound else "no whole table"
        end = {"svg": "</svg>", "dot": "}", "pl": "."}.get(ending, "")
        return None if text.strip() and text.rstrip().endswith(end) else "no whole text"
    except (ValueError, KeyError, TypeError, IndexError, csv.Error) as error:
        return f"cannot be read: {error}"


def _refused(name: str) -> Any:
    raise ValueError(f"{name} in a report")
