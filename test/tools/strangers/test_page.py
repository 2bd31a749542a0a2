# SPDX-License-Identifier: Apache-2.0
"""The page of the score on the recordings of strangers."""

import json
from pathlib import Path

import pytest

from .program import main


def result(folder: Path, name: str, *findings: dict[str, object]) -> None:
    out = folder / name / 'doctor'
    out.mkdir(parents=True)
    run = {'code': 0, 'error': '', 'seconds': 1.0, 'findings': findings}
    (out / 'result.json').write_text(json.dumps(run))


def found(kind: str, subject: str, certainty: float) -> dict[str, object]:
    return {
        'kind': kind, 'subject': subject, 'sentence': '', 'share': 1.0, 'gain': 9.0, 'z': 3.0,
        'certainty': certainty, 'same as': [],
    }  # fmt: skip


def test_it_counts_by_set_certainty_and_kind(tmp_path: Path) -> None:
    result(tmp_path / 'first', 'rover_clean')
    result(tmp_path / 'first', 'rover_gyro_sign', found('sign', 'gyro.omega', 0.96))
    result(tmp_path / 'second', 'ferry_antenna', found('bias', 'compass', 0.92))
    page = tmp_path / 'page.md'
    main(['--page', str(page), '--out', str(tmp_path)])
    text = page.read_text()
    assert '| first | 1 of 1 (100 %) | 0 | 1 of 1 (100 %) | 0 of 2 (0 %) | 0 of 1 (0 %) |' in text
    assert '| second | 0 of 1 (0 %) | 0 | 0 of 1 (0 %) | 1 of 1 (100 %) | 0 of 0 (0 %) |' in text
    assert '| 95 to 99 % | 1 of 1 (100 %) | 0 of 0 (0 %) | 1 of 1 (100 %) |' in text
    assert '| 85 to 95 % | 0 of 0 (0 %) | 0 of 1 (0 %) | 0 of 1 (0 %) |' in text
    assert '| sign | 1 of 1 |  |' in text
    assert (
        '| ferry_antenna | lever arm of gnss: 12 m forward, declared 0 | bias of compass' in text
    )


@pytest.mark.parametrize('name', ['nothing'])
def test_an_unknown_recording_is_refused(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([name])
    assert 'nothing' in capsys.readouterr().err
