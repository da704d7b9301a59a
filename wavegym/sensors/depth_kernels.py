"""Kernels of depth maps: whether a point is nearer than the first wall in its direction.

A depth map of a site (shadow mapping, Williams 1978) has the squared distance to the first wall for each of ``bins``
directions. A direction is counted as (dy / (|dx| + |dy|) + 1) / 4 of a turn from south over east, and mirrored west:
it takes one division and no arc tangent, and a bin spans 4 to 8 / bins rad.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import inlined, kernel


@inlined
def bin_of(dx, dy, bins):
    """The bin of the direction (dx, dy); -1 where it has none."""
    turn = dy / (abs(dx) + abs(dy))
    if dx < 0.0:
        turn = 2.0 - turn
    place = 0.25 * bins * (turn + 1.0)
    if not 0.0 <= place <= bins:  # NaN at the site itself, and where a coordinate is not finite
        return -1
    return min(int(place), bins - 1)


@inlined
def is_clear(x, y, sites, depth):
    """Whether no wall stands between (x, y) and any of sites (s, 2); depth (s, bins), squared."""
    for s in range(len(depth)):
        dx, dy = x - sites[s, 0], y - sites[s, 1]
        b = bin_of(dx, dy, depth.shape[1])
        if b >= 0 and dx * dx + dy * dy >= depth[s, b]:
            return False
    return True


@kernel
def all_clear(points, sites, depth, out):
    """Fill out (n,): ``is_clear`` of points (n, 2)."""
    for n in range(len(points)):
        out[n] = is_clear(points[n, 0], points[n, 1], sites, depth)
