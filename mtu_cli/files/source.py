"""An input file as the reports know it, and its bytes with plain words for what is wrong."""

from __future__ import annotations

import codecs
import hashlib
import os
import stat
import threading
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.errors import Problem, closest, fault, is_near, printable, reason
from mtu_cli.findings import Finding

_CHUNK = 1 << 20
DRIFT = "drift"
"""The role of readings that follow temperatures in time: their runs are cycles, no passes."""
HOLDS = {
    "lbb": "ball-bar readings",
    "laser": "laser readings",
    DRIFT: "drift readings",
    "cmm": "measured points",
    "components": "a fit-components or thermal-fit report",
}
"""What a file is to hold whose role is the name of its option."""
KINDS = {".yaml": "yaml", ".yml": "yaml", ".csv": "csv", ".json": "json"}
"""Of files that may be meant for each other, by their endings."""


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
        return _text(Path(os.path.normpath(path)))
    try:
        return _text(resolved(path).relative_to(resolved(Path.cwd())))
    except (ValueError, OSError):
        return _text(Path(path.name))


def resolved(path: Path) -> Path:
    """Where a path leads, as far as its links can be followed: a loop of them stays as it is."""
    return Path(os.path.realpath(path))


def given_path(path: Path) -> str:
    """The name of a file to write in messages: the path as the user wrote it."""
    return _text(path)


