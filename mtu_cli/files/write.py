"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.files.source import given_path, resolved, system_reason
from mtu_cli.findings import InputError, MtuError, error, finding


@dataclass(slots=True)
class _Pending:
    """One file on its way: the caller's path, the file behind it, the temporary file."""

    path: Path
    target: Path
    temporary: Path | None = None
    backup: Path | None = None
    placed: bool = False


def write_files(contents: Mapping[Path, bytes], *, inputs: Iterable[Path] = ()) -> None:
    """Writes all files, or none; raises as `made_ready` does."""
    with made_ready(contents, inputs=inputs) as put_in_place:
        put_in_place()


@contextmanager
def made_ready(
    contents: Mapping[Path, bytes], *, inputs: Iterable[Path] = ()
) -> Iterator[Callable[[], None]]:
    """All files, or none: temporary files beside the targets; what is given renames them.

    What else a run has to deliver goes in between, so that nothing is written where that fails.
    A device, which nothing can be taken back from, is written first: it may be full.
    `inputs` are the files that the run has read; none of them is overwritten.

    Raises InputError for a target that is an input or a folder, stands twice, lies in a
    missing folder, or may not be written; no target is changed then.
    """
    check_targets(list(contents), list(inputs))
    pending = [_Pending(path, resolved(path)) for path in contents]
    files = [item for item in pending if _is_replaceable(item.target)]
    try:
        for item in files:
            with _told(item):
                _write_temporary(item, contents[item.path])
        for item in pending:
            if item not in files:
                with _told(item):
                    item.target.write_bytes(contents[item.path])
        yield lambda: _put_in_place(files)
    finally:
        for item in files:
            _remove(item.temporary)
            _remove(item.backup)


def _put_in_place(files: list[_Pending]) -> None:
    try:
        for item in files:
            with _told(item):
                _replace(item)
    except BaseException:
        _restore(files)
        raise


@contextmanager
def _told(item: _Pending) -> Iterator[None]:
    """Raises what the system says about a file as an InputError that names it."""
    try:
        yield
    except OSError as fault:
        shown = given_path(item.path)
        raise error("not-writable", file=shown, reason=system_reason(fault)) from None


def check_targets(targets: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Whether files can be written, as far as can be told before they are there.

    Raises InputError as `write_files` does; a file that stands twice in `targets` is told too.
    """
    problems = []
    seen: dict[Path, Path] = {}
    for path in targets:
        shown = given_path(path)
        target = resolved(path)
        try:
            folder = path.is_dir()
        except OSError as fault:
            problems.append(finding("not-writable", file=shown, reason=system_reason(fault)))
            continue
        if folder:
            problems.append(
                finding("not-a-file", kind="folder", file=shown, expected="a file to write")
            )
        elif not target.parent.is_dir():
            problems.append(finding("not-writable", file=shown, reason=_no_folder(path, target)))
        if target in seen and _is_replaceable(target):
            problems.append(finding("appears-twice", what="the output", file=shown))
        seen[target] = path
        if any(overwrites(path, source) for source in inputs):
            facts = {"owner": "this run", "expected": "another name"}
            problems.append(finding("input-overwritten", file=shown, **facts))
    if problems:
        raise InputError(problems)


def _no_folder(path: Path, target: Path) -> str:
    """That the folder of a path is not there, or of where it leads as a link."""
    if path.is_symlink() and path.parent.is_dir():
        lost = given_path(target.parent)
        return f"it is a link to {given_path(target)!r}, and the folder {lost!r} does not exist"
    return f"the folder {given_path(path.parent)!r} does not exist"


def overwrites(path: Path, other: Path) -> bool:
    """Whether writing to `path` changes the file `other`, whatever links are between."""
    try:
        return resolved(path) == resolved(other) or path.samefile(other)
    except OSError:
        return False


def _is_replaceable(target: Path) -> bool:
    # A device such as /dev/stdout is written to; renaming over it would destroy it.
    return not target.exists() or target.is_file()


def _beside(target: Path, ending: str) -> Path:
    return target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.{ending}")


def _write_temporary(item: _Pending, content: bytes) -> None:
    temporary = _beside(item.target, "tmp")
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)
    # Known before it is there: whoever interrupts in between leaves no file behind.
    item.temporary = temporary
    descriptor = os.open(temporary, flags, 0o666)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    if item.target.exists():
        # A rename would also replace a file that is write-protected on purpose.
        if not os.access(item.target, os.W_OK):
            raise PermissionError(13, "Permission denied")
        temporary.chmod(stat.S_IMODE(item.target.stat().st_mode))


def _replace(item: _Pending) -> None:
    if item.temporary is None:
        raise MtuError(f"no temporary file for {item.path}")
    if item.target.exists():
        item.backup = _beside(item.target, "bak")
        try:
            os.link(item.target, item.backup)
        except OSError:
            shutil.copy2(item.target, item.backup)
    os.replace(item.temporary, item.target)
    item.placed = True


def _restore(files: list[_Pending]) -> None:
    for item in files:
        if item.placed:
            with suppress(OSError):
                if item.backup is None:
                    item.target.unlink()
                else:
                    os.replace(item.backup, item.target)
            item.placed = False


def _remove(path: Path | None) -> None:
    if path is not None:
        with suppress(OSError):
            path.unlink()
