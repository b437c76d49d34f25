"""Frames → sub-pixel centres of marks with their uncertainty."""

from evaluator.tracking.before_start import motion_at_rest
from evaluator.tracking.corrections import correct, read_corrections
from evaluator.tracking.following.jumps import astray_note
from evaluator.tracking.following.repeated_frames import repeated_note
from evaluator.tracking.placement import AsCalibrated, of_another_size, place_on_plate
from evaluator.tracking.plate_shift import WithPlate
from evaluator.tracking.rolling_shutter import of_common_readouts
from evaluator.tracking.settings import TrackingSettings, load_settings
from evaluator.tracking.track import track

__all__ = [
    "AsCalibrated",
    "TrackingSettings",
    "WithPlate",
    "astray_note",
    "correct",
    "load_settings",
    "motion_at_rest",
    "of_another_size",
    "of_common_readouts",
    "place_on_plate",
    "read_corrections",
    "repeated_note",
    "track",
]
