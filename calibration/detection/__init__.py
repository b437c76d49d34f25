"""Image → sub-pixel centres of dots with their uncertainty."""
