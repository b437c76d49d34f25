"""A thousand recordings on a Dask cluster whose workers are killed.

python -m tests.benchmarks.cluster --recordings 1000 [--seconds 2] [--every 60] [--seed 1]

Four workers on this machine analyse copies of short recordings (the first seconds of the shipped samples) up to the
report. Every minute one worker, drawn at random, is killed by SIGKILL, and another is started. Afterwards every
result of every copy is compared, byte for byte, with that of a plain batch of the recordings themselves, without a
cluster and undisturbed. Prints also the largest memory of a worker in each quarter of the batch, which would grow if a
worker kept something, and what the report of all runs takes to open in Chromium. Exits with 1 where a result is missing
or differs.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pandas as pd

from evaluator.workflow import calibrate
from evaluator.workflow.samples import copy_samples
from tests.benchmarks.batch import ROOT, command, experiment_of
from tests.evaluator.browser import BROWSER, pages
from tests.evaluator.tracking.synthetic import write_video

RATE, WORKERS = 60, 4
# Dask's profiler keeps what it saw in each second: 0.3 MB a recording, for some hours. Results do not need it.
LEAN = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}


def shortened(samples: Path, seconds: float) -> None:
    """Cut the recordings of the samples to their first seconds, encoded again."""
    for path in sorted(samples.glob("*.mp4")):
        with av.open(str(path)) as container:
            frames = [
                frame.to_ndarray(format="rgb24") for frame in islice(container.decode(video=0), int(seconds * RATE))
            ]
        write_video(path, frames, codec="libx264", pixels="yuv420p", rate=Fraction(RATE))


def memory_mb(process: int) -> float:
    """Largest resident memory of a process so far; 0 if it is gone."""
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    found = re.search(r"VmHWM:\s+(\d+)", status)
    return int(found[1]) / 1024 if found else 0.0


def on_cluster(experiment: Path, out: Path, rng: np.random.Generator, every_s: float) -> dict[str, object]:
    """Make the report on four workers, one of which is killed every so many seconds."""
    from distributed import LocalCluster

    peaks: list[tuple[float, float]] = []
    kills = 0
    with LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50) as cluster:
        # Without nannies: on a busy machine a nanny gives up a worker that takes long to start.
        worker = (sys.executable, "-m", "dask", "worker", cluster.scheduler_address, "--nthreads", "1", "--no-nanny")
        start = partial(
            subprocess.Popen, (*worker, "--no-dashboard"), cwd=ROOT, stderr=subprocess.DEVNULL, env=os.environ | LEAN
        )
        workers = [start() for _ in range(WORKERS)]
        while len(cluster.scheduler.workers) < WORKERS:
            time.sleep(0.5)
        began = time.monotonic()
        ends = began + every_s
        line = command("report", experiment, "-o", out, "--dask", cluster.scheduler_address)
        with subprocess.Popen(line, cwd=ROOT) as report:
            while report.poll() is None:
                time.sleep(0.5)
                peaks.append((time.monotonic() - began, max(memory_mb(one.pid) for one in workers)))
                if time.monotonic() > ends:
                    number = int(rng.integers(WORKERS))
                    workers[number].send_signal(signal.SIGKILL)
                    workers[number].wait()
                    workers[number] = start()
                    ends, kills = ends + every_s, kills + 1
        for one in workers:
            one.kill()
            one.wait()
    lasted = time.monotonic() - began
    quarters = [max((peak for at, peak in peaks if k <= 4 * at / lasted <= k + 1), default=0.0) for k in range(4)]
    return {"status": report.returncode, "seconds": lasted, "kills": kills, "quarters": quarters}


def differences(experiment: Path, out: Path, plain: Path) -> list[str]:
    """Runs whose row of the table or whose poses differ from those of the recording that they copy."""
    names = re.findall(r'^id = "(\w+)"', experiment.read_text(encoding="utf-8"), re.MULTILINE)
    found, expected = (pd.read_csv(folder / "turning.csv", dtype=str).set_index("run") for folder in (out, plain))
    wrong = [name for name in names if name not in found.index]
    for number, name in enumerate(names):
        source = expected.index[number % len(expected)]
        same = name in found.index and found.loc[name].equals(expected.loc[source])
        ours, theirs = out / "poses" / f"{name}.csv", plain / "poses" / f"{source}.csv"
        if not same or not ours.is_file() or ours.read_bytes() != theirs.read_bytes():
            wrong.append(name)
    return wrong


def opened(page: Path) -> str:
    """What it takes to open a page: first paint and end of loading, s."""
    if BROWSER is None:
        return "not opened: no Chromium on this machine"
    with pages() as open_page:
        times = []
        for _ in range(3):
            with open_page(page.as_uri()) as shown:
                shown.wait_for_load_state("load")
                times.append(
                    shown.evaluate(
                        "() => [performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN, "
                        "performance.getEntriesByType('navigation')[0].loadEventEnd]"
                    )
                )
    paint, loaded = np.median(np.array(times, dtype=float), axis=0) / 1000
    return f"first paint {paint:.2f} s, loaded {loaded:.2f} s (medians of 3)"


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=2.0, help="length of a recording")
    parser.add_argument("--every", type=float, default=60.0, help="seconds from one kill to the next")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = copy_samples(folder / "samples").parent
        calibrate(sorted(samples.glob("gauge-*.png")), samples / "gauge.toml").save(samples / "camera.json")
        shortened(samples, given.seconds)
        originals = len(list(samples.glob("*.mp4")))
        plain = experiment_of(samples, folder / "plain", originals)
        subprocess.run(command("report", plain, "-o", folder / "plain-out", "--workers", 1), cwd=ROOT, check=True)
        many = experiment_of(samples, folder / "many", given.recordings)
        seen = on_cluster(many, folder / "out", np.random.default_rng(given.seed), given.every)
        wrong = differences(many, folder / "out", folder / "plain-out")
        page = folder / "out" / "report.html"
        quarters = ", ".join(f"{peak:.0f}" for peak in seen["quarters"])  # type: ignore[attr-defined]
        print(
            f"{given.recordings} recordings of {given.seconds:g} s, 4 workers: {seen['seconds']:.0f} s, "
            f"{seen['kills']} killed, exit status {seen['status']}; {len(wrong)} results differ {wrong[:5]}\n"
            f"largest worker in each quarter: {quarters} MB\n"
            f"report of {page.stat().st_size / 1e6:.1f} MB: {opened(page)}",
            flush=True,
        )
    raise SystemExit(bool(wrong) or seen["status"] != 0)


if __name__ == "__main__":
    main()
