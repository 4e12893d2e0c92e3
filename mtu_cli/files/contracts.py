"""Old names of `contract`, until graph, effects and budgets use the new ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import Any

from mtu_cli.errors import Problem
from mtu_cli.files.contract import MAX_DEGREE as MAX_DEGREE
from mtu_cli.files.contract import Contract as Contract
from mtu_cli.files.contract import Faults, M
from mtu_cli.files.contract import IdText as IdText
from mtu_cli.files.contract import NonNegative as NonNegative
from mtu_cli.files.contract import Positive as Positive
from mtu_cli.files.contract import check_contract as check_with_faults
from mtu_cli.files.contract import duplicates as duplicates
from mtu_cli.files.contract import is_identifier as is_identifier
from mtu_cli.files.contract import present as present
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, path_text, shown_value
from mtu_cli.findings import Finding, suggestion


class Findings(Faults):
    """Faults whose sentence is written where they are found."""

    @property
    def problems(self) -> list[Finding]:
        """The findings."""
        return self.findings

    def add(self, path: YamlPath, code: str, *, value: object = None, **given: Any) -> None:
        """One more fault at `path`."""
        path = self.existing(path)
        self.findings.append(
            Problem(
                what=code,
                file=self.document.source.shown,
                line=self.document.line_of(*path),
                path=path_text(path) or None,
                value=None if value is None else shown_value(value),
                **given,
            )
        )

    def add_missing(self, path: YamlPath, key: str, *, expected: str | None = None) -> None:
        """That the entry at `path` lacks a key."""
        Faults.add(self, path, "missing-key", key=key, expected=expected)

    def add_unknown(
        self, path: YamlPath, what: str, name: str, known: Collection[str], hint: Any = None
    ) -> None:
        """That `name` is none of those `known`."""
        path = self.existing(path)
        if known or not self.findings:
            place = {"file": self.document.source.shown, "line": self.document.line_of(*path)}
            own = {"expected": hint(name, known)} if hint else suggestion(name, known)
            self.findings.append(
                Problem(what=what, value=name, path=path_text(path), **place, **own)
            )


def check_contract(
    document: YamlDocument, model: type[M], kind: str, check: Callable[[M, Findings], None]
) -> M:
    """`contract.check_contract` with the old findings."""

    def adapted(checked: M, faults: Faults) -> None:
        check(checked, Findings(faults.document, faults.findings))

    largest = math.inf if kind == "budget" else 1e30
    return check_with_faults(document, model, kind, adapted, largest=largest)
