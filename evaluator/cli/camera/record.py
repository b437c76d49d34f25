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
@click.option("-o", "--out", type=PATH, metavar="FILE.mp4", help="Recording to write. [default: write nothing]")
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), help="Duration. [default: until Ctrl-C]")
@click.option("--size", metavar="WxH", help="Frame size requested from the camera, e.g. 640x480.")
@click.option("--rate", type=click.FloatRange(min=0, min_open=True), help="Frame rate requested, 1/s.")
@click.option("--pixels", help="Pixel format requested, e.g. mjpeg or yuyv422.")
@click.option(
    "--start-light", type=(float, float), metavar="X Y", help="Start signal: a light at this pixel that switches on."
)
@click.option(
    "--exposure", type=float, metavar="S", help="Exposure time of a frame; reduces the uncertainty of --start-light."
)
@click.option("--start-line", is_flag=True, help="Start signal: a line on standard input.")
@click.option("--start-program", metavar="COMMAND", help="Run this program to start the motors.")
@click.option(
    "--start-serial",
    type=(str, str),
    metavar="PORT TEXT",
    help="Send this text over a serial port to start the motors.",
)
@click.option(
    "--rest", "rest_s", default=0.5, show_default=True, metavar="S", help="Recording time before the motors start."
)
@click.option("--settings", type=PATH, metavar="tracking.toml", help="Settings for finding the marks.")
@click.option(
    "--watch", "watch_image", type=PATH, metavar="FILE.jpg", help="Image with the marks found, renewed every second."
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
    """Record a camera with time stamps, and determine when the motors started.

    SOURCE is the number of a camera (0, 1, …), its device, an address (rtsp://…), or a video file that stands in for a
    camera. Compressed frames are stored as received, raw frames without loss. Time stamps are the camera's if it
    provides them. Dropped frames are counted. The marks that are visible are reported every second.
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
    """Start signal from the options; None without one."""
    from evaluator.capture import start
    from evaluator.errors import InputError

    if sum([light, line, command is not None, serial is not None]) > 1:
        raise InputError("give only one of --start-light, --start-line, --start-program and --start-serial")
    if line:
        return start.line_on(sys.stdin)
    if command is not None:
        return start.program(command)
    return None if serial is None else start.serial_command(*serial)


def _watcher(settings: Path | None, image: Path | None) -> Callable[[Frame], str]:
    """Function that finds the marks in a frame once a second."""
    from evaluator.capture.watch import watch_marks

    return watch_marks(settings, image)
