"""Two runs of the same sets, paired: `python -m loop_bench.compare OLD NEW`.

Lists each diagnosis that changed, by kind, with the share that became right and wrong, and the
rates of both runs on the sets that both have.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from loop_bench import judge
from loop_bench.judge import Record
from loop_bench.records import identity, read
from loop_bench.rows import ROWS

Pair = tuple[Record, Record]


def paired(old: Path, new: Path) -> list[Pair]:
    first = {identity(one): one for one in read(old)}
    return [(first[identity(one)], one) for one in read(new) if identity(one) in first]


def diagnosis(record: Record) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Verdict, names and the first class, without regard to order."""
    report = record["report"]
    if report["code"]:
        return "refused", (), ()
    first = tuple(sorted(judge.first_class(record)))
    return report["verdict"], tuple(sorted(judge.names(record))), first


def right(record: Record) -> bool:
    """Each effect that is claimed, or one of its class, is there, and all that is there is among
    them. What the library has no name for is flagged; another shape may be; the rest is not.
    """
    if record["report"]["code"]:
        return False
    true = record["truth"]["names"]
    if None in true:
        return judge.flagged(record) and not judge.named_wrong(record)
    held = all(judge.held(record, i) for i in range(len(true)))
    if record["kind"].startswith("misshapen"):
        return (held or judge.flagged(record)) and not judge.named_wrong(record)
    return held and not judge.unexplained(record) and not judge.beside(record)


def in_words(record: Record) -> str:
    verdict, _, first = diagnosis(record)
    names = " + ".join(judge.names(record) if not record["report"]["code"] else [])
    more = f" [{', '.join(first)}]" if len(first) > 1 else ""
    return f"{verdict} {names}{more}".strip()


def changes(pairs: Sequence[Pair]) -> Iterator[str]:
    kinds: dict[str, list[Pair]] = defaultdict(list)
    for pair in pairs:
        kinds[pair[0]["kind"]].append(pair)
    for kind, some in kinds.items():
        moved = [pair for pair in some if diagnosis(pair[0]) != diagnosis(pair[1])]
        ways = Counter(way(pair) for pair in moved)
        counts = ", ".join(f"{ways[name]} {name}" for name in WAYS if ways[name])
        yield f"{kind}: {len(moved)} of {len(some)} changed{': ' if counts else ''}{counts}"
        for pair in sorted(moved, key=lambda item: WAYS.index(way(item))):
            true = " + ".join(map(str, pair[0]["truth"]["names"])) or "nothing"
            old, new = (in_words(record) for record in pair)
            yield f"  {way(pair)} {pair[0]['index']}: {true}: {old} -> {new}"


WAYS = ("became wrong", "became right", "right as before", "wrong as before")


def way(pair: Pair) -> str:
    before, after = map(right, pair)
    if before == after:
        return "right as before" if before else "wrong as before"
    return "became right" if after else "became wrong"


def rates(pairs: Sequence[Pair]) -> Iterator[str]:
    yield f"{'measure':58s} {'old':>32s} {'new':>32s}"
    for row in ROWS:
        old, new = (row.of([pair[i] for pair in pairs]) for i in range(2))
        if old.count or new.count:
            holds = new.holds(row.hold, row.beyond)
            yield f"{row.label:58s} {old.words():>32s} {new.words():>32s}  {holds}".rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(prog="loop_bench.compare")
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    given = parser.parse_args()
    pairs = paired(given.old, given.new)
    print("\n".join([*changes(pairs), "", *rates(pairs)]))


if __name__ == "__main__":
    main()
