"""Recording from a camera: lossless or as compressed by the camera, with time stamps and the start of the motors."""
