"""A studio that serves a folder in this process, and a client that says exactly what it is told to say."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the studio's libraries are not installed (turnscope[studio])")
pytest.importorskip("uvicorn", reason="the studio's libraries are not installed (turnscope[studio])")

import uvicorn

from evaluator.studio.server import listening_on, server_of
from tests.waiting import HANGS_S


@dataclass(frozen=True)
class Serving:
    """A running studio: its port, the opening link, and the cookie that following it gave."""

    port: int
    link: str
    cookie: str

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(
        self, method: str, path: str, body: bytes | str | None = None, *, own: bool = True, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body. own: with the cookie and, for changes, the origin; headers replace those."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=HANGS_S)
        said = {"Host": f"127.0.0.1:{self.port}"}
        if own:
            said |= {"Cookie": self.cookie} | ({"Origin": self.origin} if method == "POST" else {})
        said |= {name.replace("_", "-").title(): value for name, value in headers.items()}
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        content = body.encode() if isinstance(body, str) else body
        if content is not None:
            said.setdefault("Content-Length", str(len(content)))
        for name, value in said.items():
            if value:
                connection.putheader(name, value)
        connection.endheaders(content)
        answer = connection.getresponse()
        result = answer.status, dict(answer.getheaders()), answer.read()
        connection.close()
        return result

    def get(self, path: str) -> Any:
        status, _, body = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def post(self, path: str, content: Any) -> Any:
        status, _, body = self.ask("POST", path, json.dumps(content))
        assert status == 200, body
        return json.loads(body)

    def step(self, screen: str, identifier: str, way: str = "undo", run: str = "") -> str:
        """Undo or redo the last change of a screen; gives what it was."""
        path = f"/api/undo/{screen}/{identifier}"
        change = self.get(f"{path}?run={run}")[way]
        return str(self.post(path, {"way": way, "number": change["number"], "run": run})["words"])

    def refused(self, path: str, content: Any) -> tuple[int, str]:
        status, _, body = self.ask("POST", path, json.dumps(content))
        return status, str(json.loads(body)["error"])


@contextmanager
def serving(folder: Path) -> Iterator[Serving]:
    """Serve a folder until the block ends."""
    listening = listening_on(0)
    server, link = server_of(folder, listening)
    thread = threading.Thread(target=_run, args=(server, listening), daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive(), "the studio ended before it began to serve"
        time.sleep(0.01)
    port = listening.getsockname()[1]
    found = Serving(port, link, "")
    _, headers, _ = found.ask("GET", link.removeprefix(found.origin), own=False)
    try:
        yield Serving(port, link, headers["set-cookie"].split(";")[0])
    finally:
        server.should_exit = True
        thread.join(20)


def _run(server: uvicorn.Server, listening: socket.socket) -> None:
    server.run(sockets=[listening])
