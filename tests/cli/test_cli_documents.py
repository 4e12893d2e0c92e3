"""What the README and `mtu help` say: every command and warning, and every console block runs."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
from cli_runner import done, mtu
from support import CONFIGS

from mtu_cli.catalogue import CATALOGUE
from mtu_cli.cli.commands import app, graph
from mtu_cli.cli.help import ORDER, paragraph, topic

ROOT = CONFIGS.parent
README = (ROOT / "README.md").read_text("utf-8")
PAGES = {"README": README} | {name: topic(name) for name in ORDER}
CONSOLE = re.compile(r"^```console\n(.*?)^```", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"Save this as `(out/\S+)`:\n\n```yaml\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped studies and data, with the files that the pages ask to be saved."""
    work = tmp_path_factory.mktemp("pages")
    for name in ("configs", "data"):
        shutil.copytree(ROOT / name, work / name)
    (work / "out").mkdir()
    for text in PAGES.values():
        for path, content in SAVED.findall(text):
            (work / path).write_text(content, "utf-8")
    return work


def calls(block: str) -> list[tuple[str, list[str]]]:
    """The commands of a console block, each with the lines that it prints."""
    found: list[tuple[str, list[str]]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def holds(printed: list[str], expected: list[str]) -> bool:
    """Whether the expected lines are printed in order, with anything at each ``...``."""
    at, free = 0, False
    for line in expected:
        if line.strip() == "...":
            free = True
            continue
        places = [i for i in range(at, len(printed)) if printed[i].rstrip() == line.rstrip()]
        if not places or (not free and places[0] != at):
            return False
        at, free = places[0] + 1, False
    return free or at == len(printed)


@pytest.mark.parametrize("page", [name for name, text in PAGES.items() if CONSOLE.search(text)])
def test_console_blocks_run_as_printed(page: str, folder: Path) -> None:
    for block in CONSOLE.findall(PAGES[page]):
        for call, expected in calls(block):
            result = mtu(*shlex.split(call)[1:], cwd=folder)
            assert result.returncode in (0, 3), result.stderr
            told = [x for x in result.stderr.splitlines() if not x.startswith("warning: ")]
            printed = [*result.stdout.splitlines(), *told]
            assert holds(printed, expected), f"{call}\n{result.stdout}"


def test_the_readme_is_short_and_names_every_command() -> None:
    assert README.count("\n") <= 150
    commands = [f"mtu {each.name}" for each in app.registered_commands]
    assert [name for name in commands if name not in README] == []
    for each in graph.registered_commands:
        assert str(each.name) in README
    assert [name for name in ORDER if not PAGES[name].startswith("# ")] == []


def test_every_finding_has_a_paragraph() -> None:
    headings = [h for line in re.findall(r"^## (.*)$", topic("findings"), re.M) for h in
                line.split(", ")]  # fmt: skip
    assert [code for code in CATALOGUE if code not in headings] == []
    assert [name for name in headings if name not in CATALOGUE] == []
    assert len(headings) == len(set(headings))
    assert "Look at the record of the instrument" in paragraph("outlying-value")
    assert "(warning)" in paragraph("datum-freed")
    assert "(warning, meets --fail-if suspicious)" in paragraph("outlying-value")
    assert paragraph("too-little-data").startswith(
        "# too-little-data (error)\n\n    too little data: "
    )


@pytest.mark.parametrize("name", ["start", "budget", "close-loop", "outlying-value", "lengths"])
def test_help_prints_topics_findings_and_commands(name: str) -> None:
    text = done(mtu("help", name)).stdout
    assert "# " in text
    assert ("Usage: mtu" in text) == (name in ("budget", "close-loop", "lengths"))


def test_help_lists_its_topics_and_names_the_closest() -> None:
    listed = done(mtu("help")).stdout
    assert [name for name in ORDER if f"`mtu help {name}`" not in listed] == []
    assert "did you mean 'budget'?" in done(mtu("help", "budgt"), 2).stderr
