"""Fit a circle to the path of a tracked point; the tracker may have followed another object in some frames.

The algebraic fit is linear, but noise makes its radius too small: by 22 % on an arc of +-0.2 rad with errors of 0.3 %
of the radius. The algebraic fit only selects the points near the circle. The final circle has the least squared
distances from these points, which is the maximum likelihood estimate and has no such bias.

Sources: Kasa (1976), IEEE Trans. Instrum. Meas. 25, 8-14: least squares of x^2 + y^2 - 2 cx x - 2 cy y - k with the
centre (cx, cy). Rousseeuw (1984), J. Am. Stat. Assoc. 79, 871-880: the circle through three of the points with the
least median of distances, then least squares for the points near this circle.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags


@dataclass(frozen=True, slots=True)
class CircleSettings:
    """Settings for fitting a circle to tracked points."""

    triples: int = 100
    """Number of circles through three random points. If a third of the points are wrong, about 30 of the circles pass
    only through correct points."""
    near: float = 6.0
    """Maximum distance from the circle at which a point counts as on the circle, in median distances. It is about 4
    standard deviations."""
    circles: int = 400
    """Number of circles through three random marks (one, if the centre is known), if only one of the two marks of
    each frame is on the circle. An eighth of the circles through three marks pass only through marks on the circle."""
    fits: int = 20
    """Maximum number of least-squares fits. Each fit uses the points near the previous circle."""
    rounding: float = 1e-9
    """Distance from the circle, relative to its radius, up to which a point counts as on the circle regardless of
    `near`."""
    short_arc: float = 0.05
    """Standard error of the radius, relative to the radius, above which an arc is too short for its centre. The median
    error of the centre of simulated arcs is 0.9 to 1.1 times this standard error."""


SETTINGS = CircleSettings()


def most_of_a_circle(points: Array) -> tuple[Array, Flags] | None:
    """Fit a circle to most of the points, robustly to outliers.

    Return the centre (2,) and the mask (n,) of the points on the circle, or None if the points lie on a line.

    The candidates for the first circle are the fit to all points and the circles through three random points. The
    candidate with the smallest median distance of all points is chosen.

    Args:
        points: (n, 2) finite coordinates in the order of the frames
    """
    if len(points) < 3:
        return None
    rng = np.random.default_rng(0)
    triples = (points[rng.choice(len(points), 3, replace=False)] for _ in range(SETTINGS.triples))
    centres = [centre for chosen in (points, *triples) if (centre := _centre(chosen)) is not None]
    if not centres:
        return None
    centre = min(centres, key=lambda candidate: float(np.median(_distances(points, candidate)[0])))
    near = np.zeros(len(points), dtype=bool)
    for _ in range(SETTINGS.fits):
        (distances, radius), before = _distances(points, centre), near
        near = distances <= max(SETTINGS.near * float(np.median(distances)), SETTINGS.rounding * radius)
        refitted = _centre(points[near])
        if refitted is None or np.array_equal(near, before):
            break
        centre = refitted
    return _nearest(points[near], centre), near


def circle_of_one(marks: Array, centre: Array | None) -> tuple[Array, float] | None:
    """Fit a circle that passes through one of two marks in each frame.

    The mark on the circle may change from frame to frame. Among the circles through random marks, the one with the
    smallest median distance of the nearer mark is chosen.

    Return the centre (2,) and the radius, or None if the marks lie on a line.

    Args:
        marks: (2, n, 2) finite coordinates of both marks
        centre: (2,) centre of the circle; None if it is unknown
    """
    rng = np.random.default_rng(0)
    either = marks.reshape(-1, 2)

    def circle(points: Array) -> tuple[Array, float] | None:
        middle = _centre(points) if centre is None else centre
        return None if middle is None else (middle, float(np.median(np.hypot(*(points - middle).T))))

    def off(circle: tuple[Array, float]) -> Array:
        return np.abs(np.hypot(*(marks - circle[0]).transpose(2, 0, 1)) - circle[1])

    size = 3 if centre is None else 1
    drawn = (circle(either[rng.choice(len(either), size, replace=False)]) for _ in range(SETTINGS.circles))
    circles = [candidate for candidate in drawn if candidate is not None]
    if not circles:
        return None
    best = min(circles, key=lambda candidate: float(np.median(off(candidate).min(axis=0))))
    for _ in range(SETTINGS.fits):
        mark = off(best).argmin(axis=0)
        points = np.take_along_axis(marks, mark[None, :, None], axis=0)[0]
        fitted = most_of_a_circle(points) if centre is None else (centre, None)
        if fitted is None:
            break
        best = fitted[0], float(np.median(np.hypot(*(points - fitted[0]).T)))
        if np.array_equal(off(best).argmin(axis=0), mark):
            break
    return best


def _nearest(points: Array, centre: Array) -> Array:
    """Return the centre (2,) of the circle with the least squared distances from the points.

    The search starts from a given centre.
    """
    from scipy.optimize import least_squares

    if len(points) < 3:
        return centre

    def off(circle: Array) -> Array:
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    radius = float(np.hypot(*(points - centre).T).mean())
    fitted = least_squares(off, [*centre, radius], x_scale=radius, method="lm")
    return np.asarray(fitted.x[:2], dtype=np.float64) if fitted.success else centre


def radius_error(points: Array, centre: Array) -> float:
    """Return the standard error of the radius of the fitted circle, relative to the radius.

    The errors of the points are assumed to be independent. The result is infinite if the points do not determine the
    circle.
    """
    away = points - centre
    distances = np.hypot(*away.T)
    radius, free = float(distances.mean()), len(points) - 3
    slopes = np.column_stack([away / distances[:, None], np.ones(len(points))])
    _, sizes, directions = np.linalg.svd(slopes, full_matrices=False)
    if free < 1 or not sizes[-1] > 0:
        return np.inf
    variance = float(((distances - radius) ** 2).sum()) / free
    return float(np.sqrt(variance * ((directions[:, 2] / sizes) ** 2).sum())) / radius


def _distances(points: Array, centre: Array) -> tuple[Array, float]:
    """Return the distances (n,) of points from a circle, and the radius of the circle.

    The radius is the median distance of the points from the given centre.
    """
    radii = np.hypot(*(points - centre).T)
    return np.abs(radii - np.median(radii)), float(np.median(radii))


def _centre(points: Array) -> Array | None:
    """Return the centre (2,) of the least-squares circle, or None for points on a line."""
    if len(points) < 3:
        return None
    centred = points - points.mean(axis=0)
    A = np.column_stack([2 * centred, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(A, (centred**2).sum(axis=1), rcond=1e-9)
    return np.asarray(solution[:2] + points.mean(axis=0)) if rank == 3 else None
