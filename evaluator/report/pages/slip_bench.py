"""A bench recording as forces, fitted law, figures and one page."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from evaluator.files import write_text, written_whole
from evaluator.report.figures.paper_slip import slip_figures
from evaluator.report.numbers import true_minus
from evaluator.report.pages.html import Page, Section, Table, page_html
from evaluator.report.style import plain_svg
from evaluator.workflow import SlipBench
from simulator.slip.bench import LATERAL_OK, SIGMAS, forces_from_torques
from simulator.slip.curves import slip_curves
from simulator.slip.fit import NAMES, SlipFit, slip_toml

HEAD = ("parameter", "value", "95 % from", "to")


def fit_rows(fit: SlipFit) -> list[tuple[str, ...]]:
    """Parameter, value and interval as text."""
    rows = zip(NAMES, fit.value, fit.low, fit.high, strict=True)
    return [
        (name.replace("_", " "), *(true_minus(f"{value:.4g}") for value in (best, low, high)))
        for name, best, low, high in rows
    ]


def fit_sentences(fit: SlipFit, forces: pd.DataFrame) -> tuple[str, ...]:
    """Notes on the fit."""
    wheel, disk = fit.torque_sigma_mN_mm
    source = "as the recording states" if fit.sigmas_given else "estimated from the residuals"
    sigmas = f"{wheel:.3g} mN·mm (wheel) and {disk:.3g} mN·mm (disk)"
    sentences = [f"{fit.measurements} torques fitted; standard uncertainty {sigmas}, {source}."]
    if fit.sigmas_given:
        widened = " The intervals are widened by this factor." if fit.misfit > 1 else ""
        sentences.append(f"RMS residual of the fit: {fit.misfit:.2f} standard uncertainties.{widened}")
    unknown = int((forces["lateral_status"] != LATERAL_OK).sum())
    if unknown:
        sentences.append(
            f"Lateral force unknown in {unknown} rows at slip angle 0, where it does not act on the disk's torque; "
            "their torques are still used in the fit."
        )
    return tuple(sentences)


def write_slip_bench(bench: SlipBench, out: Path) -> pd.DataFrame:
    """Write forces.csv, slip.toml, the two figures with their data and index.html; return the forces.

    The torques of a virtual bench are written too, as bench.csv.
    """
    name, table, fit, apparatus = bench.name, bench.torques, bench.fit, bench.apparatus
    if bench.virtual:
        with written_whole(out / "bench.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.9g")
    if not fit.sigmas_given:
        table = table.assign(**dict(zip(SIGMAS, fit.torque_sigma_mN_mm, strict=True)))
    forces = forces_from_torques(table, apparatus)
    curves = slip_curves(fit.slip, sorted(table["slip_angle_deg"].unique()), driving=True)
    caption = "Points: forces from the torques by Eq. (9), with two standard uncertainties; curves: the fitted law."
    figures = slip_figures("slip-", name, caption, curves, forces)
    with written_whole(out / "forces.csv") as temporary:
        forces.to_csv(temporary, index=False, float_format="%.6g")
    write_text(out / "slip.toml", slip_toml(fit))
    for figure in figures:
        write_text(out / f"{figure.name}.svg", plain_svg(figure.panels[0]))
    page = Page(
        kind="slip evaluation",
        title=name,
        facts=(f"wheel radius {apparatus.wheel_radius_mm:g} mm", f"contact radius {apparatus.contact_radius_mm:g} mm"),
        summary=fit_sentences(fit, forces),
        sections=(
            Section("curves", "Slip characteristics", figures=tuple(figures)),
            Section(
                "numbers", "Slip law", tables=(Table("The [slip] table is slip.toml.", HEAD, tuple(fit_rows(fit))),)
            ),
        ),
        footer="Made by turnscope.",
    )
    write_text(out / "index.html", page_html(page))
    return forces
