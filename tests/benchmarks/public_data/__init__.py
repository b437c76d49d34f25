"""An exam of data that others published: what turnscope, OpenCV, and threshold with centroid make of it."""
