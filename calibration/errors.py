"""The one error a user of this package can cause."""


class CalibrationError(ValueError):
    """A picture, gauge or camera file cannot be used; the message says what was found and what to do."""
