"""The fuzzer: what it must notice, that it repeats itself, and a small run of it."""

import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
from fuzz import readers
from fuzz.commands import PATTERNS, drawn_call, judged_call, sound_call
from fuzz.damage import Case, drawn_case
from fuzz.readers import judged
from fuzz.samples import KINDS, Sample, prepared_folder, samples_of
from fuzz.tally import Tally

from mtu_cli.findings import error

SEED = 5


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return prepared_folder(tmp_path_factory.mktemp("fuzz") / "sound")


def test_a_small_run_of_the_readers(prepared: Path, tmp_path: Path) -> None:
    samples = samples_of(prepared)
    for sample in (sample for each in samples.values() for sample in each):
        sound = Case(number=0, sample=sample, content=sample.content, rng=Random(1))
        assert (judged(sound).outcome, judged(sound).failure) == ("read", None), sample.path
    tally = Tally("readers", SEED, tmp_path)
    for number in range(80):
        case = drawn_case(samples, SEED, number)
        assert drawn_case(samples, SEED, number).content == case.content
        tally.add(number, case.sample.kind, case.content, "damaged", judged(case))
    assert not tally.failures
    assert not any(tmp_path.iterdir())
    kinds, outcomes = zip(*tally.outcomes, strict=True)
    assert set(outcomes) == {"read", "refused"}
    assert len(set(kinds)) > len(KINDS) // 2
    assert len(tally.contents) > 70


def test_a_small_run_of_the_commands(prepared: Path, tmp_path: Path) -> None:
    """On sound files every pattern is tried before a run; here one whose words name a place."""
    work = tmp_path / "w" / "work"
    (pattern,) = (item for item in PATTERNS if "--of P1.x" in item.words)
    verdict = judged_call(sound_call(pattern, prepared, work), work)
    assert (verdict.outcome, verdict.failure) == ("done", None), verdict
    for number in range(2):
        verdict = judged_call(drawn_call(prepared, work, SEED, number), work)
        assert verdict.failure is None, verdict
        assert verdict.outcome in ("done", "refused", "gate")


def hang() -> None:
    while True:
        pass


FAILING: dict[str, Callable[[], object]] = {
    "KeyError: 'no such key'": lambda: dict[str, object]()["no such key"],
    "over the limit at": hang,
    "RuntimeWarning: overflow": lambda: warnings.warn("overflow", RuntimeWarning, stacklevel=2),
    "words of the program, 'TypeError'": lambda: check_names("TypeError: 'NoneType' object"),
}


def check_names(reason: str) -> None:
    raise error("usage", reason=reason)


@pytest.mark.parametrize("words", FAILING)
def test_failing_readers_are_noticed_and_kept(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(readers, "LIMIT_S", 0.05)
    monkeypatch.setitem(readers.READERS, "part", lambda path, sample, rng: FAILING[words]())
    sample = Sample(kind="part", path=tmp_path / "part.yaml", content=b"sound")
    verdict = judged(Case(number=7, sample=sample, content=b"damaged", rng=Random(1)))
    assert words in str(verdict.failure)
    tally = Tally("readers", 3, tmp_path / "kept")
    tally.add(7, "part", b"damaged", "part.yaml", verdict)
    assert (tmp_path / "kept" / "readers-3-7-part.yaml").read_bytes() == b"damaged"
    told = (tmp_path / "kept" / "readers-3-7.txt").read_text()
    assert told.startswith("python -m fuzz --seed 3 --first 7 --readers 1\n")
    assert "failures: 1" in "\n".join(tally.lines())
