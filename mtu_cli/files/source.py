"""An input file as the reports know it, and its bytes with plain words for what is wrong."""

from __future__ import annotations

import codecs
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.findings import Finding, closest, error, finding, printable

DRIFT = "drift"
"""The role of readings that follow temperatures in time: their runs are cycles, no passes."""
HOLDS = {
    "lbb": "laser ball bar readings",
    "laser": "laser readings",
    DRIFT: "drift readings",
    "cmm": "measured points",
    "components": "a fit-components or thermal-fit report",
}
"""What a file is to hold whose role is the name of its option."""
KINDS = {".yaml": "yaml", ".yml": "yaml", ".csv": "csv", ".json": "json"}
"""Of files that may be meant for each other, by their endings."""
MARKS = {
    b"<!doctype html": "a web page: was a login or error page saved?",
    b"<html": "a web page: was a login or error page saved?",
    b"pk\x03\x04": "an Excel workbook",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    codecs.BOM_UTF32_LE: "UTF-32 text",
    codecs.BOM_UTF16_LE: "UTF-16 text",
    codecs.BOM_UTF16_BE: "UTF-16 text",
}
"""First bytes of what is saved in place of data, in lower case."""


def a_file(kind: str) -> str:
    """A file of a kind in words: ``an effects file``."""
    return f"{'an' if kind[:1] in 'aeiou' else 'a'} {kind} file"


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One input file: its role in the run, its name in reports and the hash of its bytes.

    `shown` never is an absolute path; `rows` counts the data rows of a CSV file.
    """

    role: str
    path: Path
    shown: str
    sha256: str
    rows: int | None = None


def shown_path(path: Path) -> str:
    """The name of a file in reports and messages, with ``/`` on every system.

    A relative path as given, an absolute one relative to the working folder where it lies
    beneath it, else the bare file name: reports hold no absolute paths.
    """
    if not path.is_absolute():
        return given_path(Path(os.path.normpath(path)))
    try:
        return given_path(resolved(path).relative_to(resolved(Path.cwd())))
    except (ValueError, OSError):
        return given_path(Path(path.name))


def resolved(path: Path) -> Path:
    """Where a path leads, as far as its links can be followed: a loop of them stays as it is."""
    return Path(os.path.realpath(path))


def given_path(path: Path) -> str:
    """The name of a file to write in messages: the path as the user wrote it."""
    # A name need not be UTF-8; JSON must be.
    return printable(os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace"))


def system_reason(fault: Exception) -> str:
    """What the system says about a failed file operation, without the path."""
    return ((fault.strerror if isinstance(fault, OSError) else None) or str(fault)).lower()


def read_source(path: Path, role: str, *, max_bytes: int | None = None) -> tuple[Source, bytes]:
    """The file's bytes and its Source; raises InputError as `read_bytes` does."""
    shown, content = read_bytes(path, role, max_bytes=max_bytes)
    digest = hashlib.sha256(content).hexdigest()
    return Source(role=role, path=path, shown=shown, sha256=digest), content


def read_bytes(path: Path, role: str, *, max_bytes: int | None = None) -> tuple[str, bytes]:
    """The file's name in messages and its bytes.

    Raises InputError for a missing file (with the closest name in its folder), a folder, a
    device, a file that may not be read, is empty or is larger than `max_bytes`.
    """
    with _readable(path, role) as told:
        size = path.stat().st_size
        if max_bytes is not None and size > max_bytes:
            expected = f"at most {max_bytes} bytes ({role})"
            raise error("not-readable", file=told, reason=f"{size} bytes", expected=expected)
        content = path.read_bytes()
    if not content:
        raise error("empty-file", file=told, expected=HOLDS.get(role, a_file(role)))
    return shown_path(path), content


def hash_of(path: Path, role: str) -> str:
    """The hash of a file's bytes, read piece by piece; raises InputError as `read_bytes` does."""
    with _readable(path, role), path.open("rb") as stream:
        if stream.seekable():
            return hashlib.file_digest(stream, "sha256").hexdigest()
        return hashlib.sha256(stream.read()).hexdigest()


