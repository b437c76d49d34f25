"""The studio: a local web application for calibration, editing, inspection and diagnosis. It calls workflow only."""
