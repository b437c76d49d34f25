"""Errors raised for invalid input to this package."""


class CalibrationError(ValueError):
    """An image, gauge or camera file cannot be used; the message says what was found and what to do."""


class ImageError(CalibrationError):
    """One image of a set cannot be used; the others may suffice. image: its name. reason: the message without it."""

    def __init__(self, image: str, reason: str) -> None:
        """Join name and reason to the message."""
        super().__init__(f"{image}: {reason}")
        self.image, self.reason = image, reason
