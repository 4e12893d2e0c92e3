"""`mtu help` and `mtu schema`: topics, findings and contracts."""

from __future__ import annotations

import re
import sys
from importlib.resources import files

from mtu_cli.cli.options import Options
from mtu_cli.findings import CATALOGUE, error, nearest

FINDINGS = "findings"
ORDER = (
    *("start", "machine", "readings", "points", "instruments", "conventions", "figures"),
    *("close-loop", "effects", "temperature", "budget", "graph", "simulate", "iso230"),
    *("compensation", "gates", "findings"),
    *("papers", "accuracy", "building"),
)
"""The topics as a newcomer needs them."""


def schema(options: Options) -> None:
    """Prints the JSON Schema of a contract."""
    import json

    from mtu_cli.files.contract import json_schema

    print(json.dumps(json_schema(options.kind), indent=2))


def help(options: Options) -> None:
    """Prints a topic, the paragraph of a finding, or the help of a command."""
    from mtu_cli.cli.commands import COMMANDS, app

    commands = [*COMMANDS, "graph"]
    name = " ".join(options.topic or ())
    if not name:
        titles = {each: topic(each).partition("\n")[0].removeprefix("# ") for each in ORDER}
        lines = [f"- `mtu help {each}` — {title}" for each, title in titles.items()]
        show("\n".join(["# Help", "", *lines, "- `mtu help CODE` — a warning or error", ""]))
    elif name in ORDER:
        show(topic(name))
    elif name in CATALOGUE:
        show(paragraph(name))
    elif name not in commands:
        meant = nearest(name, [*ORDER, *commands, *CATALOGUE])
        expected = "a topic, a command, or the code of a finding (mtu help lists the topics)"
        raise error("unknown-name", what="topic", value=name, expected=expected, meant=meant)
    if name in commands:
        app([*name.split(), "--help"], prog_name="mtu", standalone_mode=False)
        from mtu_cli.reports.document import help_text

        show(help_text(name))


def topic(name: str) -> str:
    """The Markdown of a topic."""
    return (files("mtu_cli") / "help" / f"{name}.md").read_text("utf-8")


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


def show(text: str) -> None:
    """Markdown, rendered on a terminal and as it is in a pipe."""
    if not sys.stdout.isatty():
        sys.stdout.write(text)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(text))
