"""What a front end shows of files and results: as plain values, ready for JSON, computed when asked for."""
