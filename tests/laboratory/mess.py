"""What an ordinary laboratory does to a session: one function a kind, its size drawn anew each time.

None of it is physics that a diagnosis should name. Sizes are those of the README beside this file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.laboratory.effects import LENS, plate_tilt
from tests.laboratory.reference import Array, Now, Sliding
from tests.laboratory.session import FRAME_S, Session

Mess = Callable[[Session, np.random.Generator], Session]
WAVES, TURN = 6, 2 * np.pi


def tidy(session: Session, rng: np.random.Generator) -> Session:
    """Nothing is untidy: white noise of 3 µm only."""
    del rng
    return session


def motors_lag(session: Session, rng: np.random.Generator) -> Session:
    """Both motors follow their commands with a first-order lag of 1 to 8 ms."""
    return replace(session, world=replace(session.world, lags_s=(*session.world.lags_s, rng.uniform(0.001, 0.008))))


def starts_off_together(session: Session, rng: np.random.Generator) -> Session:
    """All start times are off by one offset: camera and controller are started by hand and synchronised to a frame."""
    off = rng.uniform(-1, 1) * FRAME_S if rng.random() < 0.8 else rng.choice([-1, 1]) * rng.uniform(0.015, 0.02)
    return replace(session, late_s=session.late_s + off)


def starts_jitter(session: Session, rng: np.random.Generator) -> Session:
    """Each start time is off by half a frame, one sigma."""
    return replace(session, late_s=session.late_s + rng.normal(0, FRAME_S / 2, session.runs))


def friction_scatters(session: Session, rng: np.random.Generator) -> Session:
    """Friction differs from run to run by up to 10 %: dust, humidity, a wiped plate."""
    factors = tuple(rng.uniform(0.9, 1.1, session.runs))
    return replace(session, world=replace(session.world, friction_of_run=factors))


def plate_unevenly_clean(session: Session, rng: np.random.Generator) -> Session:
    """Friction varies over the plate by 1 to 2 % (RMS) in waves of 15 to 60 mm: wiped here, touched there."""
    size = rng.uniform(0.01, 0.02) * np.sqrt(2 / WAVES)
    length_mm, direction, phase = rng.uniform(15, 60, WAVES), rng.uniform(0, np.pi, WAVES), rng.uniform(0, TURN, WAVES)
    ahead = TURN / length_mm * np.array([np.cos(direction), np.sin(direction)])

    def waves(_now: Now, sliding: Sliding) -> Array:
        places = np.stack([sliding.x_mm, sliding.y_mm], axis=-1)
        return 1 + size * np.sum(np.cos(places @ ahead + phase), axis=-1)

    world = session.world
    return replace(session, world=replace(world, frictions=(*world.frictions, waves)))


def motor_gains_scatter(session: Session, rng: np.random.Generator) -> Session:
    """Each motor holds its speed to 0.1 %, one sigma, anew in every run."""
    return replace(session, gain=session.gain * (1 + rng.normal(0, 1e-3, session.gain.shape)))


def noise_has_heavy_tails(session: Session, rng: np.random.Generator) -> Session:
    """Tracking noise of 2 to 10 µm with the tails of Student's t, three degrees of freedom."""
    return replace(session, noise=replace(session.noise, white_mm=rng.uniform(0.002, 0.010), heavy_tailed=True))


def noise_wanders(session: Session, rng: np.random.Generator) -> Session:
    """Tracking errors of 2 to 6 µm that wander over 1 to 8 s: light, shadow, pixel phase."""
    slow = {"slow_mm": rng.uniform(0.002, 0.006), "slow_s": rng.uniform(1, 8)}
    return replace(session, noise=replace(session.noise, **slow))


def marks_are_lost(session: Session, rng: np.random.Generator) -> Session:
    """One mark is missing in 1 to 5 % of the frames, and both for 0.2 to 0.8 s in each run (a wire in the light)."""
    lost = {"lost_share": rng.uniform(0.01, 0.05), "gap_s": rng.uniform(0.2, 0.8)}
    return replace(session, noise=replace(session.noise, **lost))


def frames_are_dropped(session: Session, rng: np.random.Generator) -> Session:
    """The recorder drops 0.5 to 3 % of the frames; the times of the others stay right."""
    return replace(session, noise=replace(session.noise, dropped_share=rng.uniform(0.005, 0.03)))


