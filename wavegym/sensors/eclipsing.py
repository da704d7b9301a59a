"""Eclipsing: the receiver is closed while the radar transmits, and cuts pulses that arrive during that time.

The receive gate is *fixed in time*. The Fisher information of delay and Doppler is that of the samples in the gate: J =
2E/N0 Re of the gated inner products of the derivatives of s(t - tau) exp(j 2 pi nu t), minus their projection on the
gated pulse (unknown amplitude and phase). It is not the information of a pulse that ends at the gate. Such a pulse
would have a sharp edge that moves with the target, and infinite information on delay. ``docs/waveform_timing.md`` has
the derivation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray, check_broadcast, check_elements, for_kernel
from wavegym.core.errors import InputError, check_choice, check_non_negative, check_positive
from wavegym.sensors import eclipsing_kernels as kernels
from wavegym.waveforms import FisherFactors, PulseTiming, PulseTrain, Waveform, transmitted_interval
from wavegym.waveforms.cumulated import CumulatedMoments, cumulated_moments, scales

REPLICAS = ("visible", "full")


class EclipseTables(NamedTuple):
    """Tables of cumulated moments of several shapes of pulses, as kernels take them (``CumulatedMoments``)."""

    nodes: FloatArray  # (table, cell + 1)
    left: FloatArray  # (table, cell, column, power)
    right: FloatArray  # (table, cell, column, power)
    total: FloatArray  # (table, column)
    constants: FloatArray  # (table, 3): centre, slope, greatest density


NO_TABLES = EclipseTables(
    np.zeros((1, 2)), np.zeros((1, 1, 8, 6)), np.zeros((1, 1, 8, 6)), np.zeros((1, 8)), np.zeros((1, 3))
)
"""For kernels whose pulses are never cut."""
NEVER_CUT = np.array([[-1.0, math.inf, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, math.inf, 1.0]])
"""A row of ``EclipsedLibrary.windows`` for a receiver that is always open."""


class EclipsePulses(NamedTuple):
    """Pulses as kernels take them."""

    table: NDArray[np.int64]  # (waveform,) row of the tables
    timing: FloatArray  # (waveform, 7): T (s), W (rad/s), transmitted first and last (s), recovery (s), PRI (s), count


def eclipse_tables(waveforms: Sequence[Waveform]) -> EclipseTables:
    """The tables of single pulses, one for each, for ``gated_factors`` of continuous parameters.

    All Gaussian chirps have one and the same table, all trapezoid chirps of one law and relative rise another.

    Raises:
        InputError: no waveforms, or a waveform without a table (see ``cumulated_moments``).
    """
    if not len(waveforms):
        raise InputError("waveforms is empty, expected at least one waveform")
    return _stacked([cumulated_moments(_single(waveform)) for waveform in waveforms])


@dataclass(frozen=True)
class EclipsedPulse:
    """A pulse, or a coherent train, with the gate of its monostatic receiver.

    The receiver opens when the transmitted interval ends and the recovery time is over. It closes when the next pulse
    begins, so echoes are cut at both ends of the receive window and around every multiple of the interval. A pulse
    without an interval is followed by silence. The table of the waveform is made at the first use.

    Args:
        waveform: a pulse, or a ``PulseTrain``, whose interval counts.
        interval: PRI, s; None for one pulse and for a train.
        energy, level_db: definition of the transmitted interval, see ``transmitted_interval``.
        recovery: time after the transmitted interval until the receiver is open, s.

    Raises:
        InputError: what ``transmitted_interval`` refuses, a recovery or interval out of range, an interval without room
            for the pulse, or two different intervals.
    """

    waveform: Waveform
    interval: float | None = None
    energy: float | None = None
    level_db: float | None = None
    recovery: float = 0.0

    def __post_init__(self) -> None:
        own = self.waveform.interval if isinstance(self.waveform, PulseTrain) else None
        if own is not None and self.interval not in (None, own):
            raise InputError(f"interval is {self.interval!r} s, expected None or that of the train (nearest: {own!r})")
        self.timing(1.0)

    @property
    def transmitted(self) -> tuple[float, float]:
        """First and last time on the transmitter, s, in the pulse's own time."""
        return transmitted_interval(self.waveform, self.energy, self.level_db)

    def timing(self, carrier_hz: float, max_duty: float = 1.0) -> PulseTiming:
        """Blind ranges, unambiguous intervals and the like."""
        given = {} if self.interval is None else {"interval": self.interval}
        return PulseTiming.of(
            self.waveform, carrier_hz, self.energy, self.level_db, recovery=self.recovery, max_duty=max_duty, **given
        )

    def visible_share(self, range_m: ArrayLike) -> FloatArray:
        """f, the share of the echo's energy that the open receiver sees, in [0, 1], (...).

        Args:
            range_m: range of the target, m, >= 0, (...). Beyond the unambiguous range it folds.

        Raises:
            InputError: a range that is negative or not finite.
        """
        return self._one.visible_share(0, range_m)

    def snr_factor(self, range_m: ArrayLike, replica: str = "visible") -> FloatArray:
        """The factor of the SNR due to eclipsing, (...): see ``EclipsedLibrary.snr_factor``."""
        return self._one.snr_factor(0, range_m, replica)

    def fisher_factors(self, range_m: ArrayLike) -> FisherFactors:
        """Fisher information at SNR 1 of the *visible* part, in factored form, fields (...)."""
        return self._one.fisher_factors(0, range_m)

    def measurement_covariance(self, range_m: ArrayLike, carrier_hz: ArrayLike) -> FloatArray:
        """Cramer-Rao covariance of (range, range-rate) at *transmitted* SNR 1, (..., 2, 2): see ``EclipsedLibrary``."""
        return self._one.measurement_covariance(0, range_m, carrier_hz)

    @cached_property
    def _one(self) -> EclipsedLibrary:
        return EclipsedLibrary([self])


