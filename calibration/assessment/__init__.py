"""What a calibration is good for, and whether it still holds."""
