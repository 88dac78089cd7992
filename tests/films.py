"""Videos that tests write, by a codec that loses nothing."""

from pathlib import Path

import cv2
import numpy as np


def film(path: Path, images: np.ndarray, rate_hz: float = 10.0) -> None:
    """A video of RGB images (N, H, W, 3) uint8, or of one channel (N, H, W) uint8 or uint16."""
    is_color, is_deep = images.ndim == 4, images.dtype == np.uint16
    kind = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(is_color)]
    kind += [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U if is_deep else cv2.CV_8U]
    codec, size = cv2.VideoWriter_fourcc(*"FFV1"), (images.shape[2], images.shape[1])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, codec, rate_hz, size, kind)
    for image in images:
        writer.write(np.ascontiguousarray(image[..., ::-1] if is_color else image))
    writer.release()
