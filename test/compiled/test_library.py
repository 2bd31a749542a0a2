# SPDX-License-Identifier: Apache-2.0
"""What is compiled is kept in a private folder, and taken from no other."""

import ctypes
import os
import shutil
import stat
import subprocess
import sys
import threading
from hashlib import sha256

import pytest
from thorough import mostly_thorough

pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
from kalman_ros.compiled import library
from kalman_ros.compiled.library import CompilerError, compiler, folder, load

pytestmark = pytest.mark.slow  # the compiler is another process

SOURCE = 'int answer(void) { return %d; }\n'


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """The folder of a process that has loaded nothing yet."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.delenv('CC', raising=False)
    monkeypatch.setattr(library, '_known', {})
    monkeypatch.setattr(library, 'compiler', library.compiler.__wrapped__)
    monkeypatch.setattr(library, '_version', library._version.__wrapped__)
    return tmp_path / 'cache' / 'kalman_ros'


def forget():
    """Know of nothing that was loaded."""
    library._known.clear()


def elsewhere(number):
    """Return the answer in another process: this one keeps what it has loaded under a name."""
    text = (
        f'from kalman_ros.compiled.library import load; print(load({SOURCE % number!r}).answer())'
    )
    found = subprocess.run(
        [sys.executable, '-c', text], capture_output=True, text=True, timeout=60
    )
    assert not found.stderr
    return int(found.stdout)


def plant(path, data):
    """Put a file in the place of what was compiled, which stays loaded."""
    path.unlink()
    path.write_bytes(data)
    path.chmod(0o700)


def answer(number, **options):
    return load(SOURCE % number, **options).answer()


def compilations(monkeypatch):
    """Return a list that grows with each."""
    found, run = [], library._run

    def counted(command, seconds):
        if '--version' not in command:
            found.append(command)
        return run(command, seconds)

    monkeypatch.setattr(library, '_run', counted)
    return found


def test_the_same_source_is_compiled_once(cache, monkeypatch):
    runs = compilations(monkeypatch)
    assert answer(1) == 1
    assert answer(1) == 1
    forget()
    assert answer(1) == 1
    assert answer(2) == 2
    assert len(runs) == 2
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o700 for path in cache.iterdir())
    assert len([*cache.iterdir()]) == 2  # and nothing else is left there


def test_another_compiler_has_its_own(cache, monkeypatch):
    answer(1)
    monkeypatch.setenv('CC', f'{compiler()[0]} -DOTHER')
    forget()
    assert answer(1) == 1
    assert len([*cache.iterdir()]) == 2


def evil(tmp_path):
    """Return a library that is not what its source says."""
    text = tmp_path / 'evil.c'
    text.write_text(SOURCE % 666)
    subprocess.run([*compiler(), '-shared', '-fPIC', '-o', tmp_path / 'evil.so', text], check=True)
    return tmp_path / 'evil.so'


def sealed(path):
    """Return a file as the cache has it."""
    return path.read_bytes() + sha256(path.read_bytes()).digest()


def planted(cache):
    (path,) = cache.iterdir()
    return path


def test_a_symbolic_link_is_not_followed(cache, tmp_path):
    answer(1)
    path = planted(cache)
    path.unlink()
    (tmp_path / 'sealed.so').write_bytes(sealed(evil(tmp_path)))
    path.symlink_to(tmp_path / 'sealed.so')
    assert elsewhere(1) == 1
    assert not path.is_symlink()


@pytest.mark.parametrize('mode', mostly_thorough([0o777, 0o720, 0o702], 0o702))
def test_what_others_could_have_written_is_compiled_again(cache, tmp_path, mode):
    answer(1)
    path = planted(cache)
    plant(path, sealed(evil(tmp_path)))
    assert elsewhere(1) == 666  # of a file of one's own, what it says is run
    path.chmod(mode)
    assert elsewhere(1) == 1
    assert stat.S_IMODE(path.stat().st_mode) == 0o700


@pytest.mark.parametrize('mode', mostly_thorough([0o777, 0o770, 0o707], 0o770))
def test_a_folder_that_others_can_write_to_is_not_used(cache, tmp_path, mode):
    answer(1)
    path = planted(cache)
    plant(path, sealed(evil(tmp_path)))
    cache.chmod(mode)
    assert folder() is None
    assert elsewhere(1) == 1


def test_a_folder_of_another_is_not_used(cache, monkeypatch):
    cache.mkdir(parents=True)
    monkeypatch.setattr(os, 'geteuid', lambda: 12345)
    assert folder() is None
    assert answer(1) == 1
    assert not [*cache.iterdir()]


def test_a_link_in_the_place_of_the_folder_is_not_used(cache, tmp_path):
    cache.parent.mkdir()
    (tmp_path / 'elsewhere').mkdir(mode=0o700)
    cache.symlink_to(tmp_path / 'elsewhere')
    assert folder() is None
    assert answer(1) == 1
    assert not [*(tmp_path / 'elsewhere').iterdir()]


@pytest.mark.parametrize('kind', ['a file', 'no folder of that name', 'relative'])
def test_without_a_folder_it_is_compiled_for_this_process(cache, monkeypatch, tmp_path, kind):
    if kind == 'a file':
        cache.parent.write_text('')
    elif kind == 'relative':  # the specification of XDG: relative paths are ignored
        monkeypatch.setenv('XDG_CACHE_HOME', 'cache')
        monkeypatch.setenv('HOME', str(tmp_path / 'home'))
        assert folder() == tmp_path / 'home' / '.cache' / 'kalman_ros'
    else:
        monkeypatch.setenv('XDG_CACHE_HOME', '/proc/none')
        assert folder() is None
    assert answer(1) == 1


def test_what_is_cut_short_is_compiled_again(cache):
    answer(1)
    whole = planted(cache).read_bytes()
    for size in (0, 10, 200, len(whole) // 2, len(whole) - 1):
        plant(planted(cache), whole[:size])
        assert elsewhere(1) == 1
        assert planted(cache).read_bytes() == whole


def test_a_full_disk_costs_the_cache_alone(cache, monkeypatch):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    cache.mkdir(parents=True, mode=0o700)
    compiled = library._compiled

    def in_cache(command, source, place, name):
        if place == cache:
            full()
        return compiled(command, source, place, name)

    monkeypatch.setattr(library, '_compiled', in_cache)
    assert answer(1) == 1
    monkeypatch.setattr(library, '_compiled', full)
    with pytest.raises(CompilerError, match='No space left on device'):
        answer(2)


def test_without_a_compiler_there_is_one_line(monkeypatch):
    monkeypatch.setenv('PATH', '/nowhere')
    with pytest.raises(CompilerError, match=r'^no C compiler was found$'):
        answer(1)


@pytest.mark.parametrize(
    ('command', 'reason'),
    [
        ('false', 'false'),
        ('sh -c "exec sleep 99"', 'timed out'),
        ('sh -c "echo no >&2; exit 1"', 'no'),
    ],
)
def test_a_compiler_that_fails_is_tried_once_and_named(monkeypatch, command, reason):
    monkeypatch.setenv('CC', command)
    monkeypatch.setattr(library, '_PATIENCE', 0.2)
    monkeypatch.setattr(library, '_version', lambda _: '1')
    with pytest.raises(CompilerError) as first:
        answer(1)
    assert reason in str(first.value)
    assert '\n' not in str(first.value)
    runs = compilations(monkeypatch)
    with pytest.raises(CompilerError):
        answer(1, wait=False)
    assert not runs


def test_who_does_not_wait_gets_what_is_there(cache):
    with pytest.raises(CompilerError, match='it is being compiled') as waiting:
        answer(1, wait=False)
    assert waiting.value.pending == SOURCE % 1
    load(waiting.value.pending)
    assert answer(1, wait=False) == 1
    forget()
    assert answer(1, wait=False) == 1


def test_what_a_killed_process_left_is_removed_in_time(cache):
    answer(1)
    old, new = cache / '.old', cache / '.new'
    for left in (old, new):
        left.mkdir()
        (left / 'source.c').write_text('')
    os.utime(old, (1, 1))
    answer(2)
    assert not old.exists()
    assert new.exists()


def test_two_processes_at_once_do_not_disturb_each_other(cache):
    text = (
        'from kalman_ros.compiled.library import load\n'
        f'print(load({SOURCE % 7!r}).answer(), flush=True)\n'
    )
    command = [sys.executable, '-c', text]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    assert [process.communicate(timeout=60)[0].strip() for process in running] == ['7'] * 4
    assert len([*cache.iterdir()]) == 1


def test_threads_may_ask_for_the_same(cache):
    found = []
    threads = [threading.Thread(target=lambda: found.append(answer(3))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [3] * 6
    assert isinstance(load(SOURCE % 3), ctypes.CDLL)


def script(path, lines):
    """Return a compiler that answers for its version and then does something else."""
    path.write_text(f'#!/bin/sh\n[ "$1" = --version ] && {{ echo it; exit 0; }}\n{lines}\n')
    path.chmod(0o700)
    return str(path)


@pytest.mark.parametrize(
    ('lines', 'reason'),
    [
        ("printf 'caf\\351\\n' >&2; exit 1", 'the C compiler failed: caf'),
        ('kill -9 $$', 'the C compiler failed: '),
        ('exit 0', 'the C compiler failed: '),
    ],
)
def test_a_compiler_may_fail_in_any_way(monkeypatch, tmp_path, lines, reason):
    monkeypatch.setenv('CC', script(tmp_path / 'compiler', lines))
    with pytest.raises(CompilerError) as error:
        answer(1)
    assert str(error.value).startswith(reason)
    assert '\n' not in str(error.value)


def test_of_a_version_that_is_refused_there_is_one_line(monkeypatch, tmp_path):
    (tmp_path / 'compiler').write_text('#!/bin/sh\nexit 1\n')
    (tmp_path / 'compiler').chmod(0o700)
    monkeypatch.setenv('CC', str(tmp_path / 'compiler'))
    with pytest.raises(CompilerError, match=r'^the C compiler failed: '):
        answer(1)


def test_a_compiler_of_another_language_is_asked_for_c(monkeypatch):
    if not shutil.which('g++'):
        pytest.skip('there is no g++')
    monkeypatch.setenv('CC', 'g++')
    assert answer(1) == 1


def test_one_compiler_runs_at_a_time_and_none_outlives_the_process(monkeypatch, tmp_path):
    """It and what it started, as gcc starts others."""
    marks = tmp_path / 'marks'
    marks.mkdir()
    slow = script(tmp_path / 'compiler', f'touch {marks}/$$; sleep 300 & wait')
    monkeypatch.setenv('CC', slow)
    monkeypatch.setattr(library, '_ended', threading.Event())
    failures = []

    def ask():
        with pytest.raises(CompilerError):
            answer(1)
        failures.append(1)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    while not [*marks.iterdir()]:
        threads[0].join(0.01)
    library.stop()  # at the exit of a process
    for thread in threads:
        thread.join()
    assert len(failures) == 4
    assert len([*marks.iterdir()]) == 1
