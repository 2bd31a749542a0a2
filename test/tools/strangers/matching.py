# SPDX-License-Identifier: Apache-2.0
"""Rules by which a finding of the doctor names the fault of a recording.

A finding is right if its kind is one of `NAMES` for the kind of the fault, and its subject is the
same sensor, input or parameter; that of a sensor, ``imu.radius``, by its name alone. If the fault
concerns one coordinate, a finding of a coordinate must be of this one. Correlated noise may be
named at either sensor. A unit must have the right factor within 5 %, and noise the right
direction. What the table calls alike is right too, except 'scale and bias', of which one finding
names a half. What a real recording has wrong by itself is neither right nor wrong. A finding whose
'same as' has the right kind and subject is tied. An interval is two of the printed standard
deviations, or the range that is printed; each must contain the size, or zero where the bias is of
another coordinate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from re import findall, search
from typing import Any

from .recordings import Recording

Finding = Mapping[str, Any]
#: Kinds of findings that name a kind of fault. A kind that is not here is named by its own word.
NAMES = {
    'scale': ('scale',), 'units': ('unit', 'scale'), 'sign': ('sign',), 'bias': ('bias', 'unit'),
    'drift': ('drift',), 'random walk': ('random walk',),
    'mounting': ('rotated',), 'frame': ('rotated', 'disturbed'),
    'axes': ('swapped', 'rotated'), 'delay': ('stamps late',),
    'clock offset': ('stamps early', 'stamps late', 'clock offset'), 'frozen': ('frozen',),
    'clock drift': ('clock drift',), 'initial state': ('initial belief too narrow',),
    'outliers': ('outliers', 'disturbed'), 'disturbed': ('disturbed', 'outliers', 'random walk'),
    'lever arm': ('lever arm',), 'saturation': ('saturated',),
    'correlated noise': ('correlated noise',),
    'coloured noise': ('coloured noise', 'random walk'), 'losses': ('losses', 'losses in bursts'),
    'stamps': ('stamps duplicated', 'stamps backward', 'stamps late', 'stamps early', 'jitter',
               'stamps rounded', 'stamps uneven'),
    'noise': ('noise too small', 'noise too large'), 'parameter': ('parameter',),
    'quantised': ('quantised',), 'scale 0': ('scale', 'unrelated'),
    'process noise': ('process noise too small', 'process noise too large'),
    'asymmetry': ('asymmetric scale', 'asymmetric gain'),
    'gate': ('gate', 'gate too narrow'), 'cross-axis': ('cross-axis', 'rotated'),
    'hard iron': ('hard iron', 'bias', 'random walk'), 'bias step': ('bias step', 'bias'),
    'slip': ('slip', 'disturbed', 'outliers', 'random walk'),
}  # fmt: skip
#: The same for faults of the input. A command that is recorded late acts before its stamp, and
#: 'input delay' is the opposite: a command that acts after its stamp.
INPUT_NAMES = {
    'scale': ('input gain',),
    'bias': ('disturbance',),
    'units': ('input gain',),
    'sign': ('input sign',),
    'input delay': ('input delay',),
    'dead zone': ('dead zone',),
    'asymmetry': ('asymmetric gain',),
    'mounting': ('input rotated',),
    'axes': ('input swapped', 'input rotated'),
}
#: Kinds of faults whose size is what a finding estimates.
SIZED = ('scale', 'units', 'bias', 'drift', 'delay', 'parameter', 'noise')
#: Largest relative error of the factor of a unit.
_WITHIN = 0.05
_NUMBER = r'([-+]?\d+\.?\d*(?:e[-+]\d+)?)'


def causes(words: str, subject: str = '') -> Iterator[tuple[str, str]]:
    """Yield the kind and the subject of each cause in words, 'kind of subject; kind; ...'."""
    for cause in words.split('; ') if words else ():
        kind, _, concerned = cause.partition(' of ')
        if kind.startswith('parameter '):
            kind, concerned = kind.split(' ', 1)
        yield kind, concerned or subject


def meanings(recording: Recording) -> list[tuple[str, str]]:
    """Return the kind and the subject of a fault, and of what is alike."""
    alike = causes(recording.alike, recording.subject)
    return [(recording.kind, recording.subject), *alike]


def is_meant(kind: str, subject: str, fault: str, concerned: str) -> bool:
    """Return whether a kind and a subject of a finding name a fault and what it concerns."""
    if concerned == 'input':
        return kind in INPUT_NAMES.get(fault, ())
    if kind not in NAMES.get(fault, (fault,)):
        return False
    words = concerned.replace(',', ' ').split()
    if fault == 'parameter':
        return subject.partition('[')[0].rpartition('.')[2] in words
    if fault == 'correlated noise':
        return any(word in subject for word in words)
    sensor, _, coordinate = subject.partition('.')
    # the finding of a first belief names initial_std, and its sentence the state
    if fault in ('process noise', 'initial state') or concerned == 'all':
        return True
    return sensor == words[0] and (len(words) == 1 or coordinate in ('', words[1]))


def is_right(finding: Finding, recording: Recording) -> bool:
    """Return whether a finding itself names the fault of a recording, or what is alike."""
    kind, subject = finding['kind'], finding['subject']
    pairs = [pair for pair in meanings(recording) if is_meant(kind, subject, *pair)]
    if kind != 'correlated noise' and ' and ' in subject:  # each of several sensors
        of_each = [
            [pair for pair in meanings(recording) if is_meant(kind, part, *pair)]
            for part in subject.split(' and ')
        ]
        pairs = of_each[0] if all(of_each) else []
    if not pairs:
        return False
    if recording.kind in ('noise', 'process noise') and pairs[0][0] == recording.kind:
        return bool(kind.endswith('small') == (recording.size > 1.0))
    if kind == 'unit':
        moved = search(rf'moved by {_NUMBER}', finding['sentence'])
        if moved and recording.kind == 'bias':
            return abs(abs(float(moved[1])) / recording.size - 1.0) < _WITHIN
        factor = search(rf'multiplied by {_NUMBER}', finding['sentence'])
        return factor is not None and abs(float(factor[1]) * recording.size - 1.0) < _WITHIN
    return True


def is_own(finding: Finding, recording: Recording) -> bool:
    """Return whether a finding names what a recording has wrong by itself, and not the fault."""
    others = [*causes(recording.own)]
    said = [(finding['kind'], finding['subject']), *finding['same as']]
    named = (is_meant(kind, subject, *own) for kind, subject in said for own in others)
    return any(named) and not is_right(finding, recording) and not is_tied(finding, recording)


def is_tied(finding: Finding, recording: Recording) -> bool:
    """Return whether a finding says that the fault of a recording fits as well."""
    others = ({'kind': kind, 'subject': subject} for kind, subject in finding['same as'])
    return any(is_right({**other, 'sentence': ''}, recording) for other in others)


def interval(finding: Finding, recording: Recording) -> str:
    """Return whether the interval of a right finding has the size of the fault; '' without one."""
    fault, size = recording.kind, recording.size
    meant = is_meant(finding['kind'], finding['subject'], fault, recording.subject)
    if fault not in SIZED or not meant or not size:
        return ''
    text = finding['sentence']
    ranges = [(float(a), float(b)) for a, b in findall(rf'\({_NUMBER} to {_NUMBER}, 95', text)]
    for middle, std in findall(rf'{_NUMBER} (?:±|\+-) {_NUMBER}', text):
        ranges.append((abs(float(middle)) - 2.0 * float(std), abs(float(middle)) + 2 * float(std)))
    if fault in ('scale', 'units') or (fault == 'noise' and size < 1.0):
        size = 1.0 / size
    size = abs(size)
    inside = [a <= size <= b for a, b in ranges]
    if fault == 'bias' and ' ' in recording.subject and any(inside):  # others have none
        inside = [within or a <= 0.0 <= b for within, (a, b) in zip(inside, ranges)]
    return ('in' if all(inside) else 'out') if ranges else ''
