"""Robot, slip law and effects → motion; scene → video with exact truth."""
