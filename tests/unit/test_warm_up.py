"""A CUDA device is made ready in the background, once, and only where one is asked for."""

from __future__ import annotations

import threading

import pytest

from destello import _core, device


@pytest.fixture
def asked(monkeypatch):
    """The devices that the core was told to make ready."""
    seen: list[int] = []
    monkeypatch.setattr(_core, "cuda_warm_up", seen.append)
    monkeypatch.setattr(_core, "has_cuda", True)
    monkeypatch.setattr(device, "_warm", set())
    return seen


def wait():
    for thread in threading.enumerate():
        if thread.name == "destello-warm-up":
            thread.join(10)


def test_each_request_once(asked):
    for request in ("auto", "cuda:2", "auto", " CUDA:2 "):
        device.warm_up(request)
    wait()
    assert sorted(asked) == [0, 2]


@pytest.mark.parametrize("request_", ["cpu", "cuda:", "cuda:x", "tpu", "cuda:12345678901"])
def test_nothing_else_starts_a_thread(asked, request_):
    device.warm_up(request_)
    wait()
    assert asked == []


def test_nothing_without_the_backend(asked, monkeypatch):
    monkeypatch.setattr(_core, "has_cuda", False)
    device.warm_up("auto")
    wait()
    assert asked == []


def test_failures_are_left_to_whoever_uses_the_device():
    assert _core.cuda_warm_up(999) is None
