"""Reports as bytes, and files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mtu_cli.files.source import given_path, resolved, system_reason
from mtu_cli.findings import Finding, InputError, error, finding


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
    value = value.tolist() if hasattr(value, "tolist") else value
    try:
        compound = (Mapping, list, tuple)
        items = value if isinstance(value, (list, tuple)) else ()
        if any(isinstance(x, compound) or getattr(x, "ndim", 0) > 0 for x in items):
            return "[\n" + ",\n".join(deeper + _compact(item) for item in value) + f"\n{indent}]"
        return _compact(value)
    except (TypeError, ValueError) as fault:
        raise type(fault)(f"{place}: {fault}") from None


def _compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"JSON cannot hold a {type(value).__name__}")


@contextmanager
def made_ready(contents: Mapping[Path, bytes]) -> Iterator[Callable[[], None]]:
    """All files, or none: temporary files beside the targets; what is given renames them.

    What else a run has to deliver goes in between, so that nothing is written where that fails.
    A device, which nothing can be taken back from, is written first: it may be full.

    Raises InputError for a target that is a folder, stands twice, lies in a missing folder, or may
    not be written; no target is changed then.
    """
    check_targets(list(contents))
    pending: dict[Path, tuple[Path, Path, Path]] = {}
    for path in filter(_is_replaceable, contents):
        target, unique = resolved(path), secrets.token_hex(6)
        new, old = (target.with_name(f".{target.name[:100]}.{unique}.{x}") for x in ("tmp", "bak"))
        pending[path] = target, new, old
    try:
        for path, (target, new, _) in pending.items():
            with _naming(path):
                _write_temporary(new, target, contents[path])
        for path in (path for path in contents if path not in pending):
            with _naming(path):
                path.write_bytes(contents[path])
        yield lambda: _put_in_place(pending)
    finally:
        for path in (path for _, *both in pending.values() for path in both):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _write_temporary(new: Path, target: Path, content: bytes) -> None:
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(new, flags, 0o666), "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    if target.exists():
        # A rename would also replace a file that is write-protected on purpose.
        if not os.access(target, os.W_OK):
            raise PermissionError(13, "Permission denied")
        new.chmod(stat.S_IMODE(target.stat().st_mode))


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


def check_targets(targets: Sequence[Path]) -> None:
    """Whether files can be written, as far as can be seen before they are there.

    Raises InputError as `made_ready` does; also for a file that stands twice in `targets`.
    """
    findings: list[Finding] = []
    seen: set[Path] = set()
    for path in targets:
        place, target = {"file": given_path(path)}, resolved(path)
        try:
            if path.is_dir():
                expected = "a file to write"
                findings.append(finding("not-a-file", kind="folder", expected=expected, **place))
            elif not target.parent.is_dir():
                # Of a link the folder where it leads.
                folder = target.parent if path.parent.is_dir() else path.parent
                reason = f"the folder {given_path(folder)!r} does not exist"
                findings.append(finding("not-writable", reason=reason, **place))
        except OSError as fault:
            findings.append(finding("not-writable", reason=system_reason(fault), **place))
        if target in seen and _is_replaceable(target):
            findings.append(finding("appears-twice", what="the output", **place))
        seen.add(target)
    if findings:
        raise InputError(findings)


def _is_replaceable(target: Path) -> bool:
    # A device such as /dev/stdout is written to; renaming over it would destroy it.
    return not target.exists() or target.is_file()