def outliers(session: Session, rng: np.random.Generator) -> Session:
    """In 0.1 to 1 % of the frames one mark is 0.1 to 3 mm off: a reflection was taken for it."""
    return replace(session, noise=replace(session.noise, outlier_share=np.exp(rng.uniform(np.log(1e-3), np.log(1e-2)))))


def frame_rate_off(session: Session, rng: np.random.Generator) -> Session:
    """The recorder's clock is off by 1e-4, one sigma."""
    factor = session.view.time_factor * (1 + rng.normal(0, 1e-4))
    return replace(session, view=replace(session.view, time_factor=factor))


def robot_measured_with_callipers(session: Session, rng: np.random.Generator) -> Session:
    """Wheelbase, track and wheel radius are measured to 0.5 %, one sigma."""
    robot = session.world.robot
    names = ("wheelbase_mm", "track_mm", "wheel_radius_mm")
    return session.with_robot(**{name: getattr(robot, name) * (1 + rng.normal(0, 0.005)) for name in names})


def marks_glued_by_hand(session: Session, rng: np.random.Generator) -> Session:
    """Positions of the marks are measured to 0.05 mm, one sigma a coordinate."""
    robot = session.world.robot
    places = {
        name: tuple(float(v) for v in np.add(getattr(robot, name), rng.normal(0, 0.05, 2)))
        for name in ("green_mm", "yellow_mm")
    }
    return session.with_robot(**places)


def mass_weighed(session: Session, rng: np.random.Generator) -> Session:
    """The mass is off by 2 %, one sigma (a scale that reads 10 mg)."""
    return session.with_robot(mass_g=session.world.robot.mass_g * (1 + rng.normal(0, 0.02)))


def plane_scale_off(session: Session, rng: np.random.Generator) -> Session:
    """Lengths are off by 1e-3, one sigma: a printed gauge, the height of the marks."""
    return replace(session, view=replace(session.view, scale=session.view.scale * (1 + rng.normal(0, 1e-3))))


def plate_levelled_by_eye(session: Session, rng: np.random.Generator) -> Session:
    """The plate is off level by 0.2 to 0.3 degrees, what a bubble shows."""
    return replace(session, world=plate_tilt(session.world, rng.uniform(0.2, 0.3), rng.uniform(0, 360)))


def slip_within_tolerance(session: Session, rng: np.random.Generator) -> Session:
    """Friction, shapes and stiffnesses of the slip law differ within the stated tolerances (cut at two sigmas)."""
    robot = session.world.robot
    sigmas = {"friction_x": 0.05, "friction_y": 0.05, "stiffness_x": 0.1, "stiffness_y": 0.1, "friction_decrease": 0.1}
    return session.with_robot(**{k: getattr(robot, k) * (1 + s * _cut_normal(rng)) for k, s in sigmas.items()})


def magnets_within_tolerance(session: Session, rng: np.random.Generator) -> Session:
    """Attractions differ within the stated 10 %, one sigma, cut at two."""
    robot = session.world.robot
    names = ("driving_attraction_mN", "driven_attraction_mN")
    return session.with_robot(**{k: getattr(robot, k) * (1 + 0.1 * _cut_normal(rng)) for k in names})


def recordings_begin_late(session: Session, rng: np.random.Generator) -> Session:
    """A third of the recordings begin 0 to 0.5 s after the motors: somebody was slow at the button."""
    late = rng.random(session.runs) < 1 / 3
    return replace(
        session, begin_s=np.where(late, session.start_s + rng.uniform(0, 0.5, session.runs), session.begin_s)
    )


def recordings_end_early(session: Session, rng: np.random.Generator) -> Session:
    """A third of the recordings end after 40 to 80 % of their runs: the robot left the image."""
    share = np.where(rng.random(session.runs) < 1 / 3, rng.uniform(0.4, 0.8, session.runs), 1.0)
    ends = session.start_s + share * (session.end_s - session.start_s)
    return replace(session, end_s=ends, stop_s=np.where(session.stop_s < ends, session.stop_s, np.nan))


def clock_rounds(session: Session, rng: np.random.Generator) -> Session:
    """Times in the files are rounded to 1 ms, as many recorders do."""
    del rng
    return replace(session, noise=replace(session.noise, round_s=1e-3))


