"""The kinds of other users, how their parameters are drawn for an episode, and the protocol of a user's own kind."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice, check_int, check_within
from wavegym.systems.shared_spectrum.user_kernels import BURSTS, HOPPING, LISTENING, OFF, STATIC, STEPPED, STRIDES


class Kind(NamedTuple):
    """A kind of user, and the bounds of its parameters; docs/shared_band.md has what each kind models.

    Attributes:
        code: of the kernels.
        leave, come: bounds of the probabilities of a step; see ``user_kernels``.
        period: bounds of the steps of a pattern.
    """

    code: int
    leave: tuple[float, float] = (0.0, 0.0)
    come: tuple[float, float] = (0.0, 0.0)
    period: tuple[int, int] = (1, 1)


KINDS = {
    "static": Kind(STATIC),
    "bursts": Kind(BURSTS, leave=(0.05, 0.4), come=(0.05, 0.4)),
    "stepped": Kind(STEPPED),
    "hopping": Kind(HOPPING, period=(3, 24)),
    "listening": Kind(LISTENING, leave=(0.6, 1.0), come=(0.0, 0.2)),
}
DRAWS = 9  # of a user in ``World.kind``
MOST_DRAWS = 1000  # of a user's own kind in a step


@runtime_checkable
class BandUser(Protocol):
    """A kind of user of your own, in NumPy: an element of ``users`` beside the names of ``KINDS``.

    The world has all its random numbers before the first action, so the user's choices are paired between policies.

    Attributes:
        draws: uniform draws that it takes in a step.
    """

    draws: int

    def begin(self, uniform: Array, channels: int) -> Any:
        """Its state before the first step, arrays with axis 0 = environment, from draws (env, draws)."""

    def advance(self, state: Any, band: Array, uniform: Array) -> tuple[Any, Array]:
        """Its state one step later, and its noise (env, channel) in units of the receiver's own noise, 0 where silent.

        Args:
            state: as ``begin`` or the last ``advance`` returned it; it must not be changed.
            band: whether the radar's last band held each channel, (env, channel) bool.
            uniform: draws of the step, (env, draws).
        """


def check_users(users: tuple[Any, ...]) -> None:
    """Raise an InputError for an element that is neither one of ``KINDS`` nor a ``BandUser``."""
    for user in users:
        if isinstance(user, str):
            check_choice("kind of user", user, KINDS)
        elif isinstance(user, type) or not isinstance(user, BandUser):
            wanted = f"one of {', '.join(map(repr, KINDS))}, or an object with draws, begin and advance"
            raise InputError(f"user is {user!r}, expected {wanted}")
        else:
            name = f"draws of user {type(user).__name__}"
            check_within(name, check_int(name, user.draws, 0), 0, MOST_DRAWS)


def advanced(user: BandUser, state: Any, band: Array, uniform: Array) -> tuple[Any, Array]:
    """``user.advance``, with its result checked.

    Raises:
        InputError: not a state and noise, or noise of another shape than ``band`` or that is not finite and at least 0.
    """
    found, name = user.advance(state, band, uniform), type(user).__name__
    if not (isinstance(found, tuple) and len(found) == 2):
        raise InputError(f"user {name} returned a {type(found).__name__} from advance, expected (state, noise)")
    noise = np.asarray(found[1])
    if noise.shape != band.shape:
        raise InputError(f"noise of user {name} has shape {noise.shape}, expected {band.shape}: (env, channel)")
    if noise.dtype.kind not in "fiub":
        raise InputError(f"noise of user {name} is {noise.dtype}, expected real numbers")
    if not (is_valid := np.isfinite(noise) & (noise >= 0.0)).all():
        raise InputError(f"noise of user {name} is {noise[~is_valid][0]:g}, expected finite numbers >= 0")
    return found[0], noise


def drawn_users(
    names: tuple[str, ...], uniform: Array, channels: int, power_db: tuple[float, float], duty: tuple[float, float]
) -> tuple[Array, Array]:
    """Parameters (env, u, 7) and first places (env, u, 4) of users of these kinds from uniform draws (env, u, DRAWS).

    Powers are over the receiver's noise in a channel; widths are one or two channels.
    """
    kinds = [KINDS[name] for name in names]
    width = np.minimum(1 + (2 * uniform[..., 0]).astype(np.int64), channels)
    home = (uniform[..., 1] * (channels - width + 1)).astype(np.int64)
    power = 10.0 ** (0.1 * _between(*power_db, uniform[..., 2])) * _between(*duty, uniform[..., 3])
    bounds = np.array([(kind.leave, kind.come, kind.period) for kind in kinds]).reshape(-1, 3, 2)
    leave, come = (_between(bounds[:, i, 0], bounds[:, i, 1], uniform[..., 4 + i]) for i in range(2))
    low, high = bounds[:, 2].T.astype(np.int64)
    period = low + (uniform[..., 6] * (high - low + 1)).astype(np.int64)
    code = np.broadcast_to(np.array([kind.code for kind in kinds], np.int64), width.shape)
    pattern = np.floor(uniform[..., 7] * 2.0**53)
    stride = np.array(STRIDES)[(len(STRIDES) * uniform[..., 8]).astype(np.int64)]
    place = np.where(code == BURSTS, OFF, home)
    users = np.stack([code, width, power, leave, come, period, pattern], axis=-1).astype(np.float64)
    return users, np.stack([place, home, stride, np.zeros_like(home)], axis=-1)


def _between(low: float | Array, high: float | Array, uniform: Array) -> Array:
    return np.asarray(low + (np.asarray(high) - low) * uniform)