class EclipsedLibrary:
    """Several eclipsed pulses, for arrays of (waveform, range); ``tables`` and ``pulses`` go into kernels.

    Args:
        entries: the pulses. Pulses of one shape share one table.

    Raises:
        InputError: no pulses, or an entry that is no ``EclipsedPulse``.
    """

    tables: EclipseTables
    pulses: EclipsePulses

    def __init__(self, entries: Sequence[EclipsedPulse]) -> None:
        if not len(entries):
            raise InputError("entries is empty, expected at least one EclipsedPulse")
        shapes: list[CumulatedMoments] = []
        index, rows = [], []
        for entry in entries:
            if not isinstance(entry, EclipsedPulse):
                raise InputError(f"entries holds {entry!r}, expected EclipsedPulse(waveform) only")
            shape = cumulated_moments(_single(entry.waveform))
            known = [i for i, other in enumerate(shapes) if other is shape]
            if not known:
                shapes.append(shape)
            index.append(known[0] if known else len(shapes) - 1)
            rows.append(_row(entry))
        self.tables = _stacked(shapes)
        self.pulses = EclipsePulses(np.array(index, np.int64), np.array(rows))

    @cached_property
    def windows(self) -> FloatArray:
        """Rows of ``receive_windows``, (waveform, 10)."""
        return receive_windows(self.tables, *self.pulses)

    def visible_share(self, waveform: ArrayLike, range_m: ArrayLike) -> FloatArray:
        """f, the share of the echo's energy that the open receiver sees, in [0, 1], (...).

        Below 1e-6 it is 0.

        Args:
            waveform: index of the pulse, (...).
            range_m: range of the target, m, >= 0, (...).

        Raises:
            InputError: an index that is none, a range that is negative or not finite, or shapes that do not fit.
        """
        return self._factors(waveform, range_m)[..., 0]

    def snr_factor(self, waveform: ArrayLike, range_m: ArrayLike, replica: str = "visible") -> FloatArray:
        """The factor of the matched filter's SNR 2E/N0 due to eclipsing, (...).

        ``"visible"``: f, for a filter matched to the visible part. ``"full"``: f^2, for the full replica. Its output
        falls with f, but its noise is that of the whole replica. This holds if only echoes are blanked, or if the
        threshold is set for whole pulses.

        Args:
            waveform: index of the pulse, (...).
            range_m: range of the target, m, >= 0, (...).
            replica: ``"visible"`` or ``"full"``.

        Raises:
            InputError: as ``visible_share``, or an unknown replica.
        """
        check_choice("replica", replica, REPLICAS)
        share = self.visible_share(waveform, range_m)
        return share if replica == "visible" else share * share

    def fisher_factors(self, waveform: ArrayLike, range_m: ArrayLike) -> FisherFactors:
        """Fisher information at SNR 1 of the *visible* part, in factored form, fields (...).

        Multiply the information by f for transmitted SNR 1. An invisible pulse has the factors of the whole one.
        Arguments and errors: see ``visible_share``.
        """
        out = self._factors(waveform, range_m)
        return FisherFactors(out[..., 1], out[..., 2], out[..., 3])

    def measurement_covariance(self, waveform: ArrayLike, range_m: ArrayLike, carrier_hz: ArrayLike) -> FloatArray:
        """Cramer-Rao covariance of (range in m, range-rate in m/s) at *transmitted* SNR 1, (..., 2, 2).

        The loss of energy is included: divide by the SNR 2E/N0 that the echo would have without eclipsing. The
        covariance of an invisible pulse is that of the whole one at 1e-6 of its energy: finite, and without weight.

        Args:
            waveform: index of the pulse, (...).
            range_m: range of the target, m, >= 0, (...).
            carrier_hz: carrier frequency, Hz, (...); all three broadcast.

        Raises:
            InputError: as ``visible_share``, or a carrier that is not a finite number > 0.
        """
        index, r, carrier = check_broadcast(
            waveform=self._index(waveform),
            range_m=check_elements(check_non_negative, "range_m", range_m),
            carrier_hz=check_elements(check_positive, "carrier_hz", carrier_hz),
        )
        R = np.empty((r.size, 2, 2))
        kernels.covariances(self.tables, self.pulses, _flat(index), _flat(r), _flat(carrier), R)
        return R.reshape(*r.shape, 2, 2)

    def _factors(self, waveform: ArrayLike, range_m: ArrayLike) -> FloatArray:
        """(share, residual, slope, spread), (..., 4)."""
        index, r = check_broadcast(
            waveform=self._index(waveform), range_m=check_elements(check_non_negative, "range_m", range_m)
        )
        out = np.empty((r.size, 4))
        kernels.factors(self.tables, self.pulses, _flat(index), _flat(r), out)
        return out.reshape(*r.shape, 4)

    def _index(self, waveform: ArrayLike) -> NDArray[np.int64]:
        index = np.asarray(waveform)
        if index.dtype.kind not in "iu" or (
            index.size and not (index.min() >= 0 and index.max() < len(self.pulses[0]))
        ):
            raise InputError(f"waveform is {waveform!r}, expected indices in [0, {len(self.pulses[0]) - 1}]")
        return index.astype(np.int64)


