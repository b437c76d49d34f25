"""Long work: progress, cancel, one at a time, and going on after the studio was ended."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evaluator.studio.jobs import Job, _first_unfinished
from tests.evaluator.studio.serving import Serving, serving
from tests.evaluator.synthetic import three_runs
from tests.waiting import HANGS_S


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    three_runs(tmp_path / "circles")
    return tmp_path


def jobs(studio: Serving) -> list[dict[str, Any]]:
    """What the first event of the stream says."""
    import http.client

    connection = http.client.HTTPConnection("127.0.0.1", studio.port, timeout=HANGS_S)
    connection.request("GET", "/api/events", headers={"Cookie": studio.cookie})
    answer = connection.getresponse()
    line = answer.readline()
    connection.close()
    found: list[dict[str, Any]] = json.loads(line.removeprefix(b"data: "))
    return found


def wait_for(studio: Serving, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The newest job, once it is as wanted."""
    deadline = time.monotonic() + HANGS_S
    while time.monotonic() < deadline:
        found = jobs(studio)
        if found and wanted(found[0]):
            return found[0]
        time.sleep(0.2)
    raise AssertionError(jobs(studio))


def start(studio: Serving, kind: str) -> str:
    identifier = str(studio.get("/api/home")["experiments"][0]["id"])
    studio.post(f"/api/experiments/{identifier}/jobs", {"kind": kind})
    return identifier


def test_an_analysis_tells_its_runs_and_leaves_no_journal(studio: Serving, folder: Path) -> None:
    identifier = start(studio, "analyse")
    start(studio, "analyse")
    assert len(jobs(studio)) == 1  # the same work is not asked for twice
    assert (folder / ".turnscope-studio.json").is_file()
    done = wait_for(studio, lambda job: job["state"] in ("done", "failed"))
    assert (done["state"], done["share"]) == ("done", 1.0)
    assert sorted(done["outdated"]) == ["r01", "r02", "r03"]
    assert done["summary"]["faults"] == {}
    assert not (folder / ".turnscope-studio.json").exists()
    assert studio.get(f"/api/experiments/{identifier}/state")["outdated"] == {"r01": [], "r02": [], "r03": []}


def test_work_is_cancelled(studio: Serving) -> None:
    start(studio, "diagnose")
    number = wait_for(studio, lambda job: job["state"] == "running")["number"]
    studio.post(f"/api/jobs/{number}", {"how": "cancelled"})
    assert wait_for(studio, lambda job: job["state"] != "running")["state"] == "cancelled"


def test_what_cannot_be_done_is_a_sentence(studio: Serving, folder: Path) -> None:
    text = (folder / "circles" / "experiment.toml").read_text()
    (folder / "circles" / "experiment.toml").write_text(text.replace('robot = "barrel"', 'robot = "barel"'))
    identifier = str(studio.get("/api/home")["experiments"][0]["id"])
    studio.post(f"/api/experiments/{identifier}/jobs", {"kind": "analyse"})
    failed = wait_for(studio, lambda job: job["state"] in ("failed", "done"))
    assert "did you mean barrel?" in failed["sentence"]


def test_a_studio_that_starts_again_goes_on(folder: Path) -> None:
    with serving(folder) as first:
        start(first, "diagnose")
        wait_for(first, lambda job: job["state"] == "running")
    left = json.loads((folder / ".turnscope-studio.json").read_text())
    assert [order["kind"] for order in left["running"]] == ["diagnose"]
    with serving(folder) as second:
        found = wait_for(second, lambda job: job["state"] == "running")
        assert found["kind"] == "diagnose"
        second.post(f"/api/jobs/{found['number']}", {"how": "paused"})
        assert wait_for(second, lambda job: job["state"] != "running")["state"] == "paused"
        start(second, "diagnose")  # "Resume": what was paused is not offered once more
        assert [job["state"] for job in jobs(second) if job["state"] == "paused"] == []
        second.post(f"/api/jobs/{jobs(second)[0]['number']}", {"how": "cancelled"})
        wait_for(second, lambda job: job["state"] == "cancelled")
    assert not (folder / ".turnscope-studio.json").exists()


def test_a_journal_by_someone_else_starts_nothing(folder: Path) -> None:
    journal = {"running": [{"kind": "os.system", "target": "circles"}, {"kind": "analyse", "target": "/etc/passwd"}, 3]}
    (folder / ".turnscope-studio.json").write_text(json.dumps(journal))
    with serving(folder) as studio:
        assert jobs(studio) == []


def test_runs_being_analysed_are_the_first_unfinished_ones_one_on_each_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluator.studio.jobs.available_cores", lambda: 2)
    outdated = {"r1": ["tracking"], "r2": [], "r3": ["radius"], "r4": ["tracking"], "r5": ["tracking"]}
    job = Job(1, "analyse", "experiment.toml", outdated=outdated, finished=["r3"])
    assert _first_unfinished(job) == ["r1", "r4"]
