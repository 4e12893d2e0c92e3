"""Reports as bytes, and files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import secrets
import stat
from collections.abc import Iterable, Mapping
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


def write_files(contents: Mapping[Path, bytes]) -> None:
    """All files, or none: temporary files beside the targets are renamed when all are there.

    Raises InputError for a target that is a folder, stands twice, lies in a missing folder, or may
    not be written; no target is changed then.
    """
    if faults := target_faults(contents):
        raise InputError(faults)
    temporary: dict[Path, Path] = {}
    path = Path()
    try:
        for path, content in contents.items():
            target = resolved(path)
            if not _is_replaceable(path):
                path.write_bytes(content)
                continue
            temporary[path] = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.tmp")
            with temporary[path].open("xb") as stream:
                stream.write(content)
            if target.exists():
                # A rename would also replace a file that is write-protected on purpose.
                if not os.access(target, os.W_OK):
                    raise PermissionError(13, "Permission denied")
                temporary[path].chmod(stat.S_IMODE(target.stat().st_mode))
        for path, new in temporary.items():
            new.replace(resolved(path))
    except OSError as fault:
        raise error("not-writable", file=given_path(path), reason=system_reason(fault)) from None
    finally:
        for new in temporary.values():
            new.unlink(missing_ok=True)


def target_faults(targets: Iterable[Path]) -> list[Finding]:
    """Why files cannot be written, as far as can be seen before they are there."""
    findings: list[Finding] = []
    seen: set[Path] = set()
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
        if target in seen and _is_replaceable(target):
            findings.append(finding("appears-twice", what="the output", **place))
        seen.add(target)
    return findings


def _is_replaceable(target: Path) -> bool:
    # A device such as /dev/stdout is written to; renaming over it would destroy it.
    return os.path.isfile(target) or not os.path.exists(target)
