# SPDX-License-Identifier: Apache-2.0
"""Invalid stamps: zero, duplicated, out of order, or of another clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .evidence import Evidence
from .examination import CHANCE, Examination
from .filter_pass import passage, usable
from .finding import Curve, Figure, Finding
from .passage import explained

#: A clock is suspected if its stamps are ahead of the recorder by more than the first time (s), or
#: behind it by more than the second.
_AHEAD, _BEHIND = 0.005, 0.02
#: A drift or a jump of a clock by less than this time (s) is harmless. A jump is this many times
#: the spread of the times besides.
_DRIFTED, _CLEAR = 0.005, 4.0
#: Stamps are shared if each has this number of readings on average.
_SEVERAL = 1.9
#: Readings come one by one if nearly all are at least this share of the usual time apart.
_ONE_BY_ONE = 0.3
#: Stamps are those of one instant below this share of the usual time between readings.
_TOGETHER = 0.2
#: Stamps may be rounded to one of these times (s), or to the least difference of two distances
#: that is above the second number; it matters above a share of their distance.
_GRIDS, _FINEST = (1.0, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001), 1e-3
_COARSE, _ENOUGH = 0.05, 20
#: Readings are received in blocks if the usual time between two differs by more than this share.
_IN_BLOCKS = 0.5


def find(case: Examination) -> Iterator[Finding]:
    """Yield the faults of the stamps of each sensor."""
    for name, record in case.evidence.sensors.items():
        if len(record) > 2:
            yield from _find_zero(case.evidence, name, record)
            yield from _find_shared(case.evidence, name, record)
            yield from _find_set_clock(case, name, record)
            yield from _find_duplicates(case, name, record)
            yield from _find_backward(case, name, record)
            yield from _find_rounded(case.evidence, name, record)
            yield from _find_clock_error(case, name, record)
    yield from _find_future_inputs(case.evidence)


def latency(record: SensorRecord) -> Array:
    """Return the time from the stamp to the receipt of each reading (N,), in seconds."""
    return np.round(record.received - record.stamp, 9)  # stamps are integer nanoseconds


def slope(x: Array, y: Array) -> float:
    """Return the slope of a line through points by the Theil-Sen estimator.

    It is the median over pairs of points (P. K. Sen, Estimates of the Regression Coefficient Based
    on Kendall's Tau, J. American Statistical Association 63, 1968), here over pairs that are half
    of the points apart.
    """
    half = len(x) // 2
    run = x[half : 2 * half] - x[:half]
    apart = np.abs(run) > 0.0
    rises = (y[half : 2 * half] - y[:half])[apart] / run[apart]
    return float(np.median(rises)) if len(rises) else 0.0


def picture(name: str, record: SensorRecord, title: str) -> Figure:
    """Return the picture of the latency of a sensor over time."""
    times = record.received - record.received[0]
    curve = Curve('received - stamp', times, latency(record), 'dots')
    return Figure(f'{name}: {title}', 'time [s]', 'received - stamp [s]', (curve,))


def _find_zero(evidence: Evidence, name: str, record: SensorRecord) -> Iterator[Finding]:
    zero = ~record.stamped
    if zero.any():
        delays = latency(record)[~zero]
        typical_delay = float(np.median(delays)) if len(delays) else 1e-9
        stamp = np.where(zero, record.received - typical_delay, record.stamp)
        type = evidence.scenario.sensors[name].signal.type
        sentence = (
            f'readings of {name} count from their receipt, since {type} has no stamp. Delays and '
            'jitter on the way remain in them.'
            if name in evidence.headerless
            else f'{zero.sum()} of {len(record)} stamps of {name} are zero: its driver does not '
            'stamp them, so they are taken for the time of receipt. Stamp them where they are '
            'read.'
        )
        yield Finding(
            'stamps zero', name, sentence, inf, note=name in evidence.headerless,
            figure=picture(name, record, 'stamps that are zero'),
            mended=lambda: evidence.with_sensor(
                name, replace(record, stamp=stamp, stamped=np.ones_like(zero))
            ),
        )  # fmt: skip


def _find_duplicates(case: Examination, name: str, record: SensorRecord) -> Iterator[Finding]:
    valid: Any = record.stamped & usable(record)
    _, first = np.unique(np.round(record.stamp[valid], 9), return_index=True)
    count = int(valid.sum()) - len(first)
    if count:
        kept = np.sort(np.concatenate((np.flatnonzero(valid)[first], np.flatnonzero(~valid))))
        yield Finding(
            'stamps duplicated', name,
            f'{count} of {len(record)} readings of {name} have the stamp of another one '
            f'({100.0 * count / len(record):.2g} %): they are dropped as duplicates. Look for two '
            'publishers of this topic, or a relay that repeats.',
            inf, figure=picture(name, record, 'latency'), **_selection(case, name, record, kept)
        )  # fmt: skip


def _find_backward(case: Examination, name: str, record: SensorRecord) -> Iterator[Finding]:
    stamps = record.stamp[record.stamped]
    steps = np.diff(stamps)
    count, usual = int((steps < 0.0).sum()), np.median(np.abs(steps)) if len(steps) else 0.0
    forward = np.pad(np.diff(record.stamp) >= 0.0, 1, constant_values=True)
    in_order = latency(record)[forward[1:] & forward[:-1]]
    jitter = np.ptp(np.quantile(in_order, (0.01, 0.99))) if len(in_order) else 0.0
    if count and jitter < 0.5 * usual:  # otherwise jitter causes the order
        order = np.argsort(record.stamp, kind='stable')
        yield Finding(
            'stamps backward', name,
            f'{count} of {len(record)} readings of {name} are stamped before the one received '
            f'before them, by up to {-steps.min():.3g} s: they are out of order. The estimator '
            'takes them in their place while they are within its window.',
            inf, figure=picture(name, record, 'latency'), **_selection(case, name, record, order)
        )  # fmt: skip


def _find_shared(evidence: Evidence, name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield a finding if readings received one by one share a stamp, or are stamped together."""
    if not record.stamped.all():
        return
    gaps = np.diff(record.received)
    usual = float(np.mean(gaps))
    stamps = np.sort(record.stamp)
    begins = np.flatnonzero(np.diff(stamps, prepend=-inf) > _TOGETHER * usual)
    if len(begins) < _ENOUGH or len(stamps) < _SEVERAL * len(begins):
        return
    if usual <= 0.0 or float(np.quantile(gaps, 0.05)) < _ONE_BY_ONE * usual:
        return
    groups = np.diff(np.append(begins, len(stamps)))
    within = float(np.median(stamps[begins + groups - 1] - stamps[begins]))
    apart = float(np.median(np.diff(stamps[begins])))
    how = f'are stamped within {within:.2g} s' if within > 1e-6 else 'have one stamp'
    # none is received before it is taken: the least latency is that of a stamp that lost nothing,
    # unless each is rounded and has lost something
    least = max(float(latency(record).min()), 0.0)
    stamp = record.received - (0.0 if least < _grid(evidence, record) else least)
    shared = _rounded(
        name, record,
        f'{int(np.median(groups))} readings of {name} in a row {how}, every {apart:.3g} s, while '
        f'they are received every {usual:.3g} s',
        lambda: evidence.with_sensor(name, replace(record, stamp=stamp)),
    )  # fmt: skip
    # what is left by the times of receipt, which jitter, follows from it
    yield replace(shared, plain=True)


def _rounded(
    name: str, record: SensorRecord, seen: str, mended: Callable[[], Evidence] | None = None
) -> Finding:
    """Return the finding that stamps are rounded, by what is seen of them."""
    return Finding(
        'stamps rounded', name,
        f'{seen}: they are not the times of the readings. Stamp each when it is taken, with all '
        'digits of the clock.',
        inf, figure=picture(name, record, 'stamps that are rounded'), mended=mended,
    )  # fmt: skip


def _find_rounded(evidence: Evidence, name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield a finding if stamps are multiples of a time, while the receipt is more regular."""
    gaps, received = np.diff(_different(record)), np.diff(record.received)
    grid = _grid(evidence, record)
    if not grid:
        return
    usual = float(np.median(received))
    if abs(usual / float(np.median(gaps)) - 1.0) > _IN_BLOCKS:
        return
    spread, of_receipt = (float(np.std(x[x < 1.7 * usual])) for x in (gaps, received))
    if grid > _COARSE * usual and spread > 2.0 * of_receipt:
        yield _rounded(
            name, record,
            f'stamps of {name} differ by multiples of {grid:g} s, while they are received every '
            f'{usual:.3g} s, regular to {of_receipt:.1g} s',
        )  # fmt: skip


def _different(record: SensorRecord) -> Array:
    """Return the different stamps of a record in order, in whole microseconds."""
    return np.unique(np.round(record.stamp[record.stamped], 6))


def _grid(evidence: Evidence, record: SensorRecord) -> float:
    """Return the coarsest time of which all stamps are multiples, in s; 0 without one."""
    stamps = _different(record) + evidence.origin % 1_000_000_000 * 1e-9
    if len(stamps) <= _ENOUGH:
        return 0.0
    gaps = np.diff(stamps)
    steps = np.diff(np.unique(np.round(gaps, 6)), prepend=0.0)
    least = float(steps[steps > _FINEST].min(initial=inf))
    least = _refined(stamps - stamps[0], least) if least < inf else inf
    shared = record.stamped.sum() > _SEVERAL * len(stamps)
    # steps of one length alone are the period of the sensor
    uneven = float(np.median(gaps)) > 1.5 * least
    # each stamp is rounded to a microsecond
    if least < inf and (shared or uneven) and _are_multiples(stamps - stamps[0], least, 2e-6):
        return least
    return next((grid for grid in _GRIDS if _are_multiples(stamps, grid)), 0.0)


def _refined(times: Array, step: float) -> float:
    """Return a step of which times are multiples, from one that is right to a microsecond."""
    for doublings in range(1, len(times).bit_length() + 1):
        time = float(times[min(2**doublings, len(times) - 1)])
        step = time / max(round(time / step), 1)
    return step


def _are_multiples(times: Array, step: float, within: float = 1e-6) -> bool:
    return bool(np.abs(times / step - np.round(times / step)).max() * step <= within)


def _selection(case: Examination, name: str, record: SensorRecord, rows: Any) -> dict[str, Any]:
    """Return the correction that reduces the record to ``rows``, which a filter pass keeps."""
    return {
        'mended': lambda: case.evidence.with_sensor(name, record.select(rows)),
        'passage': case.passage.selected(name, rows),
    }


def _find_clock_error(case: Examination, name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield an offset or a drift of the clock of the stamps relative to the recorder."""
    evidence, delays = case.evidence, _uncorrected(case.evidence, name)
    stamped = record.stamped
    delays, received = delays[stamped], record.received[stamped]
    jumps = len(delays) > 2 and _jump(delays) is not None
    if len(delays) < 3 or (jumps and [*_find_set_clock(case, name, record)]):
        return
    rate = 0.0 if jumps else slope(received, delays)
    drifted = rate * np.ptp(received)
    level = float(np.median(delays - rate * (received - received[0])))
    spread = float(np.ptp(np.quantile(delays - rate * received, (0.05, 0.95))))
    fit = level + rate * (record.received - received[0])
    mended = evidence.with_sensor(name, replace(record, stamp=record.stamp + fit))
    figure = picture(name, record, 'its clock against the recorder')
    if abs(drifted) > max(_DRIFTED, spread):
        yield Finding(
            'clock drift', name,
            f'the clock that stamps {name} drifts by {1e6 * -rate:+.0f} ppm against the recorder, '
            f'{drifted:+.3g} s over the recording. Synchronise it (chrony, PTP), or stamp on '
            'receipt.',
            inf, figure=figure, mended=lambda: mended,
        )  # fmt: skip
    elif level < -_AHEAD or (level > _BEHIND and _improves_fit(case, mended)):
        way = 'ahead of' if level < 0.0 else 'behind'
        grid = _grid(evidence, record)
        if 0.0 < level < grid:
            rounded = _rounded(
                name,
                record,
                f'stamps of {name} differ by multiples of {grid:g} s, and are {level:.3g} s '
                'behind the recorder',
                lambda: mended,
            )
            yield replace(rounded, same_as=(('clock offset', name),))
            return
        yield Finding(
            'clock offset', name,
            f'stamps of {name} are {abs(level):.3g} s {way} the recorder'
            f'{_delays_of_others(evidence, name)}. Synchronise the clocks, or stamp on receipt.',
            inf, figure=figure, mended=lambda: mended,
        )  # fmt: skip


class _Jump(NamedTuple):
    """Times that change once: the first one after it, and the levels before and after."""

    at: int
    before: float
    after: float


def _jump(delays: Array) -> _Jump | None:
    """Return where times change at once, by the least squares; None where they do not."""
    count = np.arange(1, len(delays))
    sums = np.cumsum(delays - delays.mean())[:-1]
    at = 1 + int(np.argmax(sums**2 / (count * (len(delays) - count))))
    if min(at, len(delays) - at) < _ENOUGH:
        return None
    before, after = (float(np.median(part)) for part in (delays[:at], delays[at:]))
    rest = delays - np.where(np.arange(len(delays)) < at, before, after)
    spread = float(np.ptp(np.quantile(rest, (0.05, 0.95))))
    jumps = abs(after - before) > max(_DRIFTED, _CLEAR * spread)
    return _Jump(at, before, after) if jumps else None


def _find_set_clock(case: Examination, name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield the time at which the clock of the stamps was set, if it was no delay that changed."""
    stamped = np.flatnonzero(record.stamped)
    jump = _jump(_uncorrected(case.evidence, name)[stamped]) if len(stamped) > 2 else None
    if jump is None:
        return
    _, before, after = jump
    late = np.arange(len(record)) >= stamped[jump.at]
    wrong = (late if abs(after) > abs(before) else ~late) & record.stamped
    shift = after - before if abs(after) > abs(before) else before - after
    mended = case.evidence.with_sensor(name, replace(record, stamp=record.stamp + shift * wrong))
    if min(before, after) > -_AHEAD and not _improves_fit(case, mended):
        return
    when = float(record.received[stamped[jump.at]]) - case.evidence.start
    yield Finding(
        'clock offset', name,
        f'stamps of {name} jump by {before - after:+.3g} s against the recorder at t = {when:.3g} '
        's: its clock was set. Synchronise it before the start, and slew it later.',
        inf, figure=picture(name, record, 'its clock against the recorder'), mended=lambda: mended,
    )  # fmt: skip


def _find_future_inputs(evidence: Evidence) -> Iterator[Finding]:
    """Yield a finding if inputs are stamped after they are received."""
    received, stamp = evidence.inputs.received, evidence.inputs.stamp
    if len(stamp) < 3:
        return
    offset = 1e-9 * evidence.scenario.input.stamp_offset
    level = float(np.median(received - stamp)) + offset
    if level < -_AHEAD:
        yield Finding(
            'clock offset', 'input',
            f'stamps of the input are {-level:.3g} s ahead of the recorder'
            f'{_delays_of_others(evidence)}. Synchronise the clocks, or stamp on receipt.',
            inf, mended=lambda: evidence.with_late_inputs(level),
        )  # fmt: skip


def _uncorrected(evidence: Evidence, name: str) -> Array:
    """Return the latency by the stamps in the messages, which a file may correct (N,)."""
    offset = 1e-9 * evidence.scenario.sensors[name].signal.stamp_offset
    return np.round(latency(evidence.sensors[name]) + offset, 9)


def _improves_fit(case: Examination, mended: Evidence) -> bool:
    """Return whether the readings fit the other sensors better with the corrected stamps.

    If innovations are larger than expected, for any cause, the limit of chance is larger in
    proportion.
    """
    dispersion = float(case.passage.square.sum() / case.passage.sizes.sum())
    return explained(case.passage, passage(mended)) > CHANCE * max(1.0, dispersion)


def _delays_of_others(evidence: Evidence, name: str = '') -> str:
    delays = {
        other: float(np.median(_uncorrected(evidence, other)))
        for other, record in evidence.sensors.items()
        if other != name and len(record)
    }
    words = ', '.join(f'{other} {value:+.3g} s' for other, value in delays.items())
    return f' (received - stamp of others: {words})' if words else ''
