"""What other pages, other programs and strange files may try with the studio: none of it succeeds."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.evaluator.studio.serving import Serving, serving
from tests.waiting import HANGS_S

EXPERIMENT = """format = 1
name = "<script>alert(1)</script>"
robot = "barrel"
camera = "camera.json"

[[run]]
id = "r01"
left_rpm = 33.3
right_rpm = 14.4
video = "r01.mp4"
"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    outside = tmp_path_factory.mktemp("outside")
    (outside / "experiment.toml").write_text(EXPERIMENT.replace("<script>alert(1)</script>", "secret"))
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "experiment.toml").write_text(EXPERIMENT)
    (folder / "link.toml").symlink_to(outside / "experiment.toml")
    (folder / "linked").symlink_to(outside)
    with serving(folder) as found:
        yield found


def test_the_link_gives_a_cookie_that_no_script_and_no_other_site_gets(studio: Serving) -> None:
    status, headers, _ = studio.ask("GET", studio.link.removeprefix(studio.origin), own=False)
    assert status == 303
    assert headers["location"] == "/"
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=strict" in headers["set-cookie"]
    assert studio.ask("GET", "/")[0] == 200


@pytest.mark.parametrize("path", ["/", "/api/home", "/static/js/app.js", "/api/events", "/nothing"])
def test_nothing_is_given_without_the_cookie(studio: Serving, path: str) -> None:
    status, _, body = studio.ask("GET", path, own=False)
    assert (status, b"link" in body) == (401, True)
    assert studio.ask("GET", path, cookie=studio.cookie.split("=")[0] + "=guess")[0] == 401


@pytest.mark.parametrize("token", ["", "?token=", "?token=guess", "?token=%00%FF"])
def test_a_wrong_token_opens_nothing(studio: Serving, token: str) -> None:
    status, headers, _ = studio.ask("GET", f"/open{token}", own=False)
    assert status == 401
    assert "set-cookie" not in headers


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "", "0.0.0.0:{port}"]
)
def test_dns_rebinding_is_refused_on_every_route(studio: Serving, host: str) -> None:
    for path in ("/", "/api/home", "/static/base.css", studio.link.removeprefix(studio.origin)):
        assert studio.ask("GET", path, host=host.format(port=studio.port))[0] in (400, 403)


@pytest.mark.parametrize(
    "origin", ["", "null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:1"]
)
def test_posts_of_other_pages_are_refused(studio: Serving, origin: str) -> None:
    status, _, body = studio.ask("POST", "/api/samples", "{}", origin=origin.format(port=studio.port))
    assert status == 403
    assert b"Another page" in body


def test_reads_by_other_pages_are_refused(studio: Serving) -> None:
    assert studio.ask("GET", "/api/home", origin="http://evil.example")[0] == 403
    assert studio.ask("GET", "/static/js/app.js", sec_fetch_site="cross-site")[0] == 403
    assert studio.ask("GET", "/api/home", sec_fetch_site="same-site")[0] == 403  # another port of this machine
    assert studio.ask("OPTIONS", "/api/home", origin="http://evil.example")[0] == 403


def test_every_answer_forbids_foreign_script_and_frames(studio: Serving) -> None:
    answers = [studio.ask("GET", "/"), studio.ask("GET", "/", own=False), studio.ask("GET", "/nothing")]
    for _, headers, _ in answers:
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "script-src 'self'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py", "/static//etc/passwd",
        "/static/js/..%2f..%2f..%2fcli/group.py", "/api/experiments/..%2f..%2fetc/state", "/../../etc/passwd",
    ],
)  # fmt: skip
def test_traversal_reaches_nothing(studio: Serving, path: str) -> None:
    status, _, body = studio.ask("GET", path)
    assert status in (400, 404)
    assert b"root:" not in body
    assert b"import" not in body


def test_links_that_lead_out_of_the_folder_are_no_files_of_it(studio: Serving) -> None:
    names = [one["path"] for one in studio.get("/api/home")["experiments"]]
    assert names == ["experiment.toml"]


