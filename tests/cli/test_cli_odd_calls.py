"""Calls that are odd but thinkable: options twice, a notebook's settings, names with dollars."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli_runner import SMALL, done, mtu, prepared, refused
from support import SIMULATED


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A copy of the small study."""
    return prepared(tmp_path / "work")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            ["--fail-if", "nonconforming=0.5", "--fail-if", "nonconforming=0.01"],
            "--fail-if nonconforming appears twice",
        ),
    ],
    ids=["gate"],
)
def test_an_option_that_stands_twice_is_refused(call: list[str], words: str, work: Path) -> None:
    assert words in refused(work, "lengths", *call)


def test_options_that_may_be_repeated_still_may(work: Path) -> None:
    done(mtu("lengths", work, "--at", "T_a_degC=1", "--at", "T_b_degC=2", "-q"))


def test_pictures_do_not_ask_what_a_notebook_set(tmp_path: Path) -> None:
    env = {"MPLBACKEND": "module://no_such_package.backend"}
    done(mtu("lengths", SMALL, "--plot", tmp_path / "a.png", env=env))
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize("command", ["lengths", "predict-points"])
def test_names_with_dollars_are_drawn_as_they_are(command: str, work: Path) -> None:
    part = work / "part.yaml"
    text = part.read_text("utf-8")
    renamed = re.sub(r"\bA\b", "'$A_{$'", text)
    assert renamed != text
    part.write_text(renamed, "utf-8")
    done(mtu(command, work, "--plot", work / "a.png"))


def test_an_equation_that_grows_beyond_numbers_is_told(work: Path) -> None:
    machine = work / "machine.yaml"
    text = machine.read_text("utf-8")
    grown = text.replace("Ex: dx_x - y*axy", "Ex: dx_x - y*axy*exp(9*y)")
    assert grown != text
    machine.write_text(grown, "utf-8")
    message = refused(work, "predict-points")
    assert "the equation Ex" in message
    assert "no exponential" in message


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (["lengths", "-o", f"{'a' * 300}.json"], "cannot be written"),
        (["lengths", f"{'a' * 350}"], "the system refuses"),
    ],
)
def test_a_name_that_no_system_takes_is_told_and_cut(
    call: list[str], what: str, work: Path
) -> None:
    message = refused(work, *call)
    assert len(message) < 300
    assert message.endswith(f"a...: {what}: file name too long\n")


def test_a_study_beside_a_machine_of_its_own_is_told_of(work: Path) -> None:
    message = refused(work, "predict-points", "-m", "machine.yaml", "-p", "part.yaml")
    assert "an estimate of" in message
    assert "mtu.yaml is not read where -m is given without a study" in message


@pytest.mark.parametrize("study", [SMALL, SIMULATED], ids=["small", "simulated"])
def test_the_gate_of_drifts_is_the_star_of_the_table(study: Path) -> None:
    """Both hold each kind of test against its own kind alone."""
    result = mtu("fit-components", study, "--fail-if", "drift")
    starred = [line.split()[0] for line in result.stdout.splitlines() if re.search(r"\d\*", line)]
    assert result.returncode == (3 if starred else 0)
    assert all(name in result.stderr for name in starred)
