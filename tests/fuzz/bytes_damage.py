"""Damage to the bytes of a file, whatever they mean."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from random import Random

from fuzz.extremes import SIGNS

Damage = Callable[[bytes, Random], bytes]


def _span(content: bytes, rng: Random) -> tuple[int, int]:
    """A piece, mostly a short one."""
    start = rng.randrange(len(content) + 1)
    size = rng.choice((1, 1, 2, 4, 16, 64, 512))
    return start, min(len(content), start + size)


def flip(content: bytes, rng: Random) -> bytes:
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 3, 20))):
        if found:
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def remove(content: bytes, rng: Random) -> bytes:
    start, stop = _span(content, rng)
    return content[:start] + content[stop:]


def insert(content: bytes, rng: Random) -> bytes:
    start, _ = _span(content, rng)
    new = rng.choice(SIGNS) if rng.random() < 0.8 else rng.randbytes(rng.choice((1, 2, 8)))
    return content[:start] + new + content[start:]


def overwrite(content: bytes, rng: Random) -> bytes:
    start, stop = _span(content, rng)
    return content[:start] + rng.choice(SIGNS) + content[stop:]


def double(content: bytes, rng: Random) -> bytes:
    start, stop = _span(content, rng)
    times = rng.choice((1, 1, 1, 2, 50))
    return content[:stop] + content[start:stop] * times + content[stop:]


def truncate(content: bytes, rng: Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def behead(content: bytes, rng: Random) -> bytes:
    return content[rng.randrange(len(content) + 1) :]


def swap_lines(content: bytes, rng: Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if len(lines) > 1:
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def double_line(content: bytes, rng: Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if lines:
        i = rng.randrange(len(lines))
        lines[i:i] = [lines[i]] * rng.choice((1, 1, 2, 9))
    return b"".join(lines)


def remove_line(content: bytes, rng: Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if lines:
        del lines[rng.randrange(len(lines))]
    return b"".join(lines)


def indent_line(content: bytes, rng: Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if lines:
        i = rng.randrange(len(lines))
        lines[i] = rng.choice((b" ", b"  ", b"\t", b"- ", b"# ")) + lines[i]
    return b"".join(lines)


def line_ends(content: bytes, rng: Random) -> bytes:
    end = rng.choice((b"\r\n", b"\r", b"\n\n", b"\n\r", b"\x85", b"\xe2\x80\xa8", b""))
    return content.replace(b"\n", end)


def encode_anew(content: bytes, rng: Random) -> bytes:
    coding = rng.choice(("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037"))
    return content.decode("utf-8", "replace").encode(coding, "replace")


def pack(content: bytes, rng: Random) -> bytes:
    """Packed as it is, in two members, cut short, damaged, or with padding behind."""
    whole = gzip.compress(content, mtime=0)
    match rng.randrange(5):
        case 0:
            return gzip.compress(content[:50], mtime=0) + gzip.compress(content[50:], mtime=0)
        case 1:
            return truncate(whole, rng)
        case 2:
            return flip(whole, rng)
        case 3:
            return whole + rng.randbytes(rng.choice((1, 2, 30)))
    return whole


MARKS = [b"\n", b"::", b",", b"nan", b"1e999", b"\t", b'"', b"<", b";", b"=", b"[", b"-", b"0"]
"""Put between the bytes of a file of another program."""

DAMAGES: tuple[Damage, ...] = (
    flip, flip, remove, remove, insert, insert, insert, overwrite, overwrite, double, truncate,
    behead, swap_lines, double_line, remove_line, indent_line, line_ends, encode_anew, pack,
)  # fmt: skip


def damaged_bytes(content: bytes, rng: Random) -> bytes:
    """One damage, drawn from all of them."""
    return rng.choice(DAMAGES)(content, rng)


def nudged_bytes(content: bytes, rng: Random) -> bytes:
    """A few places changed: a byte, a gap, a sign that files of programs are made of, a copy."""
    found = bytearray(content)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(found) or 1)
        match rng.randrange(4):
            case 0:
                found[at : at + 1] = bytes([rng.randrange(256)])
            case 1:
                del found[at : at + rng.randint(1, 30)]
            case 2:
                found[at:at] = rng.choice(MARKS)
            case _:
                found[at:at] = found[at : at + rng.randint(1, 60)]
    return bytes(found)
