"""Values written as JSON are read back as they were, whatever they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from property_settings import tried

from mtu_cli.files.reports_read import read_json
from mtu_cli.files.write import report_bytes

LOOKS_LIKE = (
    "1e-6", "0o17", "0x1F", "007", "no", "NULL", "~", ".inf", "-.5", "12:30", "2024-05-03", "- a",
    "a: b", "a #b", "&a", "*a", "!!int 1", "%a", "@", "`", "|", ">", "{a}", "[a", "'", '"', " a ",
    "a\nb", "\n", "\t", "\x85", "\u2028", "\ufeff", "\x07", "---", "...", "?", "=", "true", "",
)  # fmt: skip
texts = st.one_of(st.sampled_from(LOOKS_LIKE), st.text(max_size=12))
numbers = st.one_of(
    st.integers(-(10**40), 10**40), st.floats(allow_nan=False, allow_infinity=False)
)
scalars = st.one_of(texts, numbers, st.booleans(), st.none())
keys = texts


def grown(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.one_of(st.lists(inner, max_size=4), st.dictionaries(keys, inner, max_size=4))


values: st.SearchStrategy[Any] = st.recursive(scalars, grown, max_leaves=12)
mappings = st.dictionaries(keys, values, min_size=1, max_size=5)


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
