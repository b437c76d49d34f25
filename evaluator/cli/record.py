"""turnscope record: a camera at the bench."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, json_option, quiet_option

if TYPE_CHECKING:
    from collections.abc import Callable

    from evaluator.capture.start import Signal
    from evaluator.recording import Frame


@click.command(
    epilog="""\b
Examples:
  turnscope record 0 --size 640x480 --rate 60 --seconds 10 -o r01.mp4
  turnscope record 0 --seconds 10 --start-light 600 30 -o r01.mp4
  turnscope record 0 --seconds 10 --start-serial /dev/ttyUSB0 'L33.3 R14.4\\n' -o r01.mp4
  turnscope record 0 --watch marks.jpg"""
)
@click.argument("source")
@click.option("-o", "--out", type=PATH, metavar="FILE.mp4", help="The recording; without it nothing is written.")
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), help="How long. [default: until Ctrl-C]")
@click.option("--size", metavar="WxH", help="Asked of the camera, as 640x480.")
@click.option("--rate", type=click.FloatRange(min=0, min_open=True), help="Frames a second, asked of the camera.")
@click.option("--pixels", help="Pixel format asked of the camera, as mjpeg or yuyv422.")
@click.option(
    "--start-light", type=(float, float), metavar="X Y", help="px of a light in view that goes on at the start."
)
@click.option("--exposure", type=float, metavar="S", help="Exposure of a frame: narrows the start by a light.")
@click.option("--start-line", is_flag=True, help="A line on standard input says that the motors were started.")
@click.option("--start-program", metavar="COMMAND", help="Run this program to start the motors.")
@click.option(
    "--start-serial", type=(str, str), metavar="PORT TEXT", help="Send this text over a serial port to start."
)
@click.option("--rest", "rest_s", default=0.5, show_default=True, metavar="S", help="Recorded before the motors start.")
@click.option("--settings", type=PATH, metavar="tracking.toml", help="How the marks are found that are watched for.")
@click.option(
    "--watch", "watch_image", type=PATH, metavar="FILE.jpg", help="Image, new every second, with the marks found."
)
@json_option
@quiet_option
def record(
    source: str,
    out: Path | None,
    seconds: float | None,
    size: str | None,
    rate: float | None,
    pixels: str | None,
    start_light: tuple[float, float] | None,
    exposure: float | None,
    start_line: bool,
    start_program: str | None,
    start_serial: tuple[str, str] | None,
    rest_s: float,
    settings: Path | None,
    watch_image: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Record from a camera, with true times, and know when the motors started.

    SOURCE is the number of a camera (0, 1, …), its device, an address (rtsp://…), or a file as if it were a camera.
    What the camera compresses is stored as it came, anything else without loss. Times are the camera's own where it
    gives them; dropped frames are counted. Once a second it is said whether the marks are seen.
    """
    from evaluator.capture.light import LightRegion
    from evaluator.capture.record import CaptureStart, record_camera
    from evaluator.cli.progress import progress_bar

    start = CaptureStart(
        light=None if start_light is None else LightRegion(*start_light),
        exposure_s=exposure,
        signal=_signal(start_light is not None, start_line, start_program, start_serial),
        rest_s=rest_s,
    )
    with progress_bar(f"{source}", quiet=quiet) as progress:
        found = record_camera(
            source,
            out,
            seconds=seconds,
            size=size,
            rate=rate,
            pixels=pixels,
            start=start,
            watch=_watcher(settings, watch_image),
            progress=progress,
        )
    if as_json:
        import json
        from dataclasses import asdict

        from evaluator.files import plain

        click.echo(json.dumps(plain(asdict(found)), indent=1))
    elif not quiet:
        for sentence in found.sentences():
            click.echo(sentence)
        if out is not None:
            click.echo(f"\n{out}")


def _signal(light: bool, line: bool, command: str | None, serial: tuple[str, str] | None) -> Signal | None:
    """The one way in which the start is told."""
    from evaluator.capture import start
    from evaluator.errors import InputError

    if sum([light, line, command is not None, serial is not None]) > 1:
        raise InputError("give one of --start-light, --start-line, --start-program and --start-serial, not several")
    if line:
        return start.line_on(sys.stdin)
    if command is not None:
        return start.program(command)
    return None if serial is None else start.serial_command(*serial)


def _watcher(settings: Path | None, image: Path | None) -> Callable[[Frame], str]:
    """What looks at a frame once a second."""
    from evaluator.capture.watch import watch_marks

    return watch_marks(settings, image)
