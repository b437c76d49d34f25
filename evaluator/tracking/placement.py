"""From image points to the plane of the marks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from calibration.camera import Camera
from evaluator.errors import InputError
from evaluator.recording import Frame


class AsCalibrated:
    """Frames of a recording, checked to have the size of the images with which the camera was calibrated."""

    def __init__(self, recording: Iterable[Frame], camera: Camera) -> None:
        """Store the arguments; iteration raises InputError at a frame of another size."""
        self._recording, self._camera = recording, camera
        self.name = str(getattr(recording, "name", "the recording"))
        self.expected_frames = int(getattr(recording, "expected_frames", 0))

    def __iter__(self) -> Iterator[Frame]:
        """Pass the frames on."""
        for frame in self._recording:
            if frame.size_px != self._camera.size_px:
                raise InputError(f"{self.name}: {of_another_size(frame.size_px, self._camera.size_px)}")
            yield frame


def of_another_size(frame_px: tuple[int, int], camera_px: tuple[int, int]) -> str:
    """Message for frames of another size, with what to do."""
    found = f"frames of {frame_px[0]}×{frame_px[1]} px, but the camera was calibrated with images of "
    found += f"{camera_px[0]}×{camera_px[1]} px"
    if frame_px == camera_px[::-1]:
        return (
            f"{found}; a program turned one of them by 90 degrees (orientation tags are ignored, those of"
            " images and of videos): use the files as the camera wrote them"
        )
    return f"{found}; calibrate in the camera mode of the recording"


def place_on_plate(table: pd.DataFrame, camera: Camera, height_mm: float) -> pd.DataFrame:
    """Place tracked marks on the plane height_mm above the plate.

    table: of `track`. Returns time_s and NAME_x_mm, NAME_y_mm first, then frame, NAME_x_sigma_mm, NAME_y_sigma_mm,
    NAME_xy_cov_mm2 (the frame's random error only; the camera's own uncertainty is common to all frames and comes
    from `Camera.plate_sensitivity`), NAME_status, and all columns in px. Absent marks stay NaN.
    """
    names = [column.removesuffix("_x_px") for column in map(str, table) if column.endswith("_x_px")]
    placed: dict[str, object] = {"time_s": table["time_s"]}
    more: dict[str, object] = {"frame": table["frame"]}
    for name in names:
        points = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float)
        seen = np.isfinite(points).all(axis=1)
        plate, covariance = np.full_like(points, np.nan), np.full((len(points), 2, 2), np.nan)
        plate[seen] = camera.plate_from_image(points[seen], height_mm)
        jacobian = camera.plate_jacobian(points[seen], height_mm)
        sigma = table.loc[seen, [f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy(float)
        both = table.loc[seen, f"{name}_xy_cov_px2"].to_numpy(float)
        own = np.stack([sigma[:, 0] ** 2, both, both, sigma[:, 1] ** 2], axis=-1).reshape(-1, 2, 2)
        covariance[seen] = jacobian @ own @ jacobian.transpose(0, 2, 1)
        placed[f"{name}_x_mm"], placed[f"{name}_y_mm"] = plate[:, 0], plate[:, 1]
        more[f"{name}_x_sigma_mm"], more[f"{name}_y_sigma_mm"] = np.sqrt(covariance[:, [0, 1], [0, 1]]).T
        more[f"{name}_xy_cov_mm2"] = covariance[:, 0, 1]
        more[f"{name}_status"] = table[f"{name}_status"]
    pixels: dict[str, object] = {
        column: table[column] for column in map(str, table) if column.endswith(("_px", "_px2"))
    }
    return pd.DataFrame({**placed, **more, **pixels})
