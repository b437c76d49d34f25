"""The slip evaluation apparatus: Eq. (9), its uncertainty, and the law recovered from a virtual bench."""

from __future__ import annotations

import tomllib

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.errors import SimulationError
from simulator.nominal_robot import Slip
from simulator.robot import load_robot
from simulator.slip.bench import (
    COLUMNS,
    LATERAL_OK,
    PAPER_APPARATUS,
    SIGMAS,
    Apparatus,
    bench_slips,
    checked_bench,
    forces_from_torques,
    torques,
    virtual_bench,
)
from simulator.slip.curves import law_parameters, normalized_forces
from simulator.slip.fit import NAMES, fit_slip_law, slip_toml


def bench(seed: int = 0, robot: str = "barrel") -> pd.DataFrame:
    return virtual_bench(load_robot(robot).slip, np.random.default_rng(seed))


@given(st.floats(1.0, 90.0), st.floats(-250.0, 250.0), st.floats(1.0, 30.0))
@settings(max_examples=50, deadline=None)
def test_forces_from_the_torques_of_a_law_are_the_law(angle_deg: float, wheel_rpm: float, disk_rpm: float) -> None:
    parameters = law_parameters(load_robot("column").slip)
    row = {"slip_angle_deg": [angle_deg], "wheel_rpm": [wheel_rpm], "disk_rpm": [disk_rpm], "normal_force_mN": [500.0]}
    table = pd.DataFrame(row)
    table["wheel_torque_mN_mm"], table["disk_torque_mN_mm"] = torques(parameters, table)
    along, across = normalized_forces(parameters, *bench_slips(table))
    forces = forces_from_torques(table)
    np.testing.assert_allclose(forces["longitudinal"], along, atol=1e-12)
    np.testing.assert_allclose(forces["lateral"], across, rtol=1e-9, atol=1e-9)


def test_a_driven_disk_pays_for_the_friction_that_the_wheel_resists_it_with() -> None:
    parameters = law_parameters(load_robot("tire").slip)
    table = pd.DataFrame(
        {
            "slip_angle_deg": [0.0, 90.0],
            "wheel_rpm": [20.0, 0.0],
            "disk_rpm": [10.0, 10.0],
            "normal_force_mN": [1e3] * 2,
        }
    )
    wheel, disk = torques(parameters, table)
    assert (disk > 0).all()  # the wheel is slower than the disk, or stands across it: the disk's motor works
    assert wheel[0] < 0  # and the wheel's motor brakes


def test_apparatus_is_that_of_section_3_and_its_disk_is_matched_to_a_wheel_of_100_rpm() -> None:
    assert (PAPER_APPARATUS.wheel_radius_mm, PAPER_APPARATUS.contact_radius_mm) == (4.0, 38.0)
    assert bench()["disk_rpm"].to_numpy() == pytest.approx(100 * 4 / 38)


def test_slip_ratio_is_zero_at_100_rpm_on_the_matched_disk() -> None:
    table = bench()
    ratio, _ = bench_slips(table)
    straight = table["slip_angle_deg"] == 0
    at = ratio[straight & (table["wheel_rpm"] == 100.0)]
    np.testing.assert_allclose(at, 0.0, atol=1e-12)
    assert ratio[straight].min() == pytest.approx(-80 / 180)
    assert ratio[straight].max() == pytest.approx(0.8)


def test_lateral_force_at_slip_angle_zero_is_unknown_with_a_reason_and_known_elsewhere() -> None:
    forces = forces_from_torques(bench())
    straight = forces["slip_angle_deg"] == 0
    assert forces.loc[straight, "lateral"].isna().all()
    assert np.isinf(forces.loc[straight, "lateral_sigma"]).all()
    assert forces.loc[straight, "lateral_status"].str.contains("slip angle 0").all()
    assert (forces.loc[~straight, "lateral_status"] == LATERAL_OK).all()
    assert np.isfinite(forces.loc[~straight, ["lateral", "lateral_sigma", "longitudinal"]]).all(axis=None)


def test_uncertainty_of_forces_is_that_of_both_torques_propagated() -> None:
    """Forces are linear in the torques: a change of one standard deviation of each meter is its whole part."""
    table = bench()
    here = forces_from_torques(table)
    known = (here["lateral_status"] == LATERAL_OK).to_numpy()
    names = ["longitudinal_force_mN", "lateral_force_mN"]
    meters = [("wheel_torque_mN_mm", 10.0), ("disk_torque_mN_mm", 40.0)]
    parts = [
        (forces_from_torques(table.assign(**{meter: table[meter] + sigma}))[names] - here[names]).to_numpy()[known]
        for meter, sigma in meters
    ]
    along, across = np.sum(np.square(parts), axis=0).T
    found = here[known]
    np.testing.assert_allclose(found["longitudinal_force_sigma_mN"], np.sqrt(along), rtol=1e-9)
    np.testing.assert_allclose(found["lateral_force_sigma_mN"], np.sqrt(across), rtol=1e-9)
    both = sum(part[:, 0] * part[:, 1] for part in parts)
    np.testing.assert_allclose(found["force_covariance_mN2"], both, atol=1e-9 * np.abs(both).max())
    for name in ("longitudinal", "lateral"):  # of the force over the normal force too
        np.testing.assert_allclose(found[f"{name}_sigma"], found[f"{name}_force_sigma_mN"] / 2000.0)


