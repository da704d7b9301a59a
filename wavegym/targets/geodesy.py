"""WGS-84: geodetic coordinates to earth-centred coordinates and a local tangent plane (east, north, up).

The tangent plane is an exact rotation and shift of earth-centred coordinates: distances in it are true slant ranges.
Because of the earth's curvature a target far from the origin has a low or negative "up", as a radar at the origin sees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray

SEMI_MAJOR = 6378137.0  # m, WGS-84 (NIMA TR8350.2, table 3.1)
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)


def geodetic_to_ecef(latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike) -> FloatArray:
    """Earth-centred, earth-fixed points [m], (..., 3), of latitude, longitude [deg] and ellipsoidal height [m]."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    h = np.asarray(altitude, np.float64)
    normal = SEMI_MAJOR / np.sqrt(1 - ECCENTRICITY_2 * np.sin(phi) ** 2)
    rho = (normal + h) * np.cos(phi)
    return np.stack([rho * np.cos(lam), rho * np.sin(lam), (normal * (1 - ECCENTRICITY_2) + h) * np.sin(phi)], axis=-1)


def ecef_to_enu(ecef: ArrayLike, latitude: float, longitude: float, altitude: float = 0.0) -> FloatArray:
    """East, north and up [m], (..., 3), of earth-centred points [m] about an origin in degrees and metres."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
    axes = np.stack([east, np.cross(up, east), up])  # (axis, 3)
    away = np.asarray(ecef, np.float64) - geodetic_to_ecef(latitude, longitude, altitude)
    return np.sum(away[..., None, :] * axes, axis=-1)


def mean_direction(latitude: ArrayLike, longitude: ArrayLike) -> tuple[float, float]:
    """Latitude and longitude [deg] of the mean surface normal; valid across the 180° meridian and at the poles."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    x, y, z = (float(np.mean(c)) for c in (np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)))
    return float(np.degrees(np.arctan2(z, np.hypot(x, y)))), float(np.degrees(np.arctan2(y, x)))
