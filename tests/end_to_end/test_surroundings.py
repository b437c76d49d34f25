"""A report is written without a network, a home directory, and a writable installation."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from calibration.compilation import cache
from tests.end_to_end.commands import ROOT
from tests.evaluator.diagnosis.hidden import write_hidden

# Audit hooks see what any library does, and forbid it as the system would; as sitecustomize, in every process.
WITHOUT = f"""
import errno, os, sys

def forbid(event, given):
    if event in ("socket.getaddrinfo", "socket.gethostbyname"):
        raise OSError(errno.ENETUNREACH, "no network")
    if event == "socket.connect" and isinstance(given[1], tuple):  # of two processes of this machine: a path
        raise OSError(errno.ENETUNREACH, "no network")
    if event == "open":
        path, mode, flags = given
        writes = flags & (os.O_WRONLY | os.O_RDWR) if mode is None else set(mode) & set("wxa+")
        if writes and isinstance(path, str) and os.path.abspath(path).startswith(({str(ROOT)!r}, sys.prefix)):
            raise OSError(errno.EROFS, "read-only", path)
    if event == "os.mkdir" and os.path.abspath(given[0]).startswith(({str(ROOT)!r}, sys.prefix)):
        raise OSError(errno.EROFS, "read-only", given[0])

sys.addaudithook(forbid)
try:
    import pwd
    def unknown(_): raise KeyError("no such user")
    pwd.getpwuid = unknown
except ModuleNotFoundError:
    pass
"""
ASKED = """
import socket
from pathlib import Path
try:
    print(Path.home())
except RuntimeError:
    print("no home")
for forbidden in (lambda: socket.create_connection(("127.0.0.1", 9)), lambda: open(WHERE, "w")):
    try:
        forbidden()
    except OSError as error:
        print(error.strerror)
"""
REPORT = """
import sys
from evaluator.cli import main
sys.argv = ["turnscope", "report", EXPERIMENT, "-o", "out", "-q", "--workers", "1"]
sys.exit(main())
"""


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder with these means alone; compiled kernels are where they were."""
    (folder / "sitecustomize.py").write_text(WITHOUT, encoding="utf-8")
    kept = {"XDG_CACHE_HOME": str(cache._user_cache()), "PYTHONPATH": os.pathsep.join(map(str, (folder, ROOT)))}
    around = {name: value for name, value in os.environ.items() if name not in ("HOME", "USER", "LOGNAME")}
    done = [sys.executable, "-B", "-c", code]
    return subprocess.run(done, cwd=folder, env=around | kept, capture_output=True, text=True, check=False, timeout=420)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows always has a home directory")
def test_a_report_needs_no_network_no_home_directory_and_no_writable_installation(tmp_path: Path) -> None:
    asked = run(f"WHERE = {str(ROOT / 'evaluator' / 'new.txt')!r}{ASKED}", tmp_path)
    assert asked.stdout.split("\n") == ["no home", "no network", "read-only", ""], asked.stderr
    experiment = write_hidden(tmp_path / "day", {}, commands=[(33.3, 14.4), (60.0, 60.0)], seconds=2.0)
    done = run(f"EXPERIMENT = {str(experiment)!r}{REPORT}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000