def test_meters_of_a_virtual_bench_scatter_as_they_state() -> None:
    exact = virtual_bench(
        load_robot("barrel").slip,
        np.random.default_rng(0),
        wheel_torque_sigma_mN_mm=1e-9,
        disk_torque_sigma_mN_mm=1e-9,
    )
    many = [bench(seed) for seed in range(10)]
    for meter, sigma in (("wheel_torque", 10.0), ("disk_torque", 40.0)):
        scatter = np.std([table[f"{meter}_mN_mm"] - exact[f"{meter}_mN_mm"] for table in many])
        assert scatter == pytest.approx(sigma, rel=0.08)  # of 1360 readings: four standard errors
        assert (many[0][f"{meter}_sigma_mN_mm"] == sigma).all()


EXAM = pytest.mark.exam


@pytest.mark.parametrize("robot", ["barrel", pytest.param("column", marks=EXAM), pytest.param("tire", marks=EXAM)])
def test_fitted_law_lies_in_its_intervals_as_often_as_they_say(robot: str) -> None:
    truth = law_parameters(load_robot(robot).slip)
    inside = []
    for seed in range(10):
        table = bench(seed, robot)
        fit = fit_slip_law(table if seed % 2 else table.drop(columns=list(SIGMAS)))
        inside.append((fit.low <= truth) & (truth <= fit.high))
    assert np.mean(inside) > 0.84  # of 70, correlated within a fit; 95 % wanted, 84 % is 3 sigma of ten fits below


def test_law_without_noise_is_recovered_exactly() -> None:
    slip = load_robot("barrel").slip
    table = virtual_bench(slip, np.random.default_rng(0), wheel_torque_sigma_mN_mm=1e-6, disk_torque_sigma_mN_mm=1e-6)
    np.testing.assert_allclose(fit_slip_law(table).value, law_parameters(slip), rtol=1e-5)


def test_uncertainty_that_the_recording_leaves_out_is_found_in_the_residuals() -> None:
    fit = fit_slip_law(bench(3).drop(columns=list(SIGMAS)))
    assert not fit.sigmas_given
    assert fit.torque_sigma_mN_mm == pytest.approx((10.0, 40.0), rel=0.2)


def test_a_law_that_does_not_explain_the_torques_gets_wider_intervals_and_a_misfit_that_says_so() -> None:
    table = bench(1)
    understated = table.assign(**{name: table[name] / 5 for name in SIGMAS})
    honest, widened = fit_slip_law(table), fit_slip_law(understated)
    assert widened.misfit == pytest.approx(5 * honest.misfit, rel=0.05)
    assert (widened.high - widened.low) == pytest.approx(honest.high - honest.low, rel=0.2)


def test_a_parameter_that_the_recording_says_nothing_of_has_an_interval_without_end() -> None:
    table = bench().query("slip_angle_deg == 90 or (slip_angle_deg == 0 and wheel_rpm == 100)")
    fit = fit_slip_law(table)
    unknown = [name.startswith("longitudinal") for name in NAMES]
    assert np.isinf(fit.high[unknown]).all()
    assert (fit.low[unknown] == 0).all()


def test_meters_that_measured_nothing_give_a_wheel_that_hardly_grips() -> None:
    fit = fit_slip_law(bench().assign(disk_torque_mN_mm=0.0, wheel_torque_mN_mm=0.0))
    along, across = normalized_forces(fit.value, 0.5, 0.5)
    assert max(along, across) < 1e-3


def test_torques_in_other_units_are_suspected() -> None:
    table = bench()
    with pytest.raises(SimulationError, match="are torques in mN·mm"):
        fit_slip_law(table.assign(wheel_torque_mN_mm=1e3 * table["wheel_torque_mN_mm"]))


def test_written_slip_table_is_the_fitted_law() -> None:
    fit = fit_slip_law(bench())
    found = tomllib.loads(slip_toml(fit))
    slip = Slip.model_validate(found["slip"])
    np.testing.assert_allclose(law_parameters(slip), fit.value, rtol=5e-4)
    assert set(found["tolerance"]) == {f"slip.{name}" for name in NAMES}


def test_another_apparatus_is_measured_with_its_own_radii() -> None:
    slip, apparatus = load_robot("column").slip, Apparatus(wheel_radius_mm=0.5, contact_radius_mm=10.0)
    table = virtual_bench(
        slip,
        np.random.default_rng(0),
        normal_force_mN=25.0,
        wheel_torque_sigma_mN_mm=1e-7,
        disk_torque_sigma_mN_mm=1e-7,
        apparatus=apparatus,
    )
    np.testing.assert_allclose(fit_slip_law(table, apparatus).value, law_parameters(slip), rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda table: table.drop(columns="disk_rpm"), "lacks disk_rpm"),
        (lambda table: table.drop(columns=SIGMAS[1]), "of both torques or of neither"),
        (lambda table: table.assign(wheel_rpm="fast"), "line 2, wheel_rpm = fast is not a finite number"),
        (lambda table: table.assign(normal_force_mN=-1.0), "is not a positive number"),
        (lambda table: table.iloc[:0], "holds no measurement"),
    ],
)
def test_a_bad_recording_is_named_in_one_sentence(change: object, words: str) -> None:
    assert callable(change)
    with pytest.raises(SimulationError, match=r"^[^\n]+$") as caught:
        checked_bench(change(bench()), "bench.csv")
    assert words in str(caught.value)


def test_a_recording_that_cannot_determine_a_law_is_refused() -> None:
    for angle_deg in (0.0, 2.8, 87.2, 90.0):  # a twentieth of the slip at least is along, and across
        with pytest.raises(SimulationError, match="one direction"):
            fit_slip_law(bench().assign(slip_angle_deg=angle_deg))
    with pytest.raises(SimulationError, match="cannot determine"):
        fit_slip_law(bench().iloc[[0, 70, 130]])


def test_all_columns_of_a_virtual_bench_pass_the_check() -> None:
    table = bench()
    assert list(table.columns) == [*COLUMNS, *SIGMAS]
    pd.testing.assert_frame_equal(checked_bench(table), table)
