"""Files and results as plain values for a front end, ready for JSON."""