@contextmanager
def _readable(path: Path, role: str) -> Iterator[str]:
    """What the system says about a file as an InputError; gives the name for messages."""
    # What is wrong is the path that was written: of /dev/null its last name alone says nothing.
    told = given_path(path) if path.is_absolute() else shown_path(path)
    try:
        mode = path.stat().st_mode
        # /dev/zero has no end; pipes, as of <(...), have one.
        if stat.S_ISDIR(mode) or stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            kind = "folder" if stat.S_ISDIR(mode) else "device"
            raise error("not-a-file", kind=kind, file=told, expected=f"a file ({role})")
        yield told
    except FileNotFoundError:
        place = {"file": told, **_nearby(path)}
        # A study may be given by its folder.
        if role == "study" and not _kind(path.name):
            place = {"expected": "a study or its folder", **place}
        raise error("no-such-file", **place) from None
    except (OSError, ValueError) as fault:
        raise error("not-readable", file=told, reason=system_reason(fault)) from None


def begins_with(path: Path, mark: str) -> bool:
    """Whether a file begins so, blank lines left out; as if it did where there is nothing in it but
    blanks, or no such file.
    """
    start = mark.encode()
    try:
        if not path.is_file():
            return True
        with path.open("rb") as stream:
            found = b""
            while len(found) < len(start) and (more := stream.read(1 << 20)):
                found = (found + more).removeprefix(codecs.BOM_UTF8).lstrip()
    except OSError:
        return False
    return not found or found.startswith(start)


def missing_file(folder: Path, name: str) -> Finding | None:
    """The Finding of a `name` below `folder` that is no file, or None where it is one."""
    path = folder / name
    try:
        if path.is_dir():
            return finding("not-a-file", kind="folder", value=name, expected="a file")
        if path.exists():
            return None
    except (OSError, ValueError) as fault:
        return finding("not-readable", reason=system_reason(fault), value=name)
    if near := _near_name(path):
        return finding("no-such-file", value=name, meant=((Path(name).parent / near).as_posix(),))
    expected = "a path from the folder of the file that names it, or a whole one"
    return finding("no-such-file", value=name, expected=expected)


def _nearby(path: Path) -> dict[str, object]:
    if near := _near_name(path):
        return {"meant": (shown_path(path.parent / near),)}
    return {} if path.parent.is_dir() else {"expected": "a path to an existing folder"}


def _near_name(path: Path) -> str | None:
    """The file of the same kind in the folder that is nearly called so."""
    kind = _kind(path.name)
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except (OSError, ValueError):
        return None
    # The ending that both have makes no two names alike.
    stems = {_stem(name): name for name in names if kind in ("", _kind(name))}
    near = closest(_stem(path.name), stems)
    return None if near is None else stems[near]


def _stem(name: str) -> str:
    return Path(name.casefold().removesuffix(".gz")).stem


def _kind(name: str) -> str:
    """What the ending of a name says that it holds; "" where that is not of ours."""
    return KINDS.get(Path(name.casefold().removesuffix(".gz")).suffix, "")


def check_text(content: bytes, shown: str) -> None:
    """Raises InputError where the bytes are no UTF-8 text, with the place of the first fault."""
    start = content[:64].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    expected = "text saved as UTF-8"
    # What they call it: the plain CSV of many spreadsheets is in the code page of the computer.
    expected += ", in spreadsheets as CSV UTF-8" if ".csv" in shown.lower() else ""
    if kind := next((kind for mark, kind in MARKS.items() if start.startswith(mark)), None):
        raise error("not-readable", file=shown, reason=f"this is {kind}", expected=expected)
    at = content.find(b"\0")
    if at < 0:
        try:
            content.decode()
        except UnicodeDecodeError as fault:
            at = fault.start
    if at >= 0:
        line = content.count(b"\n", 0, at) + 1
        reason = f"byte {at + 1} is 0x{content[at]:02x}"
        raise error("not-text", file=shown, line=line, reason=reason, expected=expected)
