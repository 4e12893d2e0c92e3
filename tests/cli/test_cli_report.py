"""`--report`: one HTML file that is sound, needs no other, and shows names as they are."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import html5lib
import pytest
from cli_runner import PAGES, done, mtu, shared
from support import CONFIGS

from mtu_cli.cli.commands import COMMANDS

UNDECLARED = CONFIGS / "undeclared"


def sound(path: Path) -> str:
    """The text of a report that is HTML by its grammar, with ids of its own and nothing outside."""
    text = path.read_text("utf-8")
    html5lib.HTMLParser(strict=True).parse(text)
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids)) > 0
    assert re.findall(r'(?:src|href)="(?!#)', text) == []
    assert "http" not in re.sub(r'xmlns(?::\w+)?="[^"]*"', "", text)
    return text


@pytest.mark.parametrize("call", PAGES)
def test_every_command_writes_one_sound_file(call: str) -> None:
    text, command = sound(shared(call).page), call.partition(" configs/")[0]
    for words in ("<table>", "<svg", "SHA-256", "<h2>Settings</h2>", "mtu 0."):
        assert words in text
    used = text.split("<h2>Settings</h2>")[1]
    assert ("seed " in used) == ("seed" in COMMANDS[command].options.split())


def test_names_are_text_and_a_date_is_given(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: <b>plate</b>\nfeatures:\n"
        "  '<script>alert(1)</script>': {x_mm: 10, y_mm: 20}\n  B: {x_mm: 50, y_mm: 20}\n"
    )
    machine = CONFIGS / "gilsinn-ling" / "machine.yaml"
    call = ["predict-points", "-m", machine, "-p", "part.yaml", "-q", "--report", "r.html"]
    done(mtu(*call, "--date", "1 May 2030", cwd=tmp_path))
    text = sound(tmp_path / "r.html")
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert "&lt;b&gt;plate&lt;/b&gt;" in text
    assert "1 May 2030" in text


@pytest.mark.skipif(importlib.util.find_spec("weasyprint") is not None, reason="it is installed")
def test_a_pdf_names_the_extra_that_it_needs(tmp_path: Path) -> None:
    found = done(mtu("lengths", UNDECLARED, "-q", "--report", "a.pdf", cwd=tmp_path), 2)
    assert "mtu-cli[pdf]" in found.stderr
    assert list(tmp_path.iterdir()) == []
