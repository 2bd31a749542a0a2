# SPDX-License-Identifier: Apache-2.0
"""Drives a headless Chromium over its DevTools protocol, with the library of the live page."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

#: The names of its program.
PROGRAMS = ('chromium', 'chromium-browser', 'google-chrome', 'chrome')


def program() -> str:
    """Return the path of Chromium; '' if there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), '')


class Chromium:
    """A browser with one page; a context manager.

    Parameters
    ----------
    width, height
        Of the page, in pixels.
    dark
        Whether the system prefers a dark page.
    """

    def __init__(self, width: int = 1400, height: int = 1000, *, dark: bool = False) -> None:
        self._size, self._dark = (width, height), dark
        self._folder = tempfile.TemporaryDirectory(prefix='chromium_', ignore_cleanup_errors=True)
        self._count = 0
        #: Errors of scripts, and what the page was refused.
        self.errors: list[str] = []

    def __enter__(self) -> Chromium:
        from websockets.sync.client import connect

        self._process = subprocess.Popen(
            [
                program(), '--headless', '--no-sandbox', '--disable-gpu', '--no-first-run',
                '--disable-dev-shm-usage', '--remote-debugging-port=0',
                f'--user-data-dir={self._folder.name}', 'about:blank',
            ],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            where = self._page()
            self._socket = connect(where, max_size=None, proxy=None)
            for domain in ('Page', 'Runtime', 'Log'):
                self.call(f'{domain}.enable')
            width, height = self._size
            self.resize(width, height)
            scheme = [{'name': 'prefers-color-scheme', 'value': 'dark' if self._dark else 'light'}]
            self.call('Emulation.setEmulatedMedia', features=scheme)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(20)
        self._folder.cleanup()

    def _page(self, seconds: float = 60.0) -> str:
        """Return the address of the first page's debugger."""
        file, end = Path(self._folder.name, 'DevToolsActivePort'), time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(0.1)
            if not file.exists() or '\n' not in file.read_text():
                continue
            port = file.read_text().splitlines()[0]
            with urllib.request.urlopen(f'http://127.0.0.1:{port}/json', timeout=20) as answer:
                pages = [each for each in json.load(answer) if each['type'] == 'page']
            if pages:
                return str(pages[0]['webSocketDebuggerUrl'])
        raise RuntimeError('chromium did not start')

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol and return its result."""
        self._count += 1
        number = self._count
        self._socket.send(json.dumps({'id': number, 'method': method, 'params': parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=60))
            if message.get('method') == 'Runtime.exceptionThrown':
                details = message['params']['exceptionDetails']
                self.errors.append(str(details.get('exception', details)))
            if message.get('method') == 'Log.entryAdded':
                entry = message['params']['entry']
                if entry['level'] == 'error':
                    self.errors.append(entry['text'])
            if message.get('id') == number:
                if 'error' in message:
                    raise RuntimeError(f'{method}: {message["error"]["message"]}')
                return message['result']

    def resize(self, width: int, height: int, *, mobile: bool = False) -> None:
        """Change the size of the page."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width, height=height, deviceScaleFactor=1, mobile=mobile,
        )  # fmt: skip

    def open(self, address: str) -> None:
        """Open an address."""
        self.call('Page.navigate', url=address)

    def run(self, script: str) -> Any:
        """Return the value of a JavaScript expression."""
        found = self.call('Runtime.evaluate', expression=script, returnByValue=True)
        if 'exceptionDetails' in found:
            raise RuntimeError(f'{script}: {found["exceptionDetails"]["text"]}')
        return found['result'].get('value')

    def until(self, script: str, seconds: float = 60.0) -> Any:
        """Wait until an expression is true, and return its value."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                value = self.run(script)
            except RuntimeError as error:  # a page that loads has no answer
                if 'navigated' not in str(error):
                    raise
                value = None
            if value:
                return value
            time.sleep(0.05)
        raise AssertionError(f'not within {seconds:g} s: {script}; errors: {self.errors}')

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Scroll to an element; return left, top, width and height in the window."""
        box = self.run(
            f'(e => {{ e.scrollIntoView({{block: "center"}}); const b = e.getBoundingClientRect();'
            f' return [b.left, b.top, b.width, b.height]; }})'
            f'(document.querySelector({json.dumps(selector)}))'
        )
        left, top, width, height = box
        return left, top, width, height

    def click(self, selector: str, x: float = 0.5, y: float = 0.5) -> None:
        """Click an element, at shares of its width and height."""
        left, top, width, height = self.place(selector)
        self.drag((left + x * width, top + y * height))

    def drag(self, *places: tuple[float, float]) -> None:
        """Press the mouse at the first place, move to the others, and release it."""
        for kind, (x, y) in (
            ('mouseMoved', places[0]),
            ('mousePressed', places[0]),
            *(('mouseMoved', place) for place in places[1:]),
            ('mouseReleased', places[-1]),
        ):
            button = 'none' if kind == 'mouseMoved' and (x, y) == places[0] else 'left'
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button=button, clickCount=1)

    def key(self, key: str) -> None:
        """Press a key."""
        text = {'text': key} if len(key) == 1 else {}
        code = {'ArrowRight': 39, 'Tab': 9}.get(key, 0)
        for kind in ('keyDown', 'keyUp'):
            self.call(
                'Input.dispatchKeyEvent', type=kind, key=key, windowsVirtualKeyCode=code,
                **(text if kind == 'keyDown' else {}),
            )  # fmt: skip

    def picture(self) -> bytes:
        """Return the page as a PNG."""
        return base64.b64decode(self.call('Page.captureScreenshot', format='png')['data'])
