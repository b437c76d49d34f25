"""How close drawn discs are to brute force, over sizes, blurs, tilts and distortions.

Run: python -m tests.benchmarks.render_accuracy
"""

from __future__ import annotations

import numpy as np

from calibration.camera import camera_above
from tests.simulator.rendering.test_coverage import analytic, brute_force, centroid


def main() -> None:
    """Print the worst error of a pixel (share of full scale) and of the centroid (px) for each case."""
    print(f"{'radius px':>9} {'blur px':>8} {'tilt deg':>9} {'k1':>5} {'pixel':>9} {'centroid px':>12}")
    rng = np.random.default_rng(20)
    for radius_mm, blur_px, tilt_deg, k1 in [
        (0.3, 0.3, 0, 0.0),
        (0.3, 0.8, 20, -0.3),
        (0.5, 0.5, 40, -0.3),
        (0.5, 0.8, 0, 0.0),
        (0.5, 0.8, 40, -0.3),
        (1.0, 1.5, 20, 0.2),
        (2.0, 0.8, 40, -0.3),
        (1.0, 3.5, 10, -0.2),
    ]:
        camera = camera_above(
            size_px=(320, 240), focal_px=1500, distance_mm=150, tilt_deg=tilt_deg, tilt_azimuth_deg=30, k1=k1
        )
        size = 2 * int(np.ceil(radius_mm * 10.5 + 4.5 * blur_px + 2))
        pixel, shift = 0.0, 0.0
        for _ in range(4):
            center = tuple(rng.uniform(-3, 3, 2))
            ours, exact = (draw(camera, center, radius_mm, blur_px, size) for draw in (analytic, brute_force))
            pixel = max(pixel, float(np.abs(ours - exact).max()))
            shift = max(shift, float(np.abs(centroid(ours) - centroid(exact)).max()))
        print(f"{radius_mm * 10:9.1f} {blur_px:8.1f} {tilt_deg:9d} {k1:5.1f} {pixel:9.5f} {shift:12.6f}")


if __name__ == "__main__":
    main()
