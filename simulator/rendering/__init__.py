"""Scene, optics and sensor → video with exact truth."""
