"""Counts of a run, what failed kept on disk, and the lines that show both."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """`outcome` of a case, with `failure` None; else what went wrong."""

    outcome: str
    failure: str | None = None
    message: str = ""


@dataclass
class Tally:
    """Of one task: outcomes by kind of file or command, and the failures."""

    task: str
    seed: int
    folder: Path
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    contents: set[bytes] = field(default_factory=set)
    failures: list[tuple[int, str, str]] = field(default_factory=list)

    def add(self, number: int, kind: str, content: bytes, name: str, verdict: Verdict) -> None:
        """One more case; the file of one that failed is kept with the reason."""
        self.outcomes[kind, verdict.outcome] += 1
        self.contents.add(blake2b(kind.encode() + content, digest_size=8).digest())
        if verdict.failure is None:
            return
        self.failures.append((number, kind, verdict.failure))
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{self.task}-{self.seed}-{number}"
        (self.folder / f"{stem}-{name}").write_bytes(content)
        again = f"python -m fuzz --seed {self.seed} --first {number} --{self.task} 1"
        (self.folder / f"{stem}.txt").write_text(f"{again}\n{kind}\n{verdict.failure}\n", "utf-8")

    def lines(self) -> Iterator[str]:
        """The counts in words."""
        yield f"{self.task}: {self.outcomes.total()} cases, {len(self.contents)} different files"
        for (kind, outcome), count in sorted(self.outcomes.items()):
            yield f"  {kind:<16}{count:7} {outcome}"
        yield f"  failures: {len(self.failures)}"
        for number, kind, failure in self.failures[:20]:
            yield f"    case {number} ({kind}): {failure.strip().splitlines()[-1][:300]}"
