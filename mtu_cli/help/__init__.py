"""The topics of `mtu help`, Markdown beside this file, and a paragraph for every finding."""

from __future__ import annotations

import re
from importlib.resources import files

from mtu_cli.findings import CATALOGUE

FINDINGS = "findings"
ORDER = (
    *("start", "machine", "readings", "points", "instruments", "conventions", "figures"),
    *("close-loop", "effects", "temperature", "budget", "graph", "simulate", "iso230"),
    *("compensation", "gates", "findings"),
    *("papers", "accuracy", "building"),
)
"""The topics as a newcomer needs them."""


def topic(name: str) -> str:
    """The Markdown of a topic."""
    return (files(__name__) / f"{name}.md").read_text("utf-8")


def paragraphs() -> dict[str, str]:
    """The paragraph of each code in help/findings.md."""
    result: dict[str, str] = {}
    for section in re.split(r"^## ", topic(FINDINGS), flags=re.MULTILINE)[1:]:
        heading, _, text = section.partition("\n")
        result |= dict.fromkeys(heading.split(", "), text.strip())
    return result


def paragraph(code: str) -> str:
    """The help of a finding: severity, sentence, and its paragraph."""
    kind = CATALOGUE[code]
    severity = kind.severity + ", meets --fail-if suspicious" * kind.suspicious
    sentence = re.sub(r"\{(\w+)[^}]*\}", r"<\1>", kind.template)
    return f"# {code} ({severity})\n\n    {sentence}\n\n{paragraphs()[code]}\n"