def receive_windows(tables: EclipseTables, table: NDArray[np.int64], timing: FloatArray) -> FloatArray:
    """Rows of pulses with their receive windows, as ``eclipsing_kernels.is_whole`` takes them, (..., 10).

    Args:
        tables: of the pulses' shapes.
        table: row of the tables, (...).
        timing: as in ``EclipsePulses``, (..., 7).
    """
    first, last, recovery, interval = np.moveaxis(timing[..., 2:6], -1, 0)
    centre, nodes = tables.constants[table, 0], tables.nodes[table]
    begins, ends = (timing[..., 0] * (nodes[..., i] + centre) for i in (0, -1))
    span = interval + first - last - recovery - (ends - begins)
    return np.concatenate([np.stack([last + recovery - begins, span, table], axis=-1), timing], axis=-1)


def _single(waveform: Waveform) -> Waveform:
    return waveform.pulse if isinstance(waveform, PulseTrain) else waveform


def _row(entry: EclipsedPulse) -> tuple[float, ...]:
    """The pulse's row of ``EclipsePulses.timing``."""
    train = entry.waveform if isinstance(entry.waveform, PulseTrain) else None
    interval = train.interval if train is not None else entry.interval
    return (
        *scales(_single(entry.waveform)),
        *entry.transmitted,
        entry.recovery,
        math.inf if interval is None else interval,
        float(train.count) if train is not None else 1.0,
    )


def _stacked(shapes: Sequence[CumulatedMoments]) -> EclipseTables:
    constants = np.array([(shape.centre, shape.slope, shape.density) for shape in shapes])
    nodes, left, right, total = (
        np.stack([getattr(shape, name) for shape in shapes]) for name in ("nodes", "left", "right", "total")
    )
    return EclipseTables(nodes, left, right, total, constants)


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    """``array`` with one axis, for a kernel."""
    return for_kernel(array).reshape(-1)
