"""Writing that is killed: every file is the old one or the new one, at whatever step."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

OLD = {"a.json": b"old a\n" * 100, "b.csv": b"old b\n" * 100}
NEW = {"a.json": b"new a\n" * 40_000, "b.csv": b"new b\n" * 40_000, "c.svg": b"new c\n"}
STEP_BY_STEP = """
import os, sys
from pathlib import Path
from mtu_cli.files.source import files_written
folder = Path(sys.argv[1])
new = {folder / name: (name[0].join(("new ", "\\n")) * count).encode()
       for name, count in (("a.json", 40_000), ("b.csv", 40_000), ("c.svg", 1))}
def killed_at(last):
    done = 0
    def step(frame, event, call):
        nonlocal done
        done += event == "c_call"
        if done > last:
            os.kill(os.getpid(), 9)
    sys.setprofile(step)
    with files_written(new):
        pass
    os._exit(0)
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        killed_at(int(line))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def whole(folder: Path) -> set[str]:
    """Which of the files are new, all of them being whole."""
    new = set()
    for name, content in NEW.items():
        path = folder / name
        if not path.exists():
            assert name not in OLD, f"{name} is gone"
            continue
        found = path.read_bytes()
        assert found in (OLD.get(name), content), f"{name} has {len(found)} bytes"
        if found == content:
            new.add(name)
    return new


def fresh(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()
    for name, content in OLD.items():
        (folder / name).write_bytes(content)


def test_killed_before_every_step(tmp_path: Path) -> None:
    """A kill before the first call of what is written in C, before the second, and so on."""
    process = subprocess.Popen(
        [sys.executable, "-c", STEP_BY_STEP, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    seen: list[int] = []
    code = -signal.SIGKILL
    for last in range(3000):
        fresh(tmp_path)
        assert process.stdin is not None
        assert process.stdout is not None
        print(last, file=process.stdin, flush=True)
        code = int(process.stdout.readline())
        seen.append(len(whole(tmp_path)))
        if code != -signal.SIGKILL:
            break
    process.communicate(timeout=30)
    assert code == 0
    assert len(seen) > 20
    assert seen[0] == 0
    assert seen[-1] == len(NEW)
    assert seen == sorted(seen)
    assert not [path for path in tmp_path.iterdir() if path.name not in NEW]
