"""Serve the studio on the loopback, and only there, until it is interrupted."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

import uvicorn

from evaluator.studio.app import application
from evaluator.studio.protocol import Impatient
from evaluator.studio.security import OPEN, Secrets

LOOPBACK = "127.0.0.1"
MOST_CONNECTIONS = 128  # a tab has at most six


def serve(folder: Path, port: int, opened: Callable[[str], None]) -> None:
    """Serve a folder until interrupted. opened: called with the link when the server is ready. port 0: any free one.

    Raises OSError if the folder does not exist or the port is in use.
    """
    listening = listening_on(port)
    server, link = server_of(folder, listening, prepared=True)
    opened(link)
    server.run(sockets=[listening])


def listening_on(port: int) -> socket.socket:
    """A socket of the loopback. Raises OSError if the port is in use."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
    except OSError as error:
        listening.close()
        raise OSError(error.errno, f"{error.strerror}; choose another with --port", f"port {port}") from error
    listening.listen()
    return listening


def server_of(folder: Path, listening: socket.socket, *, prepared: bool = False) -> tuple[uvicorn.Server, str]:
    """The server of a folder and the link that opens it. prepared: see `application`."""
    port, secrets = listening.getsockname()[1], Secrets()
    config = uvicorn.Config(
        application(folder, port, secrets, prepared=prepared),
        http=Impatient,
        ws="none",
        log_level="error",
        access_log=False,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=2,
        server_header=False,
        lifespan="on",
    )
    return uvicorn.Server(config), f"http://{LOOPBACK}:{port}{OPEN}?token={secrets.token}"
