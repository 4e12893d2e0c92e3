"""Values written as JSON are read back as they were, whatever they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from property_settings import plain_values, texts, tried

from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import report_bytes

mappings = st.dictionaries(texts, plain_values(texts), min_size=1, max_size=5)


def same(one: Any, two: Any) -> bool:
    """Equal in kind too: 1 is neither 1.0 nor true."""
    return repr(one) == repr(two)


@tried(150)
@given(data=mappings)
def test_reports_are_read_back(tmp_path: Path, data: dict[str, Any]) -> None:
    content = report_bytes(data)
    assert content.endswith(b"}\n")
    (tmp_path / "r.json").write_bytes(content)
    assert same(read_json(tmp_path / "r.json", "report")[1], data)
