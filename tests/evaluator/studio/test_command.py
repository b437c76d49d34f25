"""`turnscope studio` as it is typed."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("starlette", reason="the studio's libraries are not installed (turnscope[studio])")

COMMAND = [sys.executable, "-m", "evaluator", "studio"]


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    done = subprocess.run([*COMMAND, str(tmp_path / "gone")], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "no such folder" in done.stderr
    assert "Traceback" not in done.stderr


def test_it_prints_its_link_and_ends_by_an_interrupt(tmp_path: Path) -> None:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*COMMAND, str(tmp_path), "--no-browser"], **pipes) as studio:
        assert studio.stdout is not None
        link = next(line.strip() for line in studio.stdout if "token=" in line)
        address = urlsplit(link)
        assert address.hostname == "127.0.0.1"
        assert address.port is not None
        with socket.create_connection((address.hostname, address.port), timeout=30) as wire:
            wire.sendall(f"GET / HTTP/1.1\r\nHost: {address.netloc}\r\n\r\n".encode())
            assert b"401" in wire.recv(1000)  # it is at work, and knows nobody without the link
        studio.send_signal(signal.SIGINT)
        _, said = studio.communicate(timeout=60)
    assert "Traceback" not in said
    assert studio.returncode in (0, 130)