def _text(path: Path) -> str:
    # A name need not be UTF-8; JSON must be.
    return printable(os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace"))


class Digest:
    """SHA-256 of bytes, calculated while they are read."""

    def __init__(self, content: bytes) -> None:
        self._found = ""
        self._thread = threading.Thread(target=self._calculate, args=(content,), daemon=True)
        self._thread.start()

    def _calculate(self, content: bytes) -> None:
        self._found = hashlib.sha256(content).hexdigest()

    def hexadecimal(self) -> str:
        """The digest, as soon as it is there."""
        self._thread.join()
        return self._found


class RunningDigest:
    """SHA-256 of bytes that come piece by piece."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, content: bytes) -> None:
        """The next piece."""
        self._hash.update(content)

    def hexadecimal(self) -> str:
        """The digest of all pieces so far."""
        return self._hash.hexdigest()


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
    shown = shown_path(path)
    # What is wrong is the path that was written: of /dev/null its last name alone says nothing.
    told = given_path(path) if path.is_absolute() else shown
    try:
        if path.is_dir():
            raise fault("is a folder", file=told, expected=f"a file ({role})")
        of = path.stat()
        # /dev/zero has no end; pipes, as of <(...), have one.
        if stat.S_ISCHR(of.st_mode) or stat.S_ISBLK(of.st_mode):
            raise fault("is a device", file=told, expected=f"a file ({role})")
        size = of.st_size
        if max_bytes is not None and size > max_bytes:
            raise fault(
                f"has {size} bytes", file=told, expected=f"at most {max_bytes} bytes ({role})"
            )
        content = path.read_bytes()
    except FileNotFoundError:
        # A study may be given by its folder.
        folder = " or folder" if role == "study" and not _kind(path.name) else ""
        raise fault(f"no such file{folder}", file=told, expected=_nearby(path)) from None
    except PermissionError:
        raise fault("may not be read: permission denied", file=told) from None
    except (OSError, ValueError) as error:
        raise fault(f"cannot be read: {reason(error)}", file=told) from None
    if not content:
        raise fault("the file is empty", file=told, expected=HOLDS.get(role, a_file(role)))
    return shown, content


def hash_of(path: Path, role: str) -> str:
    """The hash of a file's bytes, read piece by piece; raises InputError as `read_bytes` does."""
    running = RunningDigest()
    try:
        if path.is_file():
            with path.open("rb") as stream:
                while piece := stream.read(_CHUNK):
                    running.update(piece)
            return running.hexadecimal()
    except (OSError, ValueError):
        running = RunningDigest()
    # The same words for what cannot be read.
    running.update(read_bytes(path, role)[1])
    return running.hexadecimal()


def begins_with(path: Path, mark: str) -> bool:
    """Whether a file begins so, blank lines left out; as if it did where there is nothing in it but
    blanks, or no such file.
    """
    start = mark.encode()
    try:
        if not path.is_file():
            return True
        with path.open("rb") as stream:
            found = stream.read(len(codecs.BOM_UTF8)).removeprefix(codecs.BOM_UTF8).lstrip()
            while len(found) < len(start) and (more := stream.read(_CHUNK)):
                found = found + more if found else more.lstrip()
    except OSError:
        return False
    return not found or found.startswith(start)


def missing_file(folder: Path, name: str) -> Finding | None:
    """The Problem of a `name` below `folder` that is no file, or None where it is one."""
    path = folder / name
    try:
        if path.exists() and not path.is_dir():
            return None
        if path.is_dir():
            return Problem(what="is a folder", value=name, expected="a file")
    except (OSError, ValueError) as error:
        return Problem(what=f"cannot be read: {reason(error)}", value=name)
    near = _near_name(path)
    where = "a path from the folder of the file that names it, or a whole one"
    hint = where if near is None else f"did you mean {(Path(name).parent / near).as_posix()!r}?"
    return Problem(what="no such file", value=name, expected=hint)


def _nearby(path: Path) -> str | None:
    near = _near_name(path)
    if near is not None:
        return f"did you mean {shown_path(path.parent / near)!r}?"
    return None if path.parent.is_dir() else "a path to an existing folder"


def _near_name(path: Path) -> str | None:
    """The file of the same kind in the folder that is nearly called so."""
    kind = _kind(path.name)
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except (OSError, ValueError):
        return None
    near = closest(path.name, [name for name in names if kind in ("", _kind(name))])
    if near is None or is_near(path.name, near) or Path(near).stem == path.name:
        return near
    return None


def _kind(name: str) -> str:
    """What the ending of a name says that it holds; "" where that is not of ours."""
    end = Path(name.casefold().removesuffix(".gz")).suffix
    return KINDS.get(end, "")


def check_text(content: bytes, shown: str) -> None:
    """Raises InputError where the bytes are no UTF-8 text, with the place of the first fault."""
    _check_kind(content, shown)
    null = content.find(b"\0")
    if null >= 0:
        raise fault(
            f"not a text file: byte {null + 1} is zero",
            file=shown,
            line=_line_at(content, null),
            expected="UTF-8 text",
        )
    if content.isascii():
        return
    decoder = codecs.getincrementaldecoder("utf-8")()
    view = memoryview(content)
    for start in range(0, len(content), _CHUNK):
        held = len(decoder.getstate()[0])
        end = min(start + _CHUNK, len(content))
        try:
            decoder.decode(view[start:end], final=end == len(content))
        except UnicodeDecodeError as error:
            at = start - held + error.start
            raise fault(
                f"not UTF-8: byte {at + 1} is 0x{content[at]:02x}",
                file=shown,
                line=_line_at(content, at),
                expected=f"text saved as UTF-8{_in_spreadsheets(shown)}",
            ) from None


def _in_spreadsheets(shown: str) -> str:
    """What they call it: the plain CSV of many is in the code page of the computer."""
    return ", in spreadsheets as CSV UTF-8" if ".csv" in shown.lower() else ""


def _check_kind(content: bytes, shown: str) -> None:
    start = content[:512].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    what = None
    if start.startswith((b"<!doctype html", b"<html", b"<head", b"<body")):
        what = "looks like a web page, not like data: was a login or error page saved?"
    elif content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        what = "looks like an Excel workbook"
    elif content.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)) or _mostly_zero(content):
        what = "is UTF-32 text"
    elif content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or _every_other_zero(
        content
    ):
        what = "is UTF-16 text"
    if what is not None:
        raise fault(what, file=shown, expected="text saved as UTF-8")


def _mostly_zero(content: bytes) -> bool:
    """Whether a start of letters has three zero bytes beside each: UTF-32 without its mark."""
    start = content[:64]
    return any(
        len(start) > 7
        and all(start[place::4])
        and not any(any(start[other::4]) for other in range(4) if other != place)
        for place in (0, 3)
    )


def _every_other_zero(content: bytes) -> bool:
    """Whether a start of letters has a zero byte beside each: UTF-16 without its mark."""
    start = content[:64]
    sides = start[::2], start[1::2]
    return any(
        len(zero) > 1 and not any(zero) and all(letters) for zero, letters in (sides, sides[::-1])
    )


def _line_at(content: bytes, offset: int) -> int:
    return content.count(b"\n", 0, offset) + 1
