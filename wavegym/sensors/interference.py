"""What a train of linear chirps measures in coloured noise, such as a band that others use.

The noise has a power N(f), in units of the receiver's own noise, that is constant in each channel of the spectrum. The
chirp has a flat spectrum over its band. x is the frequency from the middle of the band, and <.> averages over the band.

A chirp of rate k sends the frequency x at the time x / k of its pulse, and the train has pulses at times t. Delay and
Doppler therefore enter as x and t + x / k. With (delay - Doppler / k) in place of the delay, the information has no
coupling: that of delay is 4 pi^2 X with X = <x^2>, and that of the Doppler shift 4 pi^2 D with D = <t^2>.

``matched``: the usual filter, matched to the pulse. It is not optimal in coloured noise. The SNR falls by <N>.
The variance of delay is the sandwich <x^2 N> / X^2 in place of 1 / X: noise at the edges of the band does more harm
than noise in the middle. That of the Doppler shift is <N> / D.

``whitening``: a filter for this noise, which the receiver must know. The SNR is multiplied by W = <1 / N>, the
information of delay is <x^2 / N> - <x / N>^2 / W, and that of the Doppler shift D W.

Noise differs from channel to channel and not within a train: a user that transmits in a share of the train enters with
its mean power.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, check_elements
from wavegym.core.errors import InputError, check_choice, check_int, check_positive

Receiver = Literal["matched", "whitening"]
"""Filters of a receiver in coloured noise."""
RECEIVERS = get_args(Receiver)


class Bands(NamedTuple):
    """Contiguous bands of a spectrum of equal channels, (band, channel) each; see ``contiguous_bands``."""

    first: Array  # (band,) its lowest channel
    width: Array  # (band,) channels
    share: Array  # of the energy in the channel, <1>
    moment: Array  # <x>, in band widths
    square: Array  # <x^2> over its value in white noise, so that its sum over the channels is 1


def contiguous_bands(channels: int, widest: int | None = None) -> Bands:
    """All bands of 1 to ``widest`` neighbouring channels, by lowest channel and width.

    Args:
        channels: of the spectrum, >= 1.
        widest: channels of the widest band; by default all.

    Raises:
        InputError: a number that is not an integer >= 1, or a band wider than the spectrum.
    """
    check_int("channels", channels, 1)
    most = channels if widest is None else check_int("widest", widest, 1)
    if most > channels:
        raise InputError(f"widest is {most} channels, expected at most those of the spectrum (nearest: {channels})")
    pairs = [(a, n) for a in range(channels) for n in range(1, min(most, channels - a) + 1)]
    first, width = np.array(pairs).T
    low = (np.arange(channels) - first[:, None]) / width[:, None] - 0.5
    low, high = np.clip(low, -0.5, 0.5), np.clip(low + 1.0 / width[:, None], -0.5, 0.5)
    share, moment, square = high - low, (high**2 - low**2) / 2.0, 4.0 * (high**3 - low**3)
    return Bands(first, width, share, moment, square)


def noise_factors(noise: ArrayLike, bands: Bands, receiver: Receiver = "matched") -> tuple[Array, Array]:
    """How noise in the channels changes the SNR of each band, and the variance of delay beside it.

    Args:
        noise: N of each channel in units of the receiver's own noise, >= 1 with that noise alone, (..., channel).
        bands: of ``contiguous_bands``.
        receiver: see the module.

    Returns:
        The factor on eta, and the factor on the variance of delay at that eta, both (..., band). The variance of the
        Doppler shift changes by the first alone.

    Raises:
        InputError: an invalid value or shape.
    """
    N = check_elements(check_positive, "noise", noise)
    check_choice("receiver", receiver, RECEIVERS)
    if N.ndim == 0 or N.shape[-1] != bands.share.shape[1]:
        raise InputError(f"noise has shape {N.shape}, expected {bands.share.shape[1]} channels in the last axis")
    if receiver == "matched":
        mean = N @ bands.share.T
        return 1.0 / mean, N @ bands.square.T / mean
    weight = 1.0 / N
    W = weight @ bands.share.T
    information = weight @ bands.square.T - 12.0 * (weight @ bands.moment.T) ** 2 / W
    return W, W / information