@pytest.mark.parametrize("name", ["../out", "a/b", "..", ".hidden", "/abs", "a\\b", "x\ny"])
def test_an_experiment_is_not_made_elsewhere(studio: Serving, name: str) -> None:
    status, sentence = studio.refused("/api/experiments", {"name": name, "robot": "barrel"})
    assert status == 400
    assert "give the experiment a name" in sentence


def test_an_experiment_is_not_made_behind_a_link(studio: Serving) -> None:
    status, sentence = studio.refused("/api/experiments", {"name": "linked", "robot": "barrel"})
    assert status == 400
    assert "outside the folder" in sentence


@pytest.mark.parametrize("robot", ["../../etc/passwd", "/etc/passwd"])
def test_a_robot_to_start_from_is_a_shipped_one(studio: Serving, robot: str) -> None:
    status, sentence = studio.refused("/api/experiments", {"name": "new", "robot": robot})
    assert status == 400
    assert "no such robot" in sentence


def test_script_in_a_name_travels_as_json_only(studio: Serving) -> None:
    status, headers, body = studio.ask("GET", "/api/home")
    assert status == 200
    assert headers["content-type"] == "application/json"
    assert json.loads(body)["experiments"][0]["name"] == "<script>alert(1)</script>"


def test_scripts_build_pages_from_text_only() -> None:
    import evaluator.studio

    scripts = Path(evaluator.studio.__file__).parent / "static" / "js"
    text = "".join(path.read_text() for path in scripts.rglob("*.js"))
    for way_in in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
        assert way_in not in text
    page = (scripts.parent / "index.html").read_text()
    assert "http" not in page.replace("http-equiv", "")  # nothing from elsewhere


@pytest.mark.parametrize("length", ["4000001", "99999999999999999999", "-1", "one"])
def test_oversized_requests_are_refused_before_they_are_read(studio: Serving, length: str) -> None:
    status, _, _ = studio.ask("POST", "/api/samples", content_length=length)  # and before they are sent
    assert status in (400, 413)


def test_a_body_that_grows_is_cut(studio: Serving) -> None:
    with socket.create_connection(("127.0.0.1", studio.port), timeout=HANGS_S) as wire:
        wire.sendall(_head(studio, "Transfer-Encoding: chunked"))
        chunk = b"100000\r\n" + b" " * 0x100000 + b"\r\n"
        try:
            for _ in range(6):
                wire.sendall(chunk)
        except OSError:
            pass  # it no longer listens
        assert b"413" in wire.recv(1000).split(b"\r\n")[0]


def test_deep_json_is_refused(studio: Serving) -> None:
    status, _, _ = studio.ask("POST", "/api/samples", "[" * 100_000)
    assert status == 400


def test_slow_bodies_and_slow_headers_are_ended(studio: Serving, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluator.studio.security.BODY_S", 0.4)
    monkeypatch.setattr("evaluator.studio.protocol.HEADERS_S", 0.4)
    with socket.create_connection(("127.0.0.1", studio.port), timeout=HANGS_S) as wire:
        wire.sendall(_head(studio, "Content-Length: 10") + b"{")
        assert b"408" in wire.recv(1000).split(b"\r\n")[0]
    for beginning in (b"", b"GET / HTTP/1.1\r\nHost: "):
        with socket.create_connection(("127.0.0.1", studio.port), timeout=HANGS_S) as wire:
            wire.sendall(beginning)
            assert wire.recv(1000) == b""
    assert studio.get("/api/home")["folder"]  # and it answers others meanwhile


def test_it_listens_on_the_loopback_only(studio: Serving) -> None:
    from evaluator.studio.server import listening_on

    with listening_on(0) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
    assert studio.link.startswith("http://127.0.0.1:")


def _head(studio: Serving, *more: str) -> bytes:
    lines = ["POST /api/samples HTTP/1.1", f"Host: 127.0.0.1:{studio.port}", f"Origin: {studio.origin}"]
    return "\r\n".join([*lines, f"Cookie: {studio.cookie}", *more, "", ""]).encode()
