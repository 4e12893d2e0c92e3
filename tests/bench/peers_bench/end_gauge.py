"""Whole processes that do GUM H.1, from start to end."""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from peers_bench.agreement import DisagreementError
from peers_bench.tools import OURS, PEERS

ROOT = Path(__file__).resolve().parents[3]
BUDGET = ROOT / "configs" / "budgets" / "gum-h1-end-gauge.yaml"
PRINTED = (50000838.0, 32.0, 93.0)
"""l, u and U99 in nm, JCGM 100:2008, H.1.6; U99 there at 16 degrees of freedom, not 16.8."""

METROLOPY = """
from metrolopy import gummy
d3 = 3 ** 0.5
ls = gummy(50000623, u=25, dof=18)
d = gummy(215, u=5.8, dof=24) + gummy(0, u=3.9, dof=5) + gummy(0, u=6.7, dof=8)
dalpha = gummy(0, u=1e-6 / d3, dof=50)
theta = gummy(-0.1, u=0.2) + gummy(0, u=0.5 / 2 ** 0.5)
alphas = gummy(11.5e-6, u=2e-6 / d3)
dtheta = gummy(0, u=0.05 / d3, dof=2)
l = ls + d - ls * (dalpha * theta + alphas * dtheta)
l.p = 0.99
print(float(l.x), float(l.u), float(l.U))
"""
GTC = """
from GTC import ureal
from GTC.reporting import k_factor
d3 = 3 ** 0.5
ls = ureal(50000623, 25, 18)
d = ureal(215, 5.8, 24) + ureal(0, 3.9, 5) + ureal(0, 6.7, 8)
dalpha = ureal(0, 1e-6 / d3, 50)
theta = ureal(-0.1, 0.2) + ureal(0, 0.5 / 2 ** 0.5)
alphas = ureal(11.5e-6, 2e-6 / d3)
dtheta = ureal(0, 0.05 / d3, 2)
l = ls + d - ls * (dalpha * theta + alphas * dtheta)
print(l.x, l.u, k_factor(l.df, 99) * l.u)
"""
SUNCAL = """
from suncal import Model
d3 = 3 ** 0.5
model = Model("l = ls + d - ls*(dalpha*theta + alphas*dtheta)")
model.var("ls").measure(50000623).typeb(std=25, df=18)
model.var("d").measure(215).typeb(std=5.8, df=24).typeb(std=3.9, df=5).typeb(std=6.7, df=8)
model.var("dalpha").measure(0).typeb(std=1e-6 / d3, df=50)
model.var("theta").measure(-0.1).typeb(std=0.2).typeb(std=0.5 / 2 ** 0.5)
model.var("alphas").measure(11.5e-6).typeb(std=2e-6 / d3)
model.var("dtheta").measure(0).typeb(std=0.05 / d3, df=2)
found = model.calculate_gum()
print(found.expected["l"], found.uncertainty["l"], found.expand("l", conf=0.99))
"""
SCRIPTS = {"metrolopy": METROLOPY, "GTC": GTC, "suncal": SUNCAL}


@dataclass(frozen=True, slots=True)
class Process:
    """Seconds of each round of a process."""

    seconds: list[float]

    def over(self, other: Process) -> float:
        return statistics.median(a / b for a, b in zip(self.seconds, other.seconds, strict=True))


def run(rounds: int) -> dict[str, Process]:
    """Every package that is installed, `mtu budget`, and an interpreter that imports numpy.

    The others do the first order alone; `mtu budget` does the second and Monte Carlo too.
    Raises DisagreementError where one does not find what is printed.
    """
    present = {tool.package for tool in PEERS if tool.installed}
    commands = {
        "import numpy": [sys.executable, "-c", "import numpy"],
        OURS.package: [str(Path(sys.executable).parent / "mtu"), "budget", str(BUDGET)],
    }
    for package, script in SCRIPTS.items():
        if package in present:
            commands[package] = [sys.executable, "-W", "ignore", "-c", script]
    for package, command in commands.items():
        _check(package, _output(command))
    found = {name: Process([]) for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            start = time.perf_counter()
            _output(command)
            found[name].seconds.append(time.perf_counter() - start)
    return found


def _output(command: list[str]) -> str:
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    return done.stdout


def _check(package: str, output: str) -> None:
    if package == "import numpy":
        return
    if package == OURS.package:
        line = re.search(r"^first order +(\S+) +(\S+) +\S+ +\S+ +(\S+)", output, re.MULTILINE)
        numbers = line.groups() if line else ()
    else:
        numbers = tuple(output.split()[-3:])
    close = len(numbers) == 3 and all(
        abs(float(number) - wanted) <= allowed
        for number, wanted, allowed in zip(numbers, PRINTED, (0.5, 0.5, 1.6), strict=True)
    )
    if not close:
        raise DisagreementError(f"{package}: GUM H.1 as {' '.join(numbers)}, printed is {PRINTED}")
