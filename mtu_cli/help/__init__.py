"""The topics of `mtu help`, Markdown beside this file, and a paragraph for every finding."""

from __future__ import annotations

import re
from importlib.resources import files

from mtu_cli.findings import CATALOGUE

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


def paragraph(code: str) -> str:
    """The help of a finding: severity, sentence, and its paragraph in help/findings.md."""
    kind = CATALOGUE[code]
    severity = kind.severity + ", meets --fail-if suspicious" * kind.suspicious
    sentence = re.sub(r"\{(\w+)[^}]*\}", r"<\1>", kind.template)
    sections = re.split(r"^## ", topic("findings"), flags=re.MULTILINE)[1:]
    pairs = (section.split("\n", 1) for section in sections)
    says = next(text.strip() for heading, text in pairs if code in heading.split(", "))
    return f"# {code} ({severity})\n\n    {sentence}\n\n{says}\n"
