"""What pixels say of a motion between two frames, as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats
from vnav.registration.compiled_geometry import MIN_Z_M, Point, exp, inverse, transform
from vnav.registration.refinement import CAUCHY_SIGMAS

Sample = tuple[float, float, float]  # a value, and its gradient by x and by y
SEEN_SIGMAS = 3.0  # of inverse depth: a point so near to the surface is a point of it
EXPOSURE_ROUNDS = 3
DEPTH_DELAY_SIGMA_S, LINE_DELAY_SIGMA_S = 0.02, 5e-5  # a frame's half; a Kinect's line delay


@compiled
def log_likelihoods(
    met: Array, brightness: Array, light: tuple[float, float], chance: Array, wrong: float
) -> Array:
    """Of pixels (N,) meeting what they met, over that of meeting any others by chance.

    ``met`` (N, 6) from `carried`; ``brightness`` (N,) of the pixels; ``light``: their `exposure`;
    ``chance`` (2,): standard deviation of what any two pixels differ by, in inverse depth and in
    brightness; ``wrong``: share of pixels that a right motion does not explain. NaN for pixels that
    met nothing.
    """
    told = np.full(len(met), np.nan)
    gain, offset = light
    for n in range(len(met)):
        if not np.isnan(met[n, 0]):
            told[n] = log_likelihood(met[n, 0], met[n, 2], met[n, 4], chance[0], wrong)
        if not np.isnan(met[n, 1]):
            off = met[n, 1] - gain * brightness[n] - offset
            told[n] += log_likelihood(off, met[n, 3], met[n, 5], chance[1], wrong)
    return told


@compiled
def carried(
    T_b_a: Array,
    a: Floats,
    b: Floats,
    cameras: Array,
    pixels: NDArray[np.int64],
    late: Array,
    sigmas: Array,
) -> Array:
    """What meets pixels (N, 2) of a where they fall in b: rows (N, 6).

    How much nearer the pixel's point is than b's surface, in inverse depth, and b's brightness;
    then the standard deviations of both by noise, and those by delays. NaN where there is nothing
    to compare: a point outside b, or hidden in it; the brightness also of one that is seen through.
    ``a`` and ``b`` (H, W, 2): inverse depth, 0 for none, and brightness; ``cameras`` (2, 10): fx,
    fy, cx, cy of a and of b, then the twist; ``late`` (N, 3): `lateness` of the pixels; ``sigmas``
    (5,) of a place in pixels, of inverse depth, of brightness, and of the delays of depth and of a
    row in seconds, which count where a camera moves.
    """
    met = np.full((len(pixels), 6), np.nan)
    here, there = cameras[0], cameras[1]
    is_moving = np.abs(cameras[:, 4:]).max() > 0
    for n in range(len(pixels)):
        u, v = pixels[n]
        w = np.float64(a[v, u, 0])
        if w <= 0:
            continue
        point = (u - here[2]) / here[0] / w, (v - here[3]) / here[1] / w, 1 / w
        px, py, z = transform(T_b_a, point)
        if z <= MIN_Z_M:
            continue
        x, y = there[0] * px / z + there[2], there[1] * py / z + there[3]
        if depths_around(b, x, y) < 4:
            continue
        depth, grey, scale = bilinear(b, 0, x, y), bilinear(b, 1, x, y), 1 / z / w
        noise = _spread(depth, grey, sigmas, scale)
        delays = 0.0, 0.0
        if is_moving and not np.isnan(late[n, 0]):
            own = late[n, 0], late[n, 1], late[n, 2]
            shift = _parallax(T_b_a, there, x, y, z * w)
            other = _late(depth, there, x, y, len(b))
            delays = _by_delays(depth, grey, own, other, shift, scale, sigmas)
        met[n, 2], met[n, 3], met[n, 4], met[n, 5] = noise[0], noise[1], delays[0], delays[1]
        nearer = 1 / z - depth[0]
        limit = SEEN_SIGMAS * np.sqrt(noise[0] ** 2 + delays[0] ** 2)
        if nearer >= -limit:
            met[n, 0] = nearer
        if abs(nearer) < limit:
            met[n, 1] = grey[0]
    return met


@compiled
def lateness(image: Floats, camera: Array, pixels: NDArray[np.int64]) -> Array:
    """What pixels (N, 2) of an image gain by a second's delay (N, 3): see `_late`.

    NaN where one lacks depth beside it. ``image`` and ``camera`` (10,) as `carried` takes them.
    """
    late = np.full((len(pixels), 3), np.nan)
    for n in range(len(pixels)):
        u, v = pixels[n]
        if depths_around(image, u, v) == 4:
            depth = bilinear(image, 0, u, v)
            late[n, 0], late[n, 1], late[n, 2] = _late(depth, camera, u, v, len(image))
    return late


@compiled
def put_alike(
    T_a_b: Array,
    meanwhile: Array,
    inverse_depth: Floats,
    camera: Array,
    pixels: NDArray[np.int64],
    limits: Array,
) -> float:
    """Share of a's pixels (N, 2) with depth that two motions put at one place in b, 1 without any.

    Points may be apart by ``limits`` (2,), in pixels and in inverse depth, and by what the camera
    moves ``meanwhile``, a tangent (6,). ``T_a_b`` (2, 4, 4): the motions.
    """
    seen, alike = 0, 0
    carrying = inverse(T_a_b[0]), inverse(T_a_b[1]), exp(meanwhile)
    for n in range(len(pixels)):
        u, v = pixels[n]
        if inverse_depth[v, u] <= 0:
            continue
        seen += 1
        z = 1 / np.float64(inverse_depth[v, u])
        point = (u - camera[2]) / camera[0] * z, (v - camera[3]) / camera[1] * z, z
        by_t, by_u = transform(carrying[0], point), transform(carrying[1], point)
        apart, farther = _apart(by_t, by_u, camera)
        passed, nearer = _apart(point, transform(carrying[2], point), camera)
        alike += apart < np.hypot(limits[0], passed) and farther < np.hypot(limits[1], nearer)
    return alike / seen if seen else 1.0


@compiled
def _apart(p: Point, q: Point, camera: Array) -> tuple[float, float]:
    """Pixels between two points, and their difference of inverse depth; NaN behind the camera."""
    if p[2] <= 0 or q[2] <= 0:
        return np.nan, np.nan
    across = camera[0] * (p[0] / p[2] - q[0] / q[2])
    down = camera[1] * (p[1] / p[2] - q[1] / q[2])
    return np.hypot(across, down), abs(1 / p[2] - 1 / q[2])


@compiled
def depths_around(image: Floats, x: float, y: float) -> int:
    """How many of the four pixels about a place have depth; -1 outside of the image."""
    height, width = image.shape[:2]
    if not (0 <= x < width - 1 and 0 <= y < height - 1):
        return -1
    u, v = int(x), int(y)
    above = int(image[v, u, 0] > 0) + int(image[v, u + 1, 0] > 0)
    return above + int(image[v + 1, u, 0] > 0) + int(image[v + 1, u + 1, 0] > 0)


@compiled
def bilinear(image: Floats, channel: int, x: float, y: float) -> Sample:
    """Value of a channel at a place inside of the image, and its gradient by x and by y."""
    u, v = int(x), int(y)
    i00, i01 = image[v, u, channel], image[v, u + 1, channel]
    i10, i11 = image[v + 1, u, channel], image[v + 1, u + 1, channel]
    top, low = i00 + (x - u) * (i01 - i00), i10 + (x - u) * (i11 - i10)
    across = (1 - (y - v)) * (i01 - i00) + (y - v) * (i11 - i10)
    return top + (y - v) * (low - top), across, low - top


@compiled
def _spread(depth: Sample, grey: Sample, sigmas: Array, scale: float) -> tuple[float, float]:
    """Standard deviations of both residuals: by noise, and by slope times noise of place."""
    place, of_depth, of_grey = sigmas[0], sigmas[1], sigmas[2]
    brought = of_depth * scale * scale  # noise of the inverse depth that a measured
    slope, edge = depth[1] ** 2 + depth[2] ** 2, grey[1] ** 2 + grey[2] ** 2
    measured = of_depth * of_depth + brought * brought
    return (
        np.sqrt(measured + place * place * slope),
        np.sqrt(2 * of_grey * of_grey + place * place * edge),
    )


@compiled
def _late(
    depth: Sample, camera: Array, x: float, y: float, height: int
) -> tuple[float, float, float]:
    """What a pixel gains by a second's delay: inverse depth if depth's, u and v if a row's.

    Optical flow by the camera's twist; a depth image that is late shows the surface beside, too.
    """
    rx, ry, w = (x - camera[2]) / camera[0], (y - camera[3]) / camera[1], depth[0]
    turn_x, turn_y, turn_z = camera[4], camera[5], camera[6]
    along = turn_y * rx - turn_x * ry - camera[9] * w
    u = (turn_z * ry - turn_y - camera[7] * w - rx * along) * camera[0]
    v = (turn_x - turn_z * rx - camera[8] * w - ry * along) * camera[1]
    rows = y - (height - 1) / 2
    return -w * along - depth[2] * u - depth[1] * v, u * rows, v * rows


@compiled
def _parallax(T_b_a: Array, camera: Array, x: float, y: float, scale: float) -> tuple[float, float]:
    """Pixels in b by which a's point is elsewhere for each 1/m of its inverse depth."""
    u = camera[0] * T_b_a[0, 3] - (x - camera[2]) * T_b_a[2, 3]
    v = camera[1] * T_b_a[1, 3] - (y - camera[3]) * T_b_a[2, 3]
    return u / scale, v / scale


