"""The same inputs and seed give the same bytes, wherever and however a command runs."""

from __future__ import annotations

import re
from pathlib import Path

from cli_runner import SMALL, Listing, done, listing, prepared
from cli_runner import mtu as plain_call
from cli_runner import started as mtu

SURROUNDINGS = [
    (1, {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C"}),
    (2, {"PYTHONHASHSEED": "1", "TZ": "Asia/Tokyo", "LC_ALL": "de_DE.UTF-8", "MPLBACKEND": "svg"}),
]


def outcome(folder: Path, threads: int, env: dict[str, str]) -> Listing:
    """All bytes of a call: the files it writes, and its standard streams.

    The call is made with absolute paths from another folder, at another home.
    """
    work = prepared(folder / "secret-folder")
    away = folder / "away"
    away.mkdir()
    files = ["-o", "out.json", "--csv", "out.csv", "--plot", "out.pdf"]
    call = (
        "orthogonality",
        work / "mtu.yaml",
        *files,
        "--threads",
        str(threads),
        "--trials",
        "20000",
    )
    result = done(mtu(*call, cwd=away, env=env))
    return listing(away) | {"": result.stdout.encode(), " ": result.stderr.encode()}


def test_threads_hash_seeds_languages_time_zones_and_places(tmp_path: Path) -> None:
    first, other = (outcome(tmp_path / str(n), n, env) for n, env in SURROUNDINGS)
    assert set(first) == {"", " ", "out.json", "out.csv", "out.pdf"}
    assert other == first
    for name, content in first.items():
        text = (content or b"").decode("utf-8", "replace")
        assert "secret-folder" not in text, name
        assert str(Path.home()) + "/" not in text, name
        assert not re.search(r"\b20\d\d-\d\d-\d\d|CreationDate", text), name
        assert '"path": "/' not in text, name


def test_the_seed_makes_the_difference(tmp_path: Path) -> None:
    texts: list[str] = []
    for seed in ("1", "1", "2"):
        path = tmp_path / f"{len(texts)}.json"
        call = ("orthogonality", SMALL, "--seed", seed, "--trials", "20000", "-o", path)
        done(plain_call(*call))
        texts.append(path.read_text("utf-8").replace(f'"seed": {seed}', '"seed"'))
    assert texts[0] == texts[1] != texts[2]


def test_simulated_files_are_the_same_everywhere(tmp_path: Path) -> None:
    found = []
    for threads, env in SURROUNDINGS[:2]:
        work = prepared(tmp_path / str(threads))
        done(mtu("simulate", "--write-lbb", "a.csv", "--write-cmm", "b.csv", cwd=work, env=env))
        found.append(listing(work))
    assert found[0] == found[1]