def starts_in_a_corner(session: Session, rng: np.random.Generator) -> Session:
    """All runs start in one corner of the plate, headings within 60 degrees of each other."""
    corner = rng.choice([-30, 30], 2)[:, None] + rng.uniform(-10, 10, (2, session.runs))
    heading = rng.uniform(0, 2 * np.pi) + rng.uniform(-1, 1, session.runs) * np.pi / 6
    return replace(session, pose=np.vstack([corner, heading]))


def lens_leaves_errors(session: Session, rng: np.random.Generator) -> Session:
    """The calibration leaves errors of place of 2 to 8 µm (RMS over the plate) that grow toward its edges."""
    form = rng.normal(size=(2, len(LENS)))
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 2)).reshape(2, -1)
    rms = np.sqrt(np.mean(np.sum((form @ np.stack([grid[0] ** i * grid[1] ** j for i, j in LENS])) ** 2, axis=0)))
    return replace(session, view=replace(session.view, lens_mm=form * rng.uniform(0.002, 0.008) / rms))


def stand_shakes(session: Session, rng: np.random.Generator) -> Session:
    """Camera and plate shake against each other by 2 to 8 µm at 4 to 25 Hz: a fan, a pump, a lift."""
    shakes = {"shake_mm": rng.uniform(0.002, 0.008), "shake_hz": rng.uniform(4, 25)}
    return replace(session, noise=replace(session.noise, **shakes))


def camera_settles(session: Session, rng: np.random.Generator) -> Session:
    """Camera and plate drift against each other by 3 to 12 µm over 2 to 20 s: a warming stand, a tripod, warm air."""
    drift = {"drift_mm": rng.uniform(0.003, 0.012), "drift_s": np.exp(rng.uniform(np.log(2), np.log(20)))}
    return replace(session, noise=replace(session.noise, **drift))


def everything(session: Session, rng: np.random.Generator) -> Session:
    """All of the above at once, places apart."""
    for kind in ALL_AT_ONCE:
        session = kind(session, rng)
    return session


def few_short_runs(session: Session, rng: np.random.Generator) -> Session:
    """Eight runs of 2.5 to 4 s: an afternoon was all there was, and all is as untidy as ever."""
    kept = np.sort(rng.permutation(session.runs)[:8])
    fields = {
        name: getattr(session, name)[..., kept]
        for name in ("said_rpm", "start_s", "pose", "rpm", "gain", "late_s", "begin_s", "phase_s")
    }
    ends = fields["start_s"] + rng.uniform(2.5, 4.0, 8)
    return everything(replace(session, **fields, end_s=ends, stop_s=np.full(8, np.nan)), rng)


def _cut_normal(rng: np.random.Generator) -> float:
    """A standard normal number within ± 2."""
    while True:
        value = float(rng.normal())
        if abs(value) <= 2:
            return value


ALL_AT_ONCE: tuple[Mess, ...] = (
    motors_lag,
    starts_off_together,
    starts_jitter,
    friction_scatters,
    motor_gains_scatter,
    noise_has_heavy_tails,
    noise_wanders,
    marks_are_lost,
    frames_are_dropped,
    outliers,
    frame_rate_off,
    robot_measured_with_callipers,
    marks_glued_by_hand,
    mass_weighed,
    plane_scale_off,
    plate_levelled_by_eye,
    slip_within_tolerance,
    magnets_within_tolerance,
    recordings_begin_late,
    recordings_end_early,
    clock_rounds,
    lens_leaves_errors,
    stand_shakes,
    camera_settles,
    plate_unevenly_clean,
)
KINDS: dict[str, Mess] = {
    kind.__name__.replace("_", "-"): kind
    for kind in (tidy, everything, *ALL_AT_ONCE, starts_in_a_corner, few_short_runs)
}
NAMESAKES = {  # effects that say the same as what was untidy: naming them is a lie with a grain of truth
    "motors-lag": {"command-lag"},
    "starts-off-together": {"command-lag"},
    "motor-gains-scatter": {"drive-speed-mismatch", "drive-speed-scale"},
    "frame-rate-off": {"time-base"},
    "robot-measured-with-callipers": {"drive-speed-scale"},
    "marks-glued-by-hand": {"mark-offset"},
    "plane-scale-off": {"plane-scale"},
    "plate-levelled-by-eye": {"plate-tilt"},
    "slip-within-tolerance": {"friction-level"},
    "magnets-within-tolerance": {"magnet-strength"},
}
NAMESAKES["everything"] = set().union(*NAMESAKES.values())
