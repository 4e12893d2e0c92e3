"""Counts of a run, what failed kept on disk, and the lines that tell of both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path

from fuzz.readers import Verdict


@dataclass
class Tally:
    """Of one task: outcomes by kind of file or command, the slowest cases, and the failures."""

    task: str
    seed: int
    folder: Path
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    contents: set[bytes] = field(default_factory=set)
    slowest: list[tuple[float, int, str]] = field(default_factory=list)
    failures: list[tuple[int, str, str]] = field(default_factory=list)

    def add(self, number: int, kind: str, content: bytes, name: str, verdict: Verdict) -> None:
        """One more case; the file of one that failed is kept with the reason."""
        self.outcomes[kind, verdict.outcome] += 1
        self.contents.add(blake2b(kind.encode() + content, digest_size=8).digest())
        self.slowest = sorted([*self.slowest, (verdict.seconds, number, kind)])[-3:]
        if verdict.failure is None:
            return
        self.failures.append((number, kind, verdict.failure))
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{self.task}-{self.seed}-{number}"
        (self.folder / f"{stem}-{name}").write_bytes(content)
        again = f"python -m fuzz --seed {self.seed} --first {number} --{self.task} 1"
        (self.folder / f"{stem}.txt").write_text(f"{again}\n{kind}\n{verdict.failure}\n", "utf-8")

    @property
    def count(self) -> int:
        """Of cases."""
        return sum(self.outcomes.values())

    def lines(self) -> Iterator[str]:
        """The counts in words."""
        yield f"{self.task}: {self.count} cases, {len(self.contents)} different files"
        for kind in sorted({kind for kind, _ in self.outcomes}):
            counts = {word: n for (item, word), n in sorted(self.outcomes.items()) if item == kind}
            told = ", ".join(f"{n} {word}" for word, n in counts.items())
            yield f"  {kind:<16}{sum(counts.values()):7}  {told}"
        for seconds, number, kind in reversed(self.slowest):
            yield f"  slow: case {number} ({kind}) {seconds:.2f} s"
        yield f"  failures: {len(self.failures)}"
        for number, kind, failure in self.failures[:20]:
            last = failure.strip().splitlines()[-1]
            yield f"    case {number} ({kind}): {last[:300]}"
