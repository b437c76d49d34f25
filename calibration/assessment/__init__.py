"""Assessment of a calibration: quality, verdict, and whether it still holds."""