@compiled
def _by_delays(
    depth: Sample,
    grey: Sample,
    own: tuple[float, float, float],
    other: tuple[float, float, float],
    shift: tuple[float, float],
    scale: float,
    sigmas: Array,
) -> tuple[float, float]:
    """Standard deviations of both residuals by unknown delays.

    To first order. A sensor has one delay: frames that move alike are displaced alike.
    """
    (of_depth, u, v), (of_depth_b, u_b, v_b) = own, other
    along_slope = depth[2] * shift[0] + depth[1] * shift[1]
    along_edge = grey[2] * shift[0] + grey[1] * shift[1]
    rows = (grey[2] * (u - u_b) + grey[1] * (v - v_b)) ** 2
    of_brightness = (sigmas[3] * along_edge * of_depth) ** 2 + sigmas[4] ** 2 * rows
    off = (scale * scale - along_slope) * of_depth - of_depth_b
    return sigmas[3] * abs(off), np.sqrt(of_brightness)


@compiled
def log_likelihood(off: float, noise: float, late: float, chance: float, wrong: float) -> float:
    """Of one residual over that of chance; no less than if it were wrong.

    ``late`` by unknown delays explains a residual, and makes none less likely that needs no
    explanation: frames have one delay, whose prior no pixel pays for (a profile likelihood).
    """
    variance = noise * noise + late * late
    squared = off * off * (1 / variance - 1 / (variance + chance * chance))
    ratio = np.sqrt(1 + (chance / noise) ** 2) * np.exp(-squared / 2)
    return float(np.log((1 - wrong) * ratio + wrong))


@compiled
def exposure(met: Array, brightness: Array, chance: float) -> tuple[float, float]:
    """Gain and offset from a's brightness to b's, by mean and deviation of what both have seen.

    A wrong motion leaves these as they are. Equal exposure where the images show no contrast.
    """
    gain, offset = 1.0, 0.0
    for k in range(EXPOSURE_ROUNDS):
        count, sums, squares = 0.0, np.zeros(2), np.zeros(2)
        for n in range(len(met)):
            if np.isnan(met[n, 1]):
                continue
            off = met[n, 1] - gain * brightness[n] - offset
            sigma = np.hypot(met[n, 3], met[n, 5]) if k else chance
            weight = 1 / (1 + (off / (CAUCHY_SIGMAS * sigma)) ** 2)
            count += weight
            for i, value in ((0, brightness[n]), (1, met[n, 1])):
                sums[i] += weight * value
                squares[i] += weight * value * value
        if count > 0:
            mean = sums / count
            of_a, of_b = np.maximum(squares / count - mean * mean, 1.0)
            gain = np.sqrt(of_b / of_a)
            offset = mean[1] - gain * mean[0]
    return gain, offset
