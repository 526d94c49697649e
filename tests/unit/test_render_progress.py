"""What is shown while a render goes on, and where: nothing, a bar, a changing line, or lines for logs."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import types

import pytest

from destello import progress
from destello.passes import Pacer
from destello.progress import Status, duration, showing


def status(seconds: float, *, done: int = 10, eta: float | None = 30.0, **more) -> Status:
    return Status(done, 40, seconds, eta, 2.5e6, 7e6, **more)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (59.4, "59 s"), (59.6, "1:00"), (125, "2:05"), (3725, "1:02:05"), (-1, "0 s")]
)
def test_duration(seconds, text):
    assert duration(seconds) == text


def test_status_text_and_fraction():
    assert status(10).text() == "10/40 spp, 30 s left, 2.5 Msamples/s, 7 Mrays/s"
    assert status(10).fraction == 0.25
    assert status(10, finished=True).fraction == 1
    open_ended = Status(10, None, 15, 45, 2.5e6, 7e6, error=0.0234)
    assert open_ended.text() == "10 spp, error 2.34%, 45 s left, 2.5 Msamples/s, 7 Mrays/s"
    assert open_ended.fraction == 0.25
    assert Status(10, None, 15, None, 1, 1).fraction == 0


def test_without_a_terminal_nothing_is_shown_unless_asked_for(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    for choice in ("auto", False, None):
        with showing(choice) as shown:
            for seconds in range(1, 60):
                shown(status(seconds))
    assert stream.getvalue() == ""
    with showing(True) as shown:
        for seconds in range(1, 60):
            shown(status(seconds))
        shown(status(60, finished=True))
    assert stream.getvalue().count("\n") == 5
    assert stream.getvalue().startswith(" 25%  10/40 spp")


def test_a_function_is_told_everything():
    seen = []
    with showing(seen.append) as shown:
        shown(status(1))
    assert seen == [status(1)]


def fake_notebook(monkeypatch) -> list[str]:
    """An IPython that records what is displayed, as a Jupyter kernel would show it."""
    shown: list[str] = []

    class Handle:
        def update(self, line):
            shown.append(line)

    def display(line, display_id):
        assert display_id is True
        shown.append(line)
        return Handle()

    shell = type("ZMQInteractiveShell", (), {})()
    package = types.ModuleType("IPython")
    package.get_ipython = lambda: shell
    module = types.ModuleType("IPython.display")
    module.HTML, module.display = str, display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    return shown


def test_in_a_notebook_a_line_changes(monkeypatch):
    shown = fake_notebook(monkeypatch)
    with showing("auto") as told:
        told(status(0.1, eta=1.0))
        assert shown == [], "nothing for what is over in two seconds"
        told(status(2.5))
        told(status(2.6))
        assert len(shown) == 1, "not faster than it can be read"
        told(status(3.0, finished=True))
    assert len(shown) == 2
    assert "10/40 spp" in shown[0]
    assert 'value="1.0000"' in shown[1]
    assert progress.interactive()


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX terminals")
@pytest.mark.parametrize(("limit", "bar"), [("4.5s", True), ("0.5s", False)])
def test_on_a_terminal_a_bar_appears_for_long_renders_only(tmp_path, limit, bar):
    import pty

    main, terminal = pty.openpty()
    command = [sys.executable, "-m", "destello", "render", "cornell", "--size", "20x20", "--time", limit]
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "120"}
    child = subprocess.Popen(
        [*command, "-o", str(tmp_path / "a.png")], stdout=subprocess.PIPE, stderr=terminal, env=environment
    )
    os.close(terminal)
    shown = b""
    while True:
        try:
            part = os.read(main, 65536)
        except OSError:  # how Linux says that the other side is closed
            break
        if not part:
            break
        shown += part
    os.close(main)
    assert child.communicate(timeout=60)[0] == b""
    assert child.returncode == 0
    assert (b"left" in shown) == bar
    assert ("━".encode() in shown) == bar
    assert b"Msamples/s" in shown


def test_pacer_aims_at_a_duration_and_grows_slowly():
    pacer = Pacer("cpu")
    assert pacer.next() == 1
    pacer.took(1, 0.001, 0.001)
    assert pacer.next() == 4
    pacer.took(4, 0.1, 0.1)
    assert pacer.next() == 8
    pacer.took(8, 80.0, 80.0)
    assert pacer.next() == 1


def test_pacer_makes_passes_longer_where_adding_films_takes_time():
    pacer = Pacer("cpu")
    pacer.took(10, 0.15, 0.1)
    assert pacer.next() == 40
    pacer.took(40, 0.45, 0.4)
    assert pacer.next() == int(1.0 / (0.45 / 40))
    pacer.took(40, 1.0, 0.5)
    assert pacer.next() == 80, "never longer than two seconds"
