"""How far the centre strays from a planned path."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from omnimj.signals import Array


def distance_to_path(points: Array, path: Array) -> Array:
    """Distance of points to a polyline: min over segments ab of |p − a − t (b − a)|, t in [0, 1].

    Looks at the two segments beside the nearest corner, which is exact for a path sampled finely against
    its own curvature, as a `Reference` is (one sample per control period).

    Args:
      points: Shape (k, 2) [m].
      path: Corners of the polyline in order, shape (m, 2), m ≥ 1 [m]; repeated corners are allowed.

    Returns:
      Shape (k,) [m].
    """
    moved = np.any(np.diff(path, axis=0) != 0.0, axis=1)
    corners = path[np.concatenate([[True], moved])]
    nearest = cKDTree(corners).query(points)[1]
    last = len(corners) - 1
    before = _to_segment(points, corners[np.maximum(nearest - 1, 0)], corners[nearest])
    after = _to_segment(points, corners[nearest], corners[np.minimum(nearest + 1, last)])
    return np.minimum(before, after)


def _to_segment(p: Array, a: Array, b: Array) -> Array:
    """Distance of each p to its own segment ab; a segment of length 0 is its point."""
    ab, ap = b - a, p - a
    length2 = np.sum(ab * ab, axis=1)
    t = np.clip(np.sum(ap * ab, axis=1) / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
    return np.linalg.norm(ap - t[:, None] * ab, axis=1)
