"""How many examples properties are tried on (few in the suite, more with MTU_EXAMPLES), and plain
values.
"""

import os
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

TIMES = int(os.environ.get("MTU_EXAMPLES", "1"))
"""Times as many as in the suite."""


def tried(examples: int) -> settings:
    """The same examples in every run; those of folders that tests share are independent."""
    return settings(
        derandomize=True,
        deadline=None,
        database=None,
        max_examples=examples * TIMES,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )


LOOKS_LIKE = (
    "1e-6", "0o17", "0x1F", "007", "no", "NULL", "~", ".inf", "-.5", "12:30", "2024-05-03", "- a",
    "a: b", "a #b", "&a", "*a", "!!int 1", "%a", "@", "`", "|", ">", "{a}", "[a", "'", '"', " a ",
    "a\nb", "\n", "\t", "\x85", "\u2028", "\ufeff", "\x07", "---", "...", "?", "=", "true", "",
)  # fmt: skip
texts = st.one_of(st.sampled_from(LOOKS_LIKE), st.text(max_size=12))
numbers = st.one_of(
    st.integers(-(10**40), 10**40), st.floats(allow_nan=False, allow_infinity=False)
)


def plain_values(keys: st.SearchStrategy[str]) -> st.SearchStrategy[Any]:
    return st.recursive(
        st.one_of(texts, numbers, st.booleans(), st.none()),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4), st.dictionaries(keys, inner, max_size=4)
        ),
        max_leaves=12,
    )
