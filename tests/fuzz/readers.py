"""One damaged file through its reader: read, refused, or a failure with its reason."""

import gzip
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from types import FrameType

import numpy as np
from support import written_effect

from fuzz.damage import Case
from fuzz.messages import unclean
from fuzz.samples import Kind, Sample, parameters_of
from fuzz.tally import Verdict
from mtu_cli.files.budget import load_budget
from mtu_cli.files.effects import load_effects
from mtu_cli.files.extend_machine import extended_machine
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import load_part
from mtu_cli.files.readings import read_points, read_readings
from mtu_cli.files.reports_read import read_report
from mtu_cli.files.source import check_text
from mtu_cli.files.study import load_study
from mtu_cli.findings import InputError
from mtu_cli.formats.base import Ask, Import, raw_file
from mtu_cli.formats.control import CONTROLLERS
from mtu_cli.formats.instruments import read
from mtu_cli.model.effect_library import effect_library
from mtu_cli.model.graph.net import load_graph

LIMIT_S = 10.0
"""Of processor time; with the clock of the wall other programs could make a hang."""
WALL_S = 60.0


class Hang(BaseException):
    """The time is up; no `except Exception` of the reader may catch it."""


def _over(number: int, frame: FrameType | None) -> None:
    raise Hang(f"over the limit at {'' if frame is None else traceback.format_stack(frame)[-1]}")


@contextmanager
def within_time() -> Iterator[None]:
    """Raises Hang inside where the limits are passed."""
    handlers = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    before = {number: signal.signal(number, _over) for number in handlers}
    try:
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        signal.setitimer(signal.ITIMER_REAL, WALL_S)
        yield
    finally:
        for number, timer in handlers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


Reader = Callable[[Path, Sample, Random], object]
_known_machine, _known_part = cache(load_machine), cache(load_part)


def judged(case: Case) -> Verdict:
    """The verdict on one case, its file written beside the sound one."""
    path = written(case.sample, case.content)
    reader = READERS[case.sample.kind]
    outcome, failure, message = "read", None, ""
    try:
        with warnings.catch_warnings(), within_time():
            warnings.simplefilter("error")
            reader(path, case.sample, case.rng)
    except InputError as error:
        outcome, message = "refused", str(error)
        failure = unclean(message)
    except (Exception, Hang):
        outcome, failure = "failed", traceback.format_exc()
    return Verdict(outcome=outcome, failure=failure, message=message)


def written(sample: Sample, content: bytes) -> Path:
    """The damaged file in the place where its sound neighbours are found."""
    suffix = sample.path.suffix + (".gz" if content[:2] == gzip.compress(b"")[:2] else "")
    path = sample.path.with_name(f"damaged{suffix}")
    path.write_bytes(content)
    return path


def _machine(path: Path, sample: Sample, rng: Random) -> object:
    loaded = load_machine(path)
    _extended(loaded)
    return loaded


def _extended(machine: LoadedMachine) -> None:
    """A machine that was read takes an effect, and is itself but for it when read again."""
    equation = next(iter(machine.machine.equations), "Ex")
    effect = written_effect(
        name="found", parameters={"slope": (1.5, 0.1, "um/m")}, equations={equation: "slope*x"}
    )
    try:
        found = extended_machine(machine, [effect])
    except InputError as error:
        # A machine may have no room for it: a constant called x, say.
        if "gives back" in str(error):
            raise AssertionError(str(error)) from error
        return
    before, after = machine.machine, found.machine.machine
    assert after.effects[:-1] == before.effects, "the effects were changed"
    assert after.components == before.components, "the components were changed"
    assert after.equations == before.equations, "the equations were changed"


def _effects(path: Path, sample: Sample, rng: Random) -> object:
    if sample.path.stem == "few":
        # As close-loop reads it; the built-in families would take their own names.
        return effect_library([path])
    return load_effects(path)


def _readings(path: Path, sample: Sample, rng: Random) -> object:
    role, components = "drift" if sample.kind == "drift" else "lbb", None
    # Drift may be read without a machine.
    if sample.context is not None and rng.random() < 0.8:
        components = _known_machine(sample.context).machine.components
    for_fit = role == "lbb" and rng.random() < 0.7
    found = read_readings([(path, role)], components, for_fit=for_fit)
    assert len(found), "no readings"
    assert np.isfinite(found.error).all(), "an error that is no number"
    assert (found.code >= 0).all(), "a reading of no component"
    assert (found.pass_number[found.has_pass] > -(2**53)).all(), "a pass beyond whole numbers"
    for values in found.covariates.values():
        assert len(values) == len(found), "a covariate of another length"
        if values.dtype.kind == "f":
            assert not np.isinf(values).any(), "an infinite covariate"
    return found


def _points(path: Path, sample: Sample, rng: Random) -> object:
    places = None
    if sample.context is not None and rng.random() < 0.9:
        places = _known_part(sample.context).part.places()
    found = read_points([(path, "cmm")], places)
    assert len(found), "no points"
    assert np.isfinite(found.measured[:, :2]).all(), "a place that is no number"
    assert np.isfinite(found.nominal[:, :2]).all(), "a nominal place that is no number"
    assert not np.isinf(found.measured).any(), "an infinite place"
    known = np.isnan(found.direction) | (np.abs(found.direction) == 1)
    assert known.all(), "a direction that is none"
    return found


def _instrument(path: Path, sample: Sample, rng: Random) -> object:
    found = read(raw_file(path, "file"), Ask(component="dx_x", unit="um"))
    _check_imported(found)
    return found


def _check_imported(found: Import) -> None:
    assert {len(column) for column in found.columns.values()} <= {len(found.rows)}
    errors = [x for x in found.columns.get("error", ()) if x is not None]
    assert np.isfinite(errors).all(), "an error that is no number"


def _map(path: Path, sample: Sample, rng: Random) -> object:
    assert sample.context is not None
    ask = Ask(kind=rng.choice(("readings", "points", "drift")), component="dx_x", unit="um")
    found = read(raw_file(sample.context, "file"), replace(ask, profile=path))
    _check_imported(found)
    return found


def _control(path: Path, sample: Sample, rng: Random) -> object:
    name = sample.path.stem
    content = path.read_bytes()
    check_text(content, str(path))
    held = CONTROLLERS[name].read_back(content.decode("utf-8-sig"), parameters_of(name))
    assert (np.diff(held.at) > 0).all(), "positions that do not rise"
    assert np.isfinite(held.errors).all(), "an error that is no number"
    return held


def _plainly(read: Callable[[Path], object]) -> Reader:
    return lambda path, sample, rng: read(path)


READERS: dict[Kind, Reader] = {
    "readings": _readings, "drift": _readings, "points": _points, "machine": _machine,
    "part": _plainly(lambda path: load_part(path).part.places()), "study": _plainly(load_study),
    "effects": _effects, "budget": _plainly(load_budget), "graph": _plainly(load_graph),
    "components": _plainly(read_report), "thermal": _plainly(read_report),
    "instrument": _instrument, "control": _control, "map": _map,
}  # fmt: skip
