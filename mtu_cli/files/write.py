"""Reports as bytes, and files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
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
                _write_temporary(new, target, contents[path])
        yield
        _put_in_place(pending)
    finally:
        for path in (path for _, *both in pending.values() for path in both):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _write_temporary(new: Path, target: Path, content: bytes) -> None:
    with new.open("xb") as stream:
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
