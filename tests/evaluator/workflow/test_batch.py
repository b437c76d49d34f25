from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.workflow import analyze
from evaluator.workflow.execution import cluster
from evaluator.workflow.execution.answers import answers_of
from tests.evaluator.synthetic import circling_marks, write_experiment
from tests.evaluator.workflow.small_jobs import slow_write, square, square_unless_three
from tests.waiting import HANGS_S


def answered(work: Callable[[int], int], count: int) -> dict[int, int]:
    with answers_of(work, range(count), workers=2, when_killed=lambda _: -1) as answers:
        return dict(answers)


def test_every_job_is_answered_once_under_its_number() -> None:
    assert answered(square, 7) == {number: number**2 for number in range(7)}


def test_a_killed_worker_costs_only_its_own_job() -> None:
    assert answered(square_unless_three, 6) == {0: 0, 1: 1, 2: 4, 3: -1, 4: 16, 5: 25}


def test_leaving_interrupts_running_jobs_and_leaves_whole_files_only(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.txt" for number in range(3)]
    began = time.monotonic()

    def cancel_once_two_run() -> None:
        if len(list(tmp_path.glob("*.began"))) == 2:
            raise Cancelled
        assert time.monotonic() - began < HANGS_S

    with (
        pytest.raises(Cancelled),
        answers_of(slow_write, paths, workers=2, when_killed=lambda _: -1, waiting=cancel_once_two_run) as answers,
    ):
        list(answers)
    assert time.monotonic() - began < HANGS_S
    assert {path.suffix for path in tmp_path.iterdir()} == {".began"}


PARENT = """
import time
from evaluator.workflow.execution.answers import answers_of

with answers_of(time.sleep, [600] * 4, workers=2, when_killed=print) as answers:
    list(answers)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py"], env=environment, start_new_session=True)
    wait_until(lambda: len(members(parent.pid)) >= 5)  # with resource tracker, fork server and two workers
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    wait_until(lambda: not members(parent.pid))


def members(session: int) -> set[int]:
    """Processes of a session."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                found.add(int(entry.name))
    return found


def wait_until(condition: Callable[[], bool], seconds: float = HANGS_S) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.filterwarnings("ignore")  # a killed worker leaves its sockets to the interpreter
@pytest.mark.exam
def test_nothing_is_lost_when_a_dask_worker_is_killed_half_way(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    runs = [(f"r{k}", 14.4, 33.3, circling_marks(5.0 + k, seconds=2, seed=k)) for k in range(8)]
    experiment = write_experiment(tmp_path, runs)
    here = analyze(experiment, tmp_path / "here", workers=1)
    killed: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as two:
        victim = next(iter(two.workers.values())).pid

        def kill(stage: str, done: float, total: float = 1.0, /) -> None:
            assert stage == "runs"
            assert total == 8
            if done == 1 and not killed:
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)

        there = analyze(experiment, tmp_path / "there", dask=two.scheduler_address, progress=kill)
    assert killed
    assert there.faults == {}
    assert there.outputs.turning.read_bytes() == here.outputs.turning.read_bytes()
    for run in ("r0", "r7"):
        assert there.outputs.poses(run).read_bytes() == here.outputs.poses(run).read_bytes()


class DoneAtOnce:
    """A Dask future whose job is done."""

    def __init__(self, key: int, answer: object) -> None:
        self.key, self.answer, self.is_kept = key, answer, True

    def add_done_callback(self, call: Callable[[object], None]) -> None:
        call(self)

    def result(self) -> object:
        return self.answer

    def release(self) -> None:
        self.is_kept = False


def test_no_worker_keeps_a_received_answer_which_would_be_computed_again_if_it_died(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    futures: list[DoneAtOnce] = []

    class Client:
        cancelled: tuple[object, ...] = ()

        def submit(self, work: Callable[[int], int], job: int, **_: object) -> DoneAtOnce:
            futures.append(DoneAtOnce(len(futures), work(job)))
            return futures[-1]

        def cancel(self, left: list[object]) -> None:
            self.cancelled = tuple(left)

    client = Client()
    monkeypatch.setattr(cluster, "_client", lambda _address: contextlib.nullcontext(client))
    answers = cluster.on_cluster(abs, [-3, -2, -1], address="", when_killed=abs, waiting=lambda: None)
    assert [next(answers), next(answers)] == [(0, 3), (1, 2)]
    assert [future.is_kept for future in futures] == [False, False, True]
    answers.close()
    assert client.cancelled == (futures[2],)


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    monkeypatch.setattr(cluster, "DASK_TIMEOUT_S", 0.2)
    experiment = write_experiment(tmp_path, [("r0", 14.4, 33.3, circling_marks(5.0, seconds=1))])
    with pytest.raises(InputError, match="no Dask scheduler responds"):
        analyze(experiment, tmp_path / "out", dask="tcp://127.0.0.1:1")
