"""Bytes in and out: an input file as the reports know it, what is wrong with a file that has none,
and files that are written whole or not at all.
"""

from __future__ import annotations

import codecs
import hashlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mtu_cli.findings import Finding, InputError, error, finding, nearest, printable

DRIFT = "drift"
"""The role of readings that follow temperatures in time: their runs are cycles, no passes."""
SYNTHETIC = "# Synthetic"
"""How a file of `mtu simulate` begins: another one holds what somebody has measured."""
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

    `shown` never is an absolute path; `rows` counts the data rows of a CSV file, which is
    `synthetic` where `mtu simulate` has made it.
    """

    role: str
    path: Path
    shown: str
    sha256: str
    rows: int | None = None
    synthetic: bool = False


def shown_path(path: Path) -> str:
    """The name of a file in reports: as given if relative; an absolute path from the working
    folder, or its last name alone where it does not lie beneath.
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


def same(path: Path, other: Path) -> bool:
    """Whether writing to one path changes the file of the other, whatever links are between."""
    try:
        return resolved(path) == resolved(other) or path.samefile(other)
    except OSError:
        return False


def given_path(path: Path) -> str:
    """The name of a file to write in messages: the path as the user wrote it."""
    # A name need not be UTF-8; JSON must be.
    return printable(os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace"))


def system_reason(fault: Exception) -> str:
    """What the system says about a failed file operation, without the path."""
    return ((fault.strerror if isinstance(fault, OSError) else None) or str(fault)).lower()


def read_source(path: Path, role: str, *, max_bytes: int | None = None) -> tuple[Source, bytes]:
    """The file as its Source, with the SHA-256 of its bytes, and these bytes.

    Raises InputError for a missing file (with the closest name in its folder), a folder, a
    device, a file that may not be read, is empty or is larger than `max_bytes`.
    """
    file = shown_path(path)
    # What is wrong is the path that was written: of /dev/null its last name alone says nothing.
    place = {"file": given_path(path) if path.is_absolute() else file}
    try:
        details = path.stat()
        mode = details.st_mode
        # /dev/zero has no end; pipes, as of <(...), have one.
        device = stat.S_ISCHR(mode) or stat.S_ISBLK(mode)
        if device or stat.S_ISDIR(mode):
            kind = "device" if device else "folder"
            raise error("not-a-file", kind=kind, expected=f"a file ({role})", **place)
        if max_bytes is not None and details.st_size > max_bytes:
            facts = {"reason": f"{details.st_size} bytes", "expected": f"at most {max_bytes} bytes"}
            raise error("not-readable", **facts, **place)
        content = path.read_bytes()
    except FileNotFoundError:
        meant = tuple((Path(file).parent / name).as_posix() for name in near_name(path))
        raise error("no-such-file", meant=meant, **place) from None
    except (OSError, ValueError) as failed:
        raise error("not-readable", reason=system_reason(failed), **place) from None
    if not content:
        raise error("empty-file", what="text", **place)
    digest = hashlib.sha256(content).hexdigest()
    synthetic = content.startswith(SYNTHETIC.encode())
    return Source(role=role, path=path, shown=file, sha256=digest, synthetic=synthetic), content


def near_name(path: Path) -> tuple[str, ...]:
    """The file in the folder that is nearly called so, if there is one."""
    try:
        return nearest(path.name, [entry.name for entry in path.parent.iterdir()])
    except (OSError, ValueError):
        return ()


def check_text(content: bytes, file: str) -> None:
    """Raises InputError where the bytes are no UTF-8 text, with the line of the first fault."""
    # As spreadsheets call it: the plain CSV of many is in the code page of the computer.
    expected = "text saved as UTF-8"
    expected += ", in spreadsheets as CSV UTF-8" if ".csv" in file.lower() else ""
    start = content[:64].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    if kind := next((kind for mark, kind in MARKS.items() if start.startswith(mark)), None):
        raise error("not-readable", file=file, reason=f"it is {kind}", expected=expected)
    at = content.find(b"\0")
    try:
        if at < 0:
            # To find that all is ASCII makes no copy.
            if not content.isascii():
                content.decode()
            return
    except UnicodeDecodeError as fault:
        at = fault.start
    line = content.count(b"\n", 0, at) + 1
    reason = f"byte {at + 1} is 0x{content[at]:02x}"
    raise error("not-readable", file=file, line=line, reason=reason, expected=expected)


def report_bytes(document: Mapping[str, Any]) -> bytes:
    """A report as UTF-8 bytes: keys in the order given, floats to the last digit.

    Mappings stand one key a line, lists of records one record a line, other lists on one line.

    Raises ValueError for a number that is not finite and TypeError for what JSON cannot hold.
    """
    return (_written(document, "", "report") + "\n").encode()


def _written(value: Any, indent: str, place: str) -> str:
    deeper = indent + "  "
    if isinstance(value, Mapping) and value:
        lines = [
            f"{deeper}{_compact(str(key))}: {_written(item, deeper, f'{place}.{key}')}"
            for key, item in value.items()
        ]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    try:
        items = value if isinstance(value, (list, tuple)) else ()
        if any(isinstance(item, (Mapping, list, tuple)) for item in items):
            return "[\n" + ",\n".join(deeper + _compact(item) for item in value) + f"\n{indent}]"
        return _compact(value)
    except (TypeError, ValueError) as fault:
        raise type(fault)(f"{place}: {fault}") from None


def _compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


@contextmanager
def files_written(contents: Mapping[Path, bytes]) -> Iterator[None]:
    """All files, or none: temporary files beside the targets before the body of the `with`, in the
    targets' places after it. Where anything fails, also in the body, no target is changed. Devices
    come first: nothing can be taken back from them, and they may be full.

    Raises InputError for a target that is a folder, stands twice, lies in a missing folder, or may
    not be written.
    """
    if faults := target_faults(contents):
        raise InputError(faults)
    pending: dict[Path, tuple[Path, Path, Path]] = {}
    for path in filter(_is_replaceable, contents):
        target, unique = resolved(path), secrets.token_hex(6)
        new, old = (target.with_name(f".{target.name[:100]}.{unique}.{x}") for x in ("tmp", "bak"))
        pending[path] = target, new, old
    try:
        for path in contents.keys() - pending.keys():
            with _naming(path):
                path.write_bytes(contents[path])
        for path, (target, new, _) in pending.items():
            with _naming(path):
                with new.open("xb") as stream:
                    stream.write(contents[path])
                    stream.flush()
                    os.fsync(stream.fileno())
                if target.exists():
                    # A rename would also replace a file that is write-protected on purpose.
                    if not os.access(target, os.W_OK):
                        raise PermissionError(13, "Permission denied")
                    new.chmod(stat.S_IMODE(target.stat().st_mode))
        yield
        _put_in_place(pending)
    finally:
        for path in (path for _, *both in pending.values() for path in both):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _put_in_place(pending: Mapping[Path, tuple[Path, Path, Path]]) -> None:
    """Each new file in the place of its target, whose old content is kept until all are there."""
    try:
        for path, (target, new, old) in pending.items():
            with _naming(path):
                if target.exists():
                    try:
                        os.link(target, old)
                    except OSError:
                        shutil.copy2(target, old)
                os.replace(new, target)
    except BaseException:
        for target, new, old in pending.values():
            with suppress(OSError):
                if old.exists():
                    os.replace(old, target)
                elif not new.exists():
                    target.unlink()
        raise


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Raises what the system says about a file as an InputError that names it."""
    try:
        yield
    except OSError as fault:
        raise error("not-writable", file=given_path(path), reason=system_reason(fault)) from None


def target_faults(targets: Iterable[Path]) -> list[Finding]:
    """Why files cannot be written, as far as can be seen before they are there."""
    findings: list[Finding] = []
    outputs: set[Path] = set()
    for path in targets:
        place, target = {"file": given_path(path)}, resolved(path)
        if os.path.isdir(path):
            expected = "a file to write"
            findings.append(finding("not-a-file", kind="folder", expected=expected, **place))
        elif not os.path.isdir(target.parent):
            # Of a link the folder where it leads.
            folder = target.parent if os.path.isdir(path.parent) else path.parent
            reason = f"the folder {given_path(folder)!r} does not exist"
            findings.append(finding("not-writable", reason=reason, **place))
        if target in outputs and _is_replaceable(target):
            findings.append(finding("appears-twice", what="the output", **place))
        outputs.add(target)
    return findings


def _is_replaceable(target: Path) -> bool:
    # A device such as /dev/stdout is written to; renaming over it would destroy it.
    return os.path.isfile(target) or not os.path.exists(target)
